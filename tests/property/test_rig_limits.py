"""Whatever a job asks for, and whenever it is stopped, no output of the rig leaves its limits: amplitude, slew, duration, safe value."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agent.drivers.nidaqmx.driver import Nidaqmx
from agent.drivers.nidaqmx.settings import NidaqmxSettings
from agent.drives import signal_of
from agent.errors import AttemptError
from agent.safety import Drive
from agent.settings import InputSettings, OutputSettings
from rig_simulator.bench import Bench
from rig_simulator.devices import Device, Task
from rig_simulator.grpc_server import Server

INPUT = InputSettings(name="in", channel="Dev1/ai0")
ROUNDING = 1e-9
FURTHEST = 12.0
"""V, between a signal (at most 9 V) and a safe value (3 V)."""


class WatchedBench(Bench):
    """A rig whose time the test sets, and which remembers all that its output has played."""

    time, tick = 0.0, 0.0

    def _now(self) -> float:
        self.time += self.tick
        return self.time

    def stop(self, task: Task) -> None:
        if task.kind == "AO" and task.state == "running":
            self.played.append((task.rate, task.written[0, : self.acquired(task)].copy()))
        super().stop(task)


@pytest.fixture(scope="module")
def rig() -> Iterator[tuple[WatchedBench, Nidaqmx]]:
    bench = WatchedBench(
        [
            Device(name="Dev1", model="PCIe-6363", serial=1),
        ]
    )
    server = Server(bench)
    hardware = Nidaqmx(NidaqmxSettings(server=f"127.0.0.1:{server.port}", deadline=60.0), rig="bench")
    yield bench, hardware
    hardware.close()
    server.close()


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


amplitude = numbers(-5.0, 5.0)
signals = st.one_of(
    st.fixed_dictionaries({"kind": st.just("step"), "amplitude": amplitude, "start": numbers(0.0, 0.2)}),
    st.fixed_dictionaries({"kind": st.just("sine"), "amplitude": amplitude, "frequency": numbers(0.1, 900.0)}),
    st.fixed_dictionaries(
        {
            "kind": st.just("chirp"),
            "amplitude": amplitude,
            "start_frequency": numbers(0.1, 50.0),
            "end_frequency": numbers(50.0, 900.0),
            "duration": numbers(0.05, 0.5),
        }
    ),
    st.builds(
        lambda a, f: {"kind": "multisine", "amplitude": a, "fundamental": f, "harmonics": [1, 2, 5]},
        numbers(-3.0, 3.0),
        numbers(1.0, 200.0),
    ),
    st.lists(amplitude, min_size=2, max_size=6).map(
        lambda values: {"kind": "sampled", "time": np.linspace(0.0, 0.3, len(values)).tolist(), "values": values}
    ),
)
outputs = st.builds(
    OutputSettings,
    name=st.just("valve"),
    channel=st.just("Dev1/ao0"),
    amplitude=numbers(3.0, 8.0),
    slew=st.sampled_from([300.0, 3e3, 1e5, np.inf]),
    duration=numbers(0.3, 2.0),
    soft_start=st.sampled_from([0.0, 0.02, 0.1]),
    soft_stop=st.sampled_from([0.0, 0.02, 0.1]),
    safe=numbers(-3.0, 3.0),
)


@st.composite
def jobs(draw: st.DrawFn) -> Drive:
    return Drive(
        signal=signal_of(draw(signals)),
        output=draw(outputs),
        rate=draw(numbers(200.0, 2000.0)),
        wait=draw(st.integers(0, 50)),
        length=draw(st.integers(2, 500)),
        repeats=draw(st.integers(1, 3)),
    )


def excess(drive: Drive) -> float:
    """Return the largest share of a limit that a drive would use."""
    output, u = drive.output, drive.block(0, drive.samples)
    slope = np.abs(np.diff(u, prepend=output.safe)).max() * drive.rate
    seconds = drive.length * drive.repeats / drive.rate
    return float(max(np.abs(u).max() / output.amplitude, slope / output.slew, seconds / output.duration))


@given(drive=jobs(), stopped=numbers(0.0, 1.2))
def test_no_job_exceeds_the_limits_of_an_output(
    rig: tuple[WatchedBench, Nidaqmx], drive: Drive, stopped: float
) -> None:
    bench, hardware = rig
    output = drive.output
    if excess(drive) > 1.0 + 1e-6:
        with pytest.raises(AttemptError) as refused:
            drive.check()
        assert refused.value.code == "drive_limit"
        return
    drive.check()
    bench.played, bench.tick, bench.levels = [], 0.0, {output.channel: output.safe}
    with hardware.run([INPUT], drive.rate, seconds=drive.samples / drive.rate) as running:
        running.prepare(drive.samples, drive)
        running.start()
        bench.time += stopped * drive.samples / drive.rate  # in the middle of it, or after its end
        level = running.halt()
    assert level == pytest.approx(bench.levels[output.channel], abs=1e-12)
    bench.tick = 10.0
    hardware.rest(output, level=level)

    before = output.safe
    for rate, played in bench.played:
        assert np.abs(played).max(initial=0.0) <= output.amplitude * (1 + ROUNDING)
        steps = np.abs(np.diff(played, prepend=before))
        assert steps.max(initial=0.0) * rate <= output.slew * (1 + ROUNDING)
        before = float(played[-1]) if played.size else before
    driven = bench.played[0][1][drive.wait :]
    assert driven.size <= output.duration * drive.rate * (1 + ROUNDING)
    t = np.arange(driven.size) / drive.rate
    soft = t < output.soft_start
    envelope = 0.5 - 0.5 * np.cos(np.pi * t / (output.soft_start or 1.0))
    assert np.all(np.abs(driven - output.safe)[soft] <= FURTHEST * envelope[soft] + ROUNDING)
    assert before == bench.levels[output.channel] == output.safe
