"""What every driver promises (agent/drivers/interface.py), each against its simulated rig."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from agent.drivers.interface import Driver, Running, Samples
from agent.drivers.loading import load, names
from agent.errors import AttemptError
from agent.safety import Drive
from agent.settings import DeviceSettings, InputSettings, OutputSettings
from tests.integration.drivers.rigs import LOOPBACK, POSITION, VALVE, VARIANTS, Rig
from tests.support.patience import PATIENCE

BOTH = (LOOPBACK, POSITION)
STEP_OF_CONVERTER = 3e-6


def test_every_installed_driver_has_a_simulated_rig() -> None:
    assert {kind for kind, _ in VARIANTS.values()} == set(names())
    for name in names():
        assert issubclass(load(name), Driver)


@pytest.fixture(scope="module", params=VARIANTS)
def quick(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, Driver]]:
    """A rig whose samples come as fast as they are read, for tests that leave it as it was."""
    rig = Rig(tmp_path_factory.mktemp("rig"), request.param, speed=0.0)
    driver = rig.driver()
    yield rig, driver
    driver.close()
    rig.end()


@pytest.fixture(scope="module", params=VARIANTS)
def timed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A rig whose time passes as ours does."""
    made = Rig(tmp_path_factory.mktemp("rig"), request.param, speed=1.0)
    yield made
    made.end()


@pytest.fixture
def rig(timed: Rig) -> Iterator[Rig]:
    """The same, whole again after a test."""
    yield timed
    timed.process.send_signal(signal.SIGCONT)
    timed.say("plug cDAQ1Mod1")


def test_it_says_whose_clock_its_channels_share(quick) -> None:
    _, driver = quick
    told = driver.synchronisation(BOTH, VALVE).document()
    assert told["channels"] == ("loopback", "position", "valve")
    assert f"on the sample clock of {told['clock']}" in told["words"]
    assert told["clock"]


def sine(rate: float, samples: int, *, output: OutputSettings = VALVE) -> Drive:
    return Drive(signal=lambda t: 2 * np.sin(20 * t), output=output, rate=rate, wait=0, length=samples, repeats=1)


def step(rate: float, samples: int) -> Drive:
    return Drive(
        signal=lambda t: np.where(t >= 0, 1.0, 0.0), output=VALVE, rate=rate, wait=0, length=samples, repeats=1
    )


def all_of(running: Running) -> Samples:
    """Read to the end."""
    blocks = []
    while (block := running.read()).shape[1]:
        blocks.append(block)
    return np.concatenate(blocks, axis=1)


def failure(running: Running, got: list[Samples]) -> str:
    """Read until it fails, and return the word for it."""
    try:
        while True:
            got.append(running.read())
    except AttemptError as error:
        return error.code


def rested(driver: Driver) -> bool:
    """Do what an agent does when it starts."""
    try:
        driver.clean()
        driver.rest(VALVE)
    except AttemptError:
        return False
    return True


def until(condition: Callable[[], bool], *, within: float = PATIENCE) -> None:
    give_up_at = time.monotonic() + within
    while not condition():
        assert time.monotonic() < give_up_at
        time.sleep(0.05)


def test_it_says_what_is_there(quick) -> None:
    _, driver = quick
    (first, *_) = driver.devices()
    assert first["name"]
    assert first["simulated"] is True
    assert first["serial"] == "01A2B3C4"
    found = {(entry.name, entry.direction): entry.ranges for entry in driver.channels()}
    assert {name for name, direction in found if direction == "input"} == {f"cDAQ1Mod1/ai{i}" for i in range(8)}
    assert {name for name, direction in found if direction == "output"} == {"cDAQ1Mod2/ao0", "cDAQ1Mod2/ao1"}
    assert found["cDAQ1Mod1/ai0", "input"] == (10.0,)
    assert driver.description


def test_another_device_is_not_taken_for_this_one(quick) -> None:
    _, driver = quick
    (first, *_) = driver.devices()
    driver.check([DeviceSettings(name=first["name"], serial="1a2b3c4")])
    for device, code, says in (
        (DeviceSettings(name="other"), "unknown_device", "device other must be there"),
        (DeviceSettings(name=first["name"], serial="7"), "wrong_device", "serial of .* must be 7, got 01A2B3C4"),
        (DeviceSettings(name=first["name"], model="NI 1"), "wrong_device", "model of .* must be NI 1, got "),
    ):
        with pytest.raises(AttemptError, match=says) as caught:
            driver.check([device])
        assert caught.value.code == code


