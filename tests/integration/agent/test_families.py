"""What labs have beside a chassis with a 9234 and a 9260, through the unmodified nidaqmx package: each kind of input and output."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from agent.drivers.nidaqmx.driver import Nidaqmx
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.errors import AttemptError
from agent.safety import Drive
from agent.settings import InputSettings, OutputSettings
from rig_simulator.bench import Bench
from rig_simulator.devices import Device
from rig_simulator.grpc_server import Server
from rig_simulator.sensors import Sensor


@contextmanager
def rig(devices: dict[str, str], *, daq: Mapping[str, str] = {}, **sensors: Sensor) -> Iterator[tuple[Bench, Nidaqmx]]:
    """Give a bench of devices (name -> model) and the agent's way to it; a sensor's name is its channel with _ for /."""
    bench = Bench(
        [Device(name=name, model=model, serial=i) for i, (name, model) in enumerate(devices.items(), 1)],
        sensors={name.replace("_", "/"): sensor for name, sensor in sensors.items()},
        speed=0.0,
    )
    server = Server(bench)
    hardware = Nidaqmx(
        NidaqmxSettings(server=f"127.0.0.1:{server.port}", deadline=10.0, chunk=0.05, **daq), rig="bench"
    )
    try:
        yield bench, hardware
    finally:
        hardware.close()
        server.close()


def measured(
    hardware: Nidaqmx, inputs: list[InputSettings], output: OutputSettings | None, rate: float = 2000.0
) -> tuple[Any, Drive]:
    """Return what was recorded of a sine at a third of the output's limit, and the drive."""
    with hardware.run(inputs, rate, seconds=0.2) as running:
        length = round(0.2 * running.rate)
        drive = None
        if output is not None:
            wave = lambda t: output.safe + output.amplitude / 3 * np.sin(2 * np.pi * 10 * t) ** 2  # noqa: E731
            drive = Drive(signal=wave, output=output, rate=running.rate, wait=0, length=length, repeats=1)
        running.prepare(length, drive)
        running.start()
        blocks = []
        while (block := running.read()).shape[1]:
            blocks.append(block)
        running.halt()
    if output is not None:
        hardware.rest(output)
    return np.concatenate(blocks, axis=1), drive


@pytest.mark.parametrize(
    ("devices", "given", "played"),
    [
        ({"cDAQ1Mod1": "NI 9234", "cDAQ1Mod2": "NI 9260"}, "cDAQ1Mod1/ai0", "cDAQ1Mod2/ao0"),
        ({"cDAQ1Mod1": "NI 9234", "cDAQ1Mod2": "NI 9263"}, "cDAQ1Mod1/ai0", "cDAQ1Mod2/ao0"),
        ({"cDAQ1Mod1": "NI 9239", "cDAQ1Mod2": "NI 9260"}, "cDAQ1Mod1/ai0", "cDAQ1Mod2/ao0"),
        ({"cDAQ1": "cDAQ-9171", "cDAQ1Mod1": "NI 9215", "cDAQ1Mod2": "NI 9263"}, "cDAQ1Mod1/ai0", "cDAQ1Mod2/ao0"),
        ({"Dev1": "PCIe-6321"}, "Dev1/ai0", "Dev1/ao0"),
        ({"Dev1": "PCI-6221"}, "Dev1/ai0", "Dev1/ao0"),
        ({"Dev1": "USB-6211"}, "Dev1/ai0", "Dev1/ao0"),
        ({"Dev1": "PXI-4461"}, "Dev1/ai0", "Dev1/ao0"),
    ],
)
def test_an_output_runs_sample_for_sample_with_the_inputs_of_its_family(devices, given, played) -> None:
    """By the sample clock, or, of delta-sigma converters, by timebase, sync pulse and start."""
    with rig(devices, **{given.replace("/", "_"): Sensor(loopback=played)}) as (bench, hardware):
        output = OutputSettings(name="valve", channel=played, amplitude=4.0)
        entry = InputSettings(name="in", channel=given, range=5.0)
        values, drive = measured(hardware, [entry], output)
        step = 20.0 / 2**15  # the coarsest converter, at its widest range
        assert np.abs(values[0] - drive.block(0, values.shape[1])).max() < step
        assert bench.levels[played] == 0.0
        assert not bench.tasks


