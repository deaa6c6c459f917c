"""Outputs of NI hardware: within what the module can give, on the inputs' clock or on their timebase, at rest by hand where need be."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import numpy.typing as npt
from nidaqmx.constants import LineGrouping, TaskMode
from nidaqmx.errors import DaqError
from nidaqmx.stream_writers import AnalogMultiChannelWriter, DigitalSingleChannelWriter

from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.errors import AttemptError
from agent.safety import way_home
from agent.settings import OutputSettings

_NOT_SHARED = frozenset({-200077, -200414, -200908, -89120, -89125, -89136, -89139})
"""What a driver says to a sample clock that a converter cannot follow."""
_BY_HAND = 50.0
"""Values per second that a program can set without falling behind."""


def span(device: Any, output: OutputSettings) -> tuple[float, float]:
    """Return the lowest and the highest value that a device gives, V or A.

    Raises
    ------
    AttemptError
        `unsupported_setting`, where it has no output of this kind.
    """
    limits = device.ao_current_rngs if output.kind == "current" else device.ao_voltage_rngs
    if not limits:
        raise AttemptError(
            "unsupported_setting",
            f"{output.channel} of output {output.name} must give a {output.kind}, {device.name} does not",
        )
    return min(limits), max(limits)


def check_span(output: OutputSettings, device: Any) -> None:
    """Make sure that a device gives what an output may be driven to.

    Raises
    ------
    AttemptError
        `unsupported_setting`, with the name, the rule and the value.
    """
    low, high = span(device, output)
    most, given = max(abs(low), abs(high)), f"{low:g} ... {high:g} {output.unit}"
    for name, value, fits in (
        ("amplitude", output.amplitude, output.amplitude <= most * (1 + 1e-9)),
        ("safe", output.safe, low <= output.safe <= high),
    ):
        if not fits:
            rule = f"at most {most:g}" if name == "amplitude" else f"within {given}"
            raise AttemptError(
                "unsupported_setting",
                f"output {output.name}: {name} must be {rule}, got {value:g}: {device.name} gives {given}",
                remedy=f"correct `{name}` in its entry",
            )


def add_output(task: Any, output: OutputSettings, device: Any) -> None:
    """Add an output within its limits and those of its device: many give no negative values.

    Whoever drives it has had `check_span` before; an output that has to rest takes what there is.
    """
    if output.kind == "digital":
        task.do_channels.add_do_chan(output.channel, line_grouping=LineGrouping.CHAN_PER_LINE)
        return
    low, high = span(device, output)
    limits = {"min_val": max(-output.amplitude, low), "max_val": min(output.amplitude, high)}
    if output.kind == "current":
        task.ao_channels.add_ao_current_chan(output.channel, **limits)
    else:
        task.ao_channels.add_ao_voltage_chan(output.channel, **limits)


def write(task: Any, output: OutputSettings, values: npt.NDArray[np.float64], *, now: bool, timeout: float) -> None:
    """Give an output its next values, shape (n,): into the buffer of a task, or at once where it has no clock."""
    if output.kind == "digital":  # the value of a line is in the bit of its number
        bits = values.astype(np.uint32) << np.uint32(int(output.channel.rpartition("line")[2]))
        DigitalSingleChannelWriter(task.out_stream, auto_start=now).write_many_sample_port_uint32(bits, timeout=timeout)
    else:
        data = np.ascontiguousarray(values[None, :])
        AnalogMultiChannelWriter(task.out_stream, auto_start=now).write_many_sample(data, timeout=timeout)


def follow(
    task: Any, inputs: Any, *, output: OutputSettings, settings: NidaqmxSettings, rate: float, timing: dict[str, Any]
) -> None:
    """Let an output run sample for sample with the inputs.

    Lines take the inputs' sample clock, and begin with its first edge; few devices have a start trigger for them.

    A converter of delta-sigma kind takes no sample clock of another one: it divides their timebase, from their sync pulse on.

    Raises
    ------
    AttemptError
        `no_route`, where it would then have another rate.
    """
    # A chassis with several timing engines names its terminals when one of them is reserved.
    inputs.control(TaskMode.TASK_RESERVE)
    clock = settings.clock or inputs.timing.samp_clk_term
    try:
        task.timing.cfg_samp_clk_timing(rate, source=clock, **timing)
        task.control(TaskMode.TASK_VERIFY)
    except DaqError as refused:
        if output.kind == "digital" or settings.clock or int(refused.error_code) not in _NOT_SHARED:
            raise
        try:
            timebase, pulse = inputs.timing.samp_clk_timebase_term, inputs.timing.sync_pulse_term
        except DaqError:  # no delta-sigma inputs: the first refusal tells more
            raise refused from None
        task.timing.cfg_samp_clk_timing(rate, **timing)
        task.timing.samp_clk_timebase_src, task.timing.sync_pulse_src = timebase, pulse
    if output.kind != "digital":
        start = settings.trigger or inputs.triggers.start_trigger.term
        task.triggers.start_trigger.cfg_dig_edge_start_trig(start)
        task.control(TaskMode.TASK_VERIFY)
    got = float(task.timing.samp_clk_rate)
    if not np.isclose(got, rate, rtol=1e-9):
        raise AttemptError(
            "no_route",
            f"output {output.name} must have the {rate:g} samples/s of the inputs, it has {got:g}: ask for a rate that both modules have",
        )


def rest_by_hand(task: Any, output: OutputSettings, level: float, *, timeout: float) -> None:
    """Bring an output without a clock to its safe value, one value after the other."""
    way = way_home(output, level, _BY_HAND) if level != output.safe else np.array([output.safe])
    for k, value in enumerate(way):
        if k:
            time.sleep(1.0 / _BY_HAND)
        write(task, output, np.array([value]), now=True, timeout=timeout)