@pytest.mark.parametrize(
    ("entry", "code", "says"),
    [
        (InputSettings(name="a", channel="cDAQ1Mod1/ai9"), "unknown_channel", "input a: .*ai7, got cDAQ1Mod1/ai9"),
        (InputSettings(name="a", channel="cDAQ1Mod2/ao0"), "unknown_channel", "got cDAQ1Mod2/ao0"),
        (InputSettings(name="a", channel=""), "unknown_channel", "input a: channel must be one of"),
        (InputSettings(name="a", channel="cDAQ1Mod1/ai0", range=20.0), "unsupported_setting", "at most 10, got 20"),
    ],
)
def test_an_input_that_there_is_not_is_refused(quick, entry, code, says) -> None:
    _, driver = quick
    with pytest.raises(AttemptError, match=says) as caught:
        driver.admit([entry])
    assert caught.value.code == code


def test_an_output_that_there_is_not_is_refused(quick) -> None:
    _, driver = quick
    for channel in ("cDAQ1Mod2/ao7", "cDAQ1Mod1/ai0"):
        with pytest.raises(AttemptError, match=f"output valve: channel must be one of .*, got {channel}"):
            driver.admit([], OutputSettings(name="valve", channel=channel, amplitude=1.0))


@pytest.mark.parametrize("rate", [1e9, 51201.0])
def test_a_rate_that_there_is_not_is_refused(quick, rate) -> None:
    rig, driver = quick
    with pytest.raises(AttemptError) as caught, driver.run(BOTH, rate, seconds=1.0):
        pytest.fail("it must not come so far")
    assert caught.value.code == "unsupported_setting"
    assert caught.value.what.startswith(f"sample rate {rate:g} of loopback and position")
    if rig.kind != "nidaqmx":  # whose channels say their device
        assert str(rig.settings.get("server", rig.settings.get("folder"))) in caught.value.what


@pytest.mark.parametrize("samples", [1, 7, 4955, 30_000])
def test_every_sample_comes_once_and_in_its_order(quick, samples) -> None:
    _, driver = quick
    with driver.run(BOTH, 1000.0, seconds=samples / 1000.0) as running:
        assert running.rate == pytest.approx(51200 / 31)
        drive = sine(running.rate, samples)
        running.prepare(samples, drive)
        running.start()
        values = all_of(running)
        assert running.read().shape == (2, 0)  # and it stays over
        assert running.halt() == VALVE.safe
    assert values.shape == (2, samples)
    assert values.dtype == np.float64
    assert np.abs(values[0] - drive.block(0, samples)).max() < STEP_OF_CONVERTER


def test_channels_come_in_the_order_they_were_asked_for(quick) -> None:
    _, driver = quick
    found = {}
    for inputs in (BOTH, BOTH[::-1], BOTH[1:]):
        with driver.run(inputs, 2000.0, seconds=0.5) as running:
            running.prepare(800, sine(running.rate, 800))
            running.start()
            values = all_of(running)
        found[len(found)] = dict(zip([entry.name for entry in inputs], values, strict=True))
    assert np.array_equal(found[0]["loopback"], found[1]["loopback"])
    assert np.abs(found[0]["position"] - found[2]["position"]).max() < STEP_OF_CONVERTER
    assert np.abs(found[0]["position"] - found[0]["loopback"]).max() > 0.1  # they differ


def test_a_run_without_a_drive_leaves_the_output_alone(quick) -> None:
    rig, driver = quick
    driver.rest(VALVE)
    with driver.run(BOTH, 1000.0, seconds=0.5) as running:
        running.prepare(500, None)
        running.start()
        assert all_of(running).shape == (2, 500)
        assert running.halt() is None
    assert rig.level() == 0.0