@pytest.mark.parametrize(
    ("clock", "trigger", "refused"),
    [
        ("/cDAQ1/ai/SampleClock", "/cDAQ1/ai/StartTrigger", False),
        ("", "/cDAQ1/ai/StartTrigger", False),
        ("/cDAQ1Mod1/ai/SampleClock", "", True),  # modules have none of their own
        ("", "/cDAQ1Mod1/ai/StartTrigger", True),
    ],
)
def test_clock_and_trigger_of_the_settings_are_taken_and_nothing_else(clock, trigger, refused) -> None:
    devices = {"cDAQ1Mod1": "NI 9234", "cDAQ1Mod2": "NI 9263"}
    sensor = {"cDAQ1Mod1_ai0": Sensor(loopback="cDAQ1Mod2/ao0")}
    with rig(devices, daq={"clock": clock, "trigger": trigger}, **sensor) as (_, hardware):
        output = OutputSettings(name="valve", channel="cDAQ1Mod2/ao0", amplitude=4.0)
        entry = InputSettings(name="in", channel="cDAQ1Mod1/ai0", range=5.0)
        if not refused:
            values, drive = measured(hardware, [entry], output)
            assert np.abs(values[0] - drive.block(0, values.shape[1])).max() < 20.0 / 2**15
            return
        with pytest.raises(
            AttemptError, match=r"-89120.* name terminals that the device has, or leave them out"
        ) as caught:
            measured(hardware, [entry], output)
        assert caught.value.code == "no_route"


@pytest.mark.parametrize(
    ("model", "has", "lacks"),
    [("PCIe-6321", ("", "rse", "nrse", "diff"), ("pseudo",)), ("PXI-4461", ("", "diff", "pseudo"), ("rse", "nrse"))],
)
def test_every_wiring_is_asked_for_by_its_name(model, has, lacks) -> None:
    with rig({"Dev1": model}) as (_, hardware):
        for wiring in has:
            entry = InputSettings(name="in", channel="Dev1/ai0", wiring=wiring)
            assert hardware.trial([entry], rate=1000.0) == pytest.approx(1000.0)
        for wiring in lacks:
            entry = InputSettings(name="in", channel="Dev1/ai0", wiring=wiring)
            with pytest.raises(AttemptError, match=f"AI.TermCfg; Requested Value: {wiring.upper()}"):
                hardware.trial([entry], rate=1000.0)
    with rig({"cDAQ1Mod1": "NI 9234"}) as (_, hardware):
        entry = InputSettings(name="in", channel="cDAQ1Mod1/ai0", range=5.0, wiring="diff")
        with pytest.raises(AttemptError, match="Requested Value: DIFF"):
            hardware.trial([entry], rate=1652.0)


def test_an_output_without_a_clock_comes_to_rest_and_plays_no_drive() -> None:
    with rig({"Dev1": "USB-6008"}) as (bench, hardware):
        bench.levels["Dev1/ao0"] = 3.0
        output = OutputSettings(name="valve", channel="Dev1/ao0", amplitude=5.0, safe=1.0, soft_stop=0.05)
        hardware.rest(output)
        assert bench.levels["Dev1/ao0"] == 1.0
        hardware.rest(output, level=4.0)
        assert bench.levels["Dev1/ao0"] == 1.0
        with pytest.raises(
            AttemptError, match="valve must have a sample clock to play a drive, USB-6008 sets"
        ) as refused:
            measured(hardware, [InputSettings(name="in", channel="Dev1/ai0")], output)
        assert refused.value.code == "unsupported_setting"
        values, _ = measured(hardware, [InputSettings(name="in", channel="Dev1/ai0", wiring="rse")], None)
        assert values.shape == (1, 400)


