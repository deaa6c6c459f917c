"""Devices, tasks and rates as a driver has them."""

from __future__ import annotations

import numpy as np
import pytest

from rig_simulator.attributes import get
from rig_simulator.bench import Bench
from rig_simulator.commands import obey
from rig_simulator.description import DescriptionError, read
from rig_simulator.devices import FINITE, Device, expand
from rig_simulator.faults import DriverError


@pytest.mark.parametrize(
    ("asked", "got"),
    [(51200, 51200.0), (50000, 51200.0), (25600, 25600.0), (20000, 25600.0), (5000, 5120.0), (1000, 51200 / 31)],
)
def test_a_delta_sigma_module_takes_the_next_rate_that_it_has(asked, got) -> None:
    """NI 9234: 51.2 kS/s divided by 1 to 31 (NI 9234 datasheet, data rates)."""
    assert Device(name="Mod1", model="NI 9234", serial=1).coerce(asked) == pytest.approx(got)


def test_a_rate_beyond_the_module_is_refused() -> None:
    with pytest.raises(DriverError) as refused:
        Device(name="Mod1", model="NI 9234", serial=1).coerce(51201)
    assert refused.value.code == -200077


def test_names_of_channels_are_listed() -> None:
    assert expand("Dev1/ai0:2, Dev1/ai5") == ["Dev1/ai0", "Dev1/ai1", "Dev1/ai2", "Dev1/ai5"]
    assert expand("Dev1/ai1:Dev1/ai2") == ["Dev1/ai1", "Dev1/ai2"]
    with pytest.raises(DriverError):
        expand("Dev1/ai0:x")


def test_two_tasks_do_not_share_the_inputs_of_a_module() -> None:
    bench = Bench([Device(name="Mod1", model="NI 9234", serial=1, inputs=4)])
    tasks = [bench.create(name) for name in ("one", "two")]
    for task in tasks:
        bench.add_channels(task, "AI", "Mod1/ai0", "", usage=0, lower=-5, upper=5, gain=1.0)
        bench.set_clock(task, rate=5120, source="", mode=FINITE, samples=5120)
    bench.start(tasks[0])
    with pytest.raises(DriverError) as busy:
        bench.start(tasks[1])
    assert busy.value.code == -50103
    bench.clear("one")
    bench.start(tasks[1])


def chassis() -> Bench:
    return Bench(
        [
            Device(name="cDAQ1Mod1", model="NI 9234", serial=1, inputs=4),
            Device(name="cDAQ1Mod2", model="NI 9263", serial=2),
            Device(name="Dev1", model="PCIe-6321", serial=3),
        ]
    )


@pytest.mark.parametrize(
    ("terminal", "code"),
    [
        ("/cDAQ1/ai/SampleClock", None),
        ("/cdaq1/AI/sampleclock", None),
        ("/cDAQ1/PFI0", None),
        ("/Dev1/ai/StartTrigger", -89125),
        ("OnboardClock", None),
        ("/cDAQ1Mod1/ai/SampleClock", -89120),
        ("/cDAQ1Mod1/ai/StartTrigger", -89120),
        ("/cDAQ2/ai/SampleClock", -89120),
        ("/Dev1/ai/Clock", -89120),
    ],
)
def test_modules_of_a_chassis_have_no_terminals_of_their_own(terminal: str, code: int | None) -> None:
    """NI-DAQmx names the timing engines of a CompactDAQ chassis by the chassis; no line leads there from a board."""
    bench = chassis()
    task = bench.create("")
    bench.add_channels(task, "AO", "cDAQ1Mod2/ao0", "", usage=0, lower=-5, upper=5, gain=1.0)
    bench.set_clock(task, rate=5120, source="" if "Trigger" in terminal else terminal, mode=FINITE, samples=4)
    task.trigger = terminal if "Trigger" in terminal else ""
    bench.write(task, np.zeros((1, 4)), auto_start=False)
    if code is None:
        bench.start(task)
        return
    with pytest.raises(DriverError) as refused:
        bench.start(task)
    assert refused.value.code == code