def test_a_run_that_is_left_in_the_middle_disturbs_no_other(quick) -> None:
    rig, driver = quick
    for _ in range(2):
        with driver.run(BOTH, 1000.0, seconds=20.0) as running:
            running.prepare(20_000, step(running.rate, 20_000))
            running.start()
            running.read()
    driver.rest(VALVE)
    assert rig.level() == 0.0
    with driver.run(BOTH, 1000.0, seconds=1.0) as running:
        drive = sine(running.rate, 1000)
        running.prepare(1000, drive)
        running.start()
        assert np.abs(all_of(running)[0] - drive.block(0, 1000)).max() < STEP_OF_CONVERTER


def test_a_drive_that_is_stopped_tells_where_it_stands(rig) -> None:
    driver = rig.driver()
    with driver.run(BOTH, 1000.0, seconds=60.0) as running:
        running.prepare(90_000, step(running.rate, 90_000))
        running.start()
        until(lambda: running.read()[0, -1] > 0.5)
        assert running.halt() == 1.0
    assert rig.level() == 1.0  # it holds what it played last
    driver.rest(VALVE, level=1.0)
    assert rig.level() == 0.0
    driver.close()


def test_a_device_that_goes_away_is_told_after_what_came_before(rig) -> None:
    driver = rig.driver()
    rig.say("unplug cDAQ1Mod1 900")
    got: list[Samples] = []
    with driver.run(BOTH, 1000.0, seconds=60.0) as running:
        drive = sine(running.rate, 90_000)
        running.prepare(90_000, drive)
        running.start()
        assert failure(running, got) == "device_gone"
    values = np.concatenate(got, axis=1)
    assert np.abs(values[0] - drive.block(0, values.shape[1])).max() < STEP_OF_CONVERTER
    driver.rest(VALVE)  # the output is on another module
    assert rig.level() == 0.0
    driver.close()


def test_samples_that_were_not_taken_in_time_are_told(rig) -> None:
    driver = rig.driver()
    with driver.run(BOTH, 1000.0, seconds=60.0) as running:
        running.prepare(90_000, None)
        running.start()
        running.read()
        rig.say("overrun")
        assert failure(running, []) == "overrun"
    driver.close()


@pytest.mark.parametrize("how", ["frozen", "killed"])
def test_hardware_that_does_not_answer_holds_nobody(rig, how) -> None:
    driver = rig.driver(deadline=1.0)
    driver.rest(VALVE)
    with driver.run(BOTH, 1000.0, seconds=60.0) as running:
        running.prepare(90_000, step(running.rate, 90_000))
        running.start()
        running.read()
        rig.process.send_signal(signal.SIGSTOP if how == "frozen" else signal.SIGKILL)
        assert failure(running, []) == "server_unreachable"
        with pytest.raises(AttemptError):
            driver.rest(VALVE)
    if how == "frozen":
        rig.process.send_signal(signal.SIGCONT)
    else:
        rig.end()
        rig.start()
    patient = rig.driver()
    until(lambda: rested(patient))
    assert rig.level() == 0.0
    patient.close()
    driver.close()


PROGRAM = """
import json, sys
from agent.drivers.loading import load
from tests.integration.drivers.rigs import VALVE
from tests.integration.drivers.test_conformance import BOTH, step
given = json.loads(sys.argv[1])
made = load(given["driver"])
driver = made(made.settings(**given), rig="bench-1")
with driver.run(BOTH, 1000.0, seconds=60.0) as running:
    running.prepare(90_000, step(running.rate, 90_000))
    running.start()
    while True:
        print(running.read().shape[1], flush=True)
"""


def driven_and_killed(rig: Rig) -> None:
    """Let a process drive the output to 1 V, and kill it in the middle."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, json.dumps(rig.settings)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert int(process.stdout.readline()) > 0
        until(lambda: rig.level() == 1.0)
        process.kill()


def test_the_next_agent_brings_to_rest_what_a_killed_one_has_left(rig) -> None:
    driven_and_killed(rig)
    driver = rig.driver()
    until(lambda: rested(driver))
    assert rig.level() == 0.0
    with driver.run(BOTH, 1000.0, seconds=1.0) as running:
        drive = sine(running.rate, 1000)
        running.prepare(1000, drive)
        running.start()
        assert np.abs(all_of(running)[0] - drive.block(0, 1000)).max() < STEP_OF_CONVERTER
    driver.close()