def test_current_goes_out_and_comes_in() -> None:
    devices = {"cDAQ1Mod1": "NI 9203", "cDAQ1Mod2": "NI 9265"}
    with rig(devices, cDAQ1Mod1_ai0=Sensor(loopback="cDAQ1Mod2/ao0")) as (bench, hardware):
        output = OutputSettings(name="valve", channel="cDAQ1Mod2/ao0", kind="current", amplitude=0.02, safe=0.004)
        entry = InputSettings(name="in", channel="cDAQ1Mod1/ai0", kind="current", range=0.02)
        values, drive = measured(hardware, [entry], output)
        assert np.abs(values[0] - drive.block(0, values.shape[1])).max() < 0.02 / 2**15
        assert bench.levels["cDAQ1Mod2/ao0"] == 0.004
        wrong = OutputSettings(name="valve", channel="cDAQ1Mod2/ao0", amplitude=5.0)
        with pytest.raises(AttemptError, match="output valve must give a voltage, cDAQ1Mod2 does not"):
            hardware.rest(wrong)


@pytest.mark.parametrize("safe", [0.0, 1.0])
@pytest.mark.parametrize(
    ("devices", "given", "line"),
    [
        ({"cDAQ1Mod1": "NI 9215", "cDAQ1Mod2": "NI 9401"}, "cDAQ1Mod1/ai0", "cDAQ1Mod2/port0/line3"),
        ({"Dev1": "PCIe-6321"}, "Dev1/ai0", "Dev1/port0/line7"),
    ],
)
def test_a_line_goes_out_sample_for_sample_and_is_at_its_safe_value_afterwards(devices, given, line, safe) -> None:
    with rig(devices, **{given.replace("/", "_"): Sensor(loopback=line)}) as (bench, hardware):
        output = OutputSettings(name="shut", channel=line, kind="digital", amplitude=1.0, safe=safe)
        hardware.rest(output)
        assert bench.levels[line] == safe
        entry = InputSettings(name="in", channel=given, range=5.0)
        hardware.admit([entry], output)
        assert hardware.synchronisation([entry], output).following == ("shut",)
        with hardware.run([entry], 2000.0, seconds=0.2) as running:
            length = round(0.2 * running.rate)
            square = lambda t: (t * 40.0 % 1.0 < 0.3).astype(float)  # noqa: E731
            drive = Drive(signal=square, output=output, rate=running.rate, wait=10, length=length - 10, repeats=1)
            drive.check()
            running.prepare(length, drive)
            running.start()
            blocks = []
            while (block := running.read()).shape[1]:
                blocks.append(block)
            assert running.halt() == safe
        played = drive.block(0, length)
        assert set(played) == {0.0, 1.0}
        assert np.array_equal(np.round(np.concatenate(blocks, axis=1)[0], 2), played)
        bench.levels[line] = 1.0 - safe
        hardware.rest(output)
        assert bench.levels[line] == safe
        assert not bench.tasks


def test_a_line_that_software_sets_plays_no_drive() -> None:
    with rig({"Dev1": "USB-6008"}) as (bench, hardware):
        output = OutputSettings(name="shut", channel="Dev1/port0/line0", kind="digital", amplitude=1.0)
        hardware.rest(output)
        assert bench.levels["Dev1/port0/line0"] == 0.0
        with pytest.raises(AttemptError, match="On Demand") as refused:
            measured(hardware, [InputSettings(name="in", channel="Dev1/ai0", wiring="rse")], output)
        assert refused.value.code == "unsupported_setting"


def test_encoder_and_line_are_sampled_with_the_analog_inputs() -> None:
    devices = {"Dev1": "PCIe-6363"}
    sensors = {
        "Dev1_ai0": Sensor(loopback="Dev1/ao0"),
        "Dev1_ctr0": Sensor(loopback="Dev1/ao0", sensitivity=2.0),
        "Dev1_ctr1": Sensor(loopback="Dev1/ao0", sensitivity=1e-3),
        "Dev1_port0_line3": Sensor(loopback="Dev1/ao0"),
        "Dev1_port0_line5": Sensor(loopback="Dev1/ao0", sensitivity=0.5),
    }
    with rig(devices, **sensors) as (_, hardware):
        output = OutputSettings(name="valve", channel="Dev1/ao0", amplitude=6.0)
        inputs = [
            InputSettings(name="turn", channel="Dev1/ctr0", kind="encoder", unit="rad", pulses=1024),
            InputSettings(name="volts", channel="Dev1/ai0"),
            InputSettings(name="enabled", channel="Dev1/port0/line3", kind="digital"),
            InputSettings(name="again", channel="Dev1/port0/line5", kind="digital"),
            InputSettings(name="way", channel="Dev1/ctr1", kind="encoder", unit="m", distance=4e-6),
        ]
        values, drive = measured(hardware, inputs, output)
        played = drive.block(0, values.shape[1])
        turn, step = values[0], 2 * np.pi / 4096  # four edges of a pulse
        assert np.abs(turn / step - np.round(turn / step)).max() < 1e-6
        assert np.all((2 * played - turn > -1e-8) & (2 * played - turn < step + 1e-8))
        assert np.abs(values[1] - played).max() < 20 / 2**15
        assert np.array_equal(values[2], (played > 0.5).astype(float))
        assert np.array_equal(values[3], (played > 1.0).astype(float))
        assert np.abs(values[4] - 1e-3 * played).max() < 1e-6 + 1e-9
        for told in (lambda: measured(hardware, inputs[:1], None), lambda: hardware.synchronisation(inputs[:1])):
            with pytest.raises(AttemptError, match="an analog input must be measured, too"):
                told()


