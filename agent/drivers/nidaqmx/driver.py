"""The rig through NI-DAQmx: the driver of this PC, or an NI gRPC Device Server; inputs and output on one clock, one start.

Values are volts as the module delivers them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import nidaqmx
from nidaqmx.constants import AcquisitionType
from nidaqmx.errors import DaqError

from agent.data_sheets import DataSheet
from agent.drivers.interface import Channel, Driver, Running
from agent.drivers.nidaqmx.deadline import channel
from agent.drivers.nidaqmx.errors import WITHOUT_SHEET, translated
from agent.drivers.nidaqmx.followers import MOST, Follower, groups
from agent.drivers.nidaqmx.inputs import FOLLOWERS, IEPE, KINDS, add_input
from agent.drivers.nidaqmx.outputs import add_output, check_span, rest_by_hand, write
from agent.drivers.nidaqmx.running import NidaqmxRunning, closing, mode
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.drivers.nidaqmx.sharing import led, one_clock, synchronised
from agent.drivers.nidaqmx.tls import refusal
from agent.drivers.synchronisation import Synchronisation, listed
from agent.errors import AttemptError
from agent.safety import way_home
from agent.settings import InputSettings, OutputSettings

_WHOLE = 2_000_000
"""Samples (of all channels) up to which a run is finite, and its drive is written before it starts."""
_HOME_RATE = 1000.0


class Nidaqmx(Driver):
    """The devices of a rig; the rig's name is part of the names of its tasks, by which what an earlier agent left is found."""

    settings = NidaqmxSettings
    kinds = KINDS
    following = FOLLOWERS

    def __init__(self, settings: NidaqmxSettings, *, rig: str) -> None:
        self._settings = settings
        self._channel = channel(settings) if settings.server else None
        word = "".join(letter if letter.isalnum() else "-" for letter in rig)
        self._input, self._output = f"servotune-{word}-in", f"servotune-{word}-out"

    @property
    def description(self) -> str:
        """How the hardware is reached."""
        return f"NI gRPC Device Server {self._settings.server}" if self._settings.server else "NI-DAQmx of this PC"

    def close(self) -> None:
        """Let go of the device server."""
        if self._channel is not None:
            self._channel.close()

    def devices(self) -> list[dict[str, Any]]:
        """Return the modules that are there."""
        try:
            with translated():
                listed = list(self._system().devices)
            return [entry for device in listed if (entry := self._entry(device)) is not None]
        except AttemptError as error:
            if self._channel is None or error.code != "server_unreachable":
                raise
            raise refusal(self._settings) or error from error

    def _entry(self, device: Any) -> dict[str, Any] | None:
        """Return what is known of a device; None of one that has gone since it was listed."""
        try:
            with translated():
                return {
                    "name": device.name,
                    "model": device.product_type,
                    "serial": f"{device.serial_num:08X}",
                    "simulated": bool(device.is_simulated),
                }
        except AttemptError as error:
            if error.code in {"device_gone", "unknown_device"}:
                return None
            raise

    def channels(self) -> list[Channel]:
        """Return the channels of all modules; an output tells no range before a task has it."""
        found = []
        with translated():
            for device in self._system().devices:
                inputs = device.ai_physical_chans.channel_names
                ranges = tuple(sorted({abs(limit) for limit in device.ai_voltage_rngs})) if inputs else ()
                found += [Channel(name=name, direction="input", ranges=ranges) for name in inputs]
                outputs = [*device.ao_physical_chans.channel_names, *device.do_lines.channel_names]
                found += [Channel(name=name, direction="output") for name in outputs]
                others = [*device.ci_physical_chans.channel_names, *device.di_lines.channel_names]
                found += [Channel(name=name, direction="input") for name in others]
        return found

    def _system(self) -> Any:
        if self._channel is None:
            return nidaqmx.system.System.local()
        return nidaqmx.system.System.remote(self._options("")["grpc_options"])

    def clean(self) -> None:
        """Clear the tasks that an agent of this rig has left on a device server; the driver of a PC does so by itself."""
        if self._channel is None:
            return
        with translated():
            for name in (self._input, self._output, *(self._follower(i) for i in range(MOST))):
                self._task(name).close()

    def rest(self, output: OutputSettings, *, level: float | None = None) -> None:
        """Bring an output to its safe value, softly where it is known where it stands."""
        start = output.safe if level is None else level
        with translated(f"output {output.name} ({output.channel})"), self._task(self._output) as task:
            device = self.device_of(output.channel)
            add_output(task, output, device)
            if output.kind == "digital" or not device.ao_samp_clk_supported:
                rest_by_hand(task, output, start, timeout=self._settings.deadline)
                return
            task.timing.cfg_samp_clk_timing(_HOME_RATE, sample_mode=AcquisitionType.FINITE, samps_per_chan=4)
            way = way_home(output, start, float(task.timing.samp_clk_rate))
            task.timing.cfg_samp_clk_timing(_HOME_RATE, sample_mode=AcquisitionType.FINITE, samps_per_chan=way.size)
            write(task, output, way, now=False, timeout=self._settings.deadline)
            task.start()
            task.wait_until_done(way.size / _HOME_RATE + self._settings.deadline)
            task.stop()

    def synchronisation(self, inputs: Sequence[InputSettings], output: OutputSettings | None = None) -> Synchronisation:
        """Say whose clock a run has, which channels are led to it, and which are taken in turn."""
        with translated():
            return synchronised(self.device_of, inputs, output)

    def data_sheet(self, entry: InputSettings) -> DataSheet | None:
        """Read the data sheet in an IEPE sensor; its supply is off for that, and the sensor has to settle afterwards."""
        if entry.kind not in IEPE:
            return None
        with translated():
            physical = self.device_of(entry.channel).ai_physical_chans[entry.channel.strip("/")]
            try:
                physical.configure_teds()
            except DaqError as error:
                if int(error.error_code) in WITHOUT_SHEET:
                    return None
                raise
            return DataSheet.of(bytes(physical.teds_bit_stream))

    def admit(self, inputs: Sequence[InputSettings], output: OutputSettings | None = None) -> None:
        """Make sure that the channels are there, and that their ranges and the limits of the output are."""
        super().admit(inputs, output)
        if output is not None and output.kind != "digital":
            with translated():
                check_span(output, self.device_of(output.channel))

    def trial(self, inputs: Sequence[InputSettings], output: OutputSettings | None = None, *, rate: float) -> float:
        """Let the driver judge and reserve what a run would take; nothing is started."""
        self.admit(inputs, output)
        with self.run(inputs, rate, seconds=1.0) as running:
            assert isinstance(running, NidaqmxRunning)
            running.verify(output)
            return running.rate

    @contextmanager
    def run(self, inputs: Sequence[InputSettings], rate: float, *, seconds: float) -> Iterator[Running]:
        """Prepare the inputs; the rate that the hardware really has is then known."""
        analog = led(inputs)
        following = groups([entry for entry in inputs if entry.kind in FOLLOWERS])
        if len(following) > MOST:
            detail = f"encoders and counters of one run must be at most {MOST}, less one for digital lines, got {len(following)}"
            raise AttemptError("unsupported_setting", detail)
        with ExitStack() as stack:
            rate_of = f"sample rate {rate:g} of {listed([entry.name for entry in inputs])}"
            with translated(rate_of), one_clock(self.device_of, inputs):
                task = stack.enter_context(closing(self._task(self._input)))
                for entry in analog:
                    with translated(f"input {entry.name}"):
                        add_input(task, entry)
                followers = [
                    Follower(stack.enter_context(closing(self._task(self._follower(i)))), entries)
                    for i, entries in enumerate(following)
                ]
                finite = rate * seconds * len(inputs) <= _WHOLE
                task.timing.cfg_samp_clk_timing(rate, sample_mode=mode(finite=finite), samps_per_chan=1000)
                actual = float(task.timing.samp_clk_rate)
            yield NidaqmxRunning(
                self,
                self._settings,
                stack,
                task,
                inputs=inputs,
                followers=followers,
                asked=rate,
                rate=actual,
                finite=finite,
            )

    def device_of(self, channel: str) -> Any:
        """Return the device of a physical channel."""
        return self._system().devices[channel.strip("/").partition("/")[0]]

    def _follower(self, number: int) -> str:
        return f"{self._input}-{number}"

    def output_task(self) -> Any:
        """Return the task of the outputs."""
        return self._task(self._output)

    def _task(self, name: str) -> Any:
        return nidaqmx.Task(name, **self._options(name))

    def _options(self, name: str) -> dict[str, Any]:
        if self._channel is None:
            return {}
        return {"grpc_options": nidaqmx.GrpcSessionOptions(self._channel, name)}