def test_the_terminals_of_a_task_are_told() -> None:
    bench = chassis()
    for channel, expected in (("cDAQ1Mod1/ai0", "/cDAQ1/ai"), ("Dev1/ai0", "/Dev1/ai")):
        task = bench.create("")
        bench.add_channels(task, "AI", channel, "", usage=0, lower=-5, upper=5, gain=1.0)
        bench.control(task, 4)  # a chassis with several timing engines names its terminals when one is reserved
        assert get(bench, "Timing", task.name, 0x2F1B) == f"{expected}/SampleClock"
        assert get(bench, "Trig", task.name, 0x2F1E) == f"{expected}/StartTrigger"


def test_faults_come_on_command() -> None:
    bench = Bench([Device(name="Mod1", model="NI 9234", serial=1, inputs=4)])
    obey(bench, ["unplug", "Mod1"])
    with pytest.raises(DriverError, match="unplugged"):
        bench.device("Mod1")
    obey(bench, ["plug", "Mod1"])
    obey(bench, ["swap", "Mod1", "NI", "9239"])
    assert (bench.device("Mod1").model, bench.device("Mod1").serial) == ("NI 9239", 2)
    obey(bench, ["freeze"])
    assert not bench.awake.is_set()
    obey(bench, ["thaw"])
    for words in (["melt"], ["unplug", "Mod9"], ["unplug"]):
        with pytest.raises(ValueError, match="must be one of"):
            obey(bench, words)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("devices = []", "devices: List should have at least 1 item"),
        ("[[devices]]\nname = 'a'\ninput = 3", "devices.0.input: Extra inputs are not permitted"),
        ("[[devices]]\nname = 'a'\n[[drives]]\nchannel = 'a/ao0'\ninput = 'u'", "input must be one of the plant's"),
        ("[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a/ai0'\noutput = 'y'", "output must be one of the plant's"),
        ("[plant]\nsystem = 'none.json'\n[[devices]]\nname = 'a'", "none.json must be readable"),
        (
            "[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a/ai0'\nteds = {manufacturer = 3, model = 1, serial = 1}",
            "sensors.0.teds.manufacturer: Input should be greater than or equal to 17",
        ),
        ("[[", "must be TOML"),
        (
            "[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'b/ai0'",
            "sensors.0.channel: device must be one of a, got 'b/ai0'",
        ),
        ("[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a/ai4'", "must be one that a has .*, got 'a/ai4'"),
        ("[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a/ao0'", "must be one that a has .*, got 'a/ao0'"),
        ("[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a'", "must be one that a has .*, got 'a'"),
        (
            "[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a/ai0'\nloopback = 'b/ao0'",
            "sensors.0.loopback: device must be one of a, got 'b/ao0'",
        ),
        (
            "[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a/ai0'\n[[sensors]]\nchannel = 'a/ai0'",
            "sensors.1.channel: a channel must be connected once, got 'a/ai0' twice",
        ),
        ("[[devices]]\nname = 'a'\n[[devices]]\nname = 'a'", "must be given once, got 'a' twice"),
        ("[[devices]]\nname = 'a'\nmodel = 'NI 9243'", r"model of a must be in the table .*NI 9263.*, got 'NI 9243'"),
    ],
)
def test_a_description_that_makes_no_rig_is_refused(tmp_path, text, says) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(DescriptionError, match=says):
        read(path)


def test_a_description_may_put_a_data_sheet_into_a_sensor(tmp_path) -> None:
    path = tmp_path / "rig.toml"
    sheet = "teds = {manufacturer = 25, model = 352, letter = 'C', version = 33, serial = 4711, sensitivity = 0.0102}"
    path.write_text(f"[[devices]]\nname = 'a'\n[[sensors]]\nchannel = 'a/ai0'\n{sheet}\n[[sensors]]\nchannel = 'a/ai1'")
    bench = read(path)
    assert get(bench, "PhysicalChan", "a/ai0", 0x21DC) == 4711
    with pytest.raises(DriverError, match="No sensor with a data sheet"):
        get(bench, "PhysicalChan", "a/ai1", 0x21DC)