def test_a_counter_counts_the_edges_between_samples() -> None:
    """One edge for each whole step that the signal goes up, none for the way down, counted from the start."""
    with rig({"Dev1": "PCIe-6363"}, Dev1_ctr0=Sensor(loopback="Dev1/ao0", sensitivity=50.0)) as (_, hardware):
        output = OutputSettings(name="valve", channel="Dev1/ao0", amplitude=6.0)
        inputs = [
            InputSettings(name="volts", channel="Dev1/ai0"),
            InputSettings(name="pulses", channel="Dev1/ctr0", kind="counter", unit="mm", sensitivity=50.0),
        ]
        values, drive = measured(hardware, inputs, output)
        steps = np.floor(50.0 * drive.block(0, values.shape[1]) + 1e-9)
        rising = np.maximum(np.diff(steps, prepend=steps[0]), 0.0)
        assert np.array_equal(values[1], np.cumsum(rising))
        assert values[1, -1] == 400  # two humps of 2 V in 0.2 s, 2 of sin² at 10 Hz each: four ways up of 100 steps
    with (
        rig({"Dev1": "USB-6008"}) as (_, hardware),
        pytest.raises(AttemptError, match="On Demand"),  # its counter has no clock
    ):
        measured(hardware, [inputs[0], inputs[1]], None)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"wiring": "rse"}, "AI.TermCfg"),
        ({"range": 10.0}, "AI.Max"),
        ({"kind": "bridge", "range": 0.025}, "-200431"),
        ({"kind": "acceleration", "excitation": 0.004}, "AI.Excit.Val"),
        ({"channel": "cDAQ1Mod1/ai4"}, "-200170"),
        ({"kind": "thermocouple"}, "-200431"),
    ],
)
def test_what_a_module_lacks_is_told_in_words(change, says) -> None:
    with rig({"cDAQ1Mod1": "NI 9234"}) as (_, hardware):
        entry = InputSettings(**({"name": "in", "channel": "cDAQ1Mod1/ai0", "range": 5.0} | change))
        with pytest.raises(AttemptError, match=says.replace(".", r"\.")) as refused:
            measured(hardware, [entry], None)
        assert refused.value.code in {"unsupported_setting", "unknown_channel"}


@pytest.mark.parametrize("bridge", ["full", "half", "quarter"])
def test_bridges_of_every_kind_and_thermocouples_are_measured(bridge) -> None:
    devices = {"cDAQ1Mod1": "NI 9237", "cDAQ1Mod2": "NI 9213"}
    with rig(devices, cDAQ1Mod1_ai0=Sensor(offset=1e-3), cDAQ1Mod2_ai0=Sensor(offset=293.0)) as (_, hardware):
        entry = InputSettings(name="force", channel="cDAQ1Mod1/ai0", kind="bridge", bridge=bridge, range=0.025)
        values, _ = measured(hardware, [entry], None)
        assert values.mean() == pytest.approx(1e-3, abs=1e-8)
        warm = InputSettings(name="oil", channel="cDAQ1Mod2/ai0", kind="thermocouple", unit="K", thermocouple="J")
        values, _ = measured(hardware, [warm], None, rate=50.0)
        assert values.mean() == pytest.approx(293.0, abs=1e-3)
