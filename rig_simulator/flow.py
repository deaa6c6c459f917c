"""How samples come about: what inputs take and outputs play, sample by sample, on one clock or on several."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rig_simulator import routing
from rig_simulator.devices import CONTINUOUS, FINITE, Channel, Device, Task
from rig_simulator.faults import DriverError
from rig_simulator.plant import Plant, PlantError
from rig_simulator.sensors import Converter, EdgesRun, EncoderRun, InputRun, LineRun, Sensor, SensorRun

Samples = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

INPUTS, OUTPUTS = frozenset({"AI", "CI", "DI"}), frozenset({"AO", "DO"})
FOLLOWERS = frozenset({"CI", "DI", "DO"})
"""What begins with the sample clock that it follows."""
_LONGEST_STEP = 20_000
"""Samples that are computed in one go, so that a fault on command is seen soon."""
_SLIP, _DRIFT = 3, 20e-6
"""Samples by which an output that shares no clock with the inputs begins late, and what share of them it loses."""


class Flow:
    """The samples of a rig's tasks; :class:`rig_simulator.bench.Bench` adds what a client asks of them."""

    devices: dict[str, Device]
    plant: Plant | None
    drives: dict[str, tuple[str, float]]
    sensors: dict[str, Sensor]
    speed: float
    tasks: dict[str, Task]
    levels: dict[str, float]
    _seed: int

    def _leader(self, task: Task) -> Task | None:
        return routing.leader(self.devices, self.tasks, task)

    def _clock(self, task: Task) -> Task | None:
        """Return the task of inputs by which a task counts its samples."""
        if task.kind == "AI":
            return task
        started = (t for t in self.tasks.values() if t.kind == "AI" and routing.started_by(self.devices, task, t))
        return self._leader(task) or next(started, None)

    def acquired(self, task: Task) -> int:
        """Return how many samples a task has taken or played."""
        if task.state != "running":
            return 0
        if self.speed > 0.0:
            count = int((self._now() - task.started) * task.rate)
        else:
            clock = self._clock(task)
            count = clock.made if clock else task.samples
        return min(count, task.samples) if task.mode == FINITE else count

    def done(self, task: Task) -> bool:
        """Say whether a task has nothing more to do."""
        if task.state != "running":
            return task.state == "idle"
        if self.speed == 0.0 and task.kind in INPUTS:
            return task.mode == FINITE and task.read >= task.samples
        return task.mode == FINITE and self.acquired(task) >= task.samples

    def available(self, task: Task) -> int:
        """Return how many samples wait to be read."""
        return max(self.acquired(task) - task.read, 0)

    def buffer_of(self, task: Task) -> int:
        """Return the size of a task's buffer as DAQmx chooses it: by the rate, or as it was asked for."""
        if task.buffer is not None:
            return task.buffer
        if task.mode == FINITE:
            return task.samples
        usual = 1_000 if task.rate <= 100 else 10_000 if task.rate <= 10_000 else 100_000
        return max(usual, task.samples)

    def _sensors(self, task: Task) -> list[InputRun]:
        rng = np.random.default_rng(self._seed)
        found: list[InputRun] = []
        for channel in task.channels:
            sensor = self.sensors.get(channel.physical)
            if channel.what == "edges":
                found.append(EdgesRun(sensor or Sensor()))
            elif channel.kind == "CI":
                found.append(EncoderRun(sensor or Sensor(), channel.step or 1.0))
            elif channel.kind == "DI":
                found.append(LineRun(sensor or Sensor()))
            else:
                converter = self._converter(channel)
                found.append(SensorRun(sensor or Sensor(noise=20e-6), converter, rate=task.rate, rng=rng))
        return found

    def _converter(self, channel: Channel) -> Converter:
        """Return the converter at the smallest range that holds what was asked for."""
        device = self.devices[channel.device]
        made, row = device.converter, device.family
        assert made is not None  # every device has one
        if channel.what == "thermocouple":
            return replace(made, range=2000.0)  # degrees, which the driver computes
        if row is None or len(row.ranges) < 2:
            return made
        wanted = max(abs(channel.lower), abs(channel.upper)) / channel.gain
        return replace(made, range=min(r for r in row.ranges if r >= wanted * (1 - 1e-9)))

    def _start_input(self, task: Task) -> None:
        for other in self.tasks.values():
            follows = other.kind in FOLLOWERS and self._leader(other) is task
            if other.state == "armed" and (follows or routing.started_by(self.devices, other, task)):
                other.state, other.started = "running", task.started
        task.run = None
        if self.plant is not None:
            finite = task.samples if task.mode == FINITE else None
            try:
                task.run = self.plant.start(task.rate, self._plant_drive(), samples=finite)
            except PlantError as error:
                raise DriverError(-200077, f"Simulated plant: {error}") from error

    def _plant_drive(self) -> Callable[[int, int], Samples]:
        assert self.plant is not None
        inputs = self.plant.inputs

        def drive(first: int, count: int) -> Samples:
            u = np.zeros((len(inputs), count))
            for physical, (name, gain) in self.drives.items():
                u[inputs.index(name)] += gain * self._played(physical, first, count)
            return u

        return drive

    def _played(self, physical: str, first: int, count: int) -> Samples:
        """Return what an output plays at samples of the inputs' clock; it holds its last value before and after."""
        for task in self.tasks.values():
            if task.kind not in OUTPUTS or task.state != "running":
                continue
            for row, channel in enumerate(task.channels):
                if channel.physical == physical and task.mode is not None:
                    number = np.arange(first, first + count)
                    return self._of_buffer(task, row, number if self._leader(task) else self._unled(task, number))
        return np.full(count, self.levels.get(physical, 0.0))

    def _unled(self, task: Task, number: Numbers) -> Numbers:
        """Return which samples a task with a clock of its own plays meanwhile: on one device the same, otherwise others."""
        for other in self.tasks.values():
            together = other.kind == "AI" and routing.started_by(self.devices, task, other)
            if together and not routing.drifts(self.devices, task, other):
                return number
        return np.asarray(np.maximum(np.floor(number * (1.0 - _DRIFT)).astype(np.int64) - _SLIP, 0))

    def _of_buffer(self, task: Task, row: int, number: Numbers) -> Samples:
        if task.mode == CONTINUOUS and task.regenerates:
            return np.asarray(task.written[row, number % task.written.shape[1]])
        last = task.total - 1
        if task.mode == FINITE:
            last = min(last, task.samples - 1)
        if number.size and number[-1] > last and (task.mode == CONTINUOUS or task.total < task.samples):
            task.fault = -200290
        values: Samples = task.written[row, np.clip(number, task.first, last) - task.first]
        if values.size:
            self.levels[task.channels[row].physical] = float(values[-1])
        return values

    def _take(self, task: Task, count: int) -> Samples:
        clock = self._clock(task)
        if task.mode is None or clock is None:
            return np.array(
                [run.deliver(np.zeros(count)) * c.gain for c, run in zip(task.channels, task.sensors, strict=True)]
            )
        while (missing := task.read + count - task.made) > 0:
            self._make(clock, min(missing, _LONGEST_STEP))
        whole = np.concatenate([np.zeros((len(task.channels), 0)), *task.queue], axis=1)
        task.queue = [whole[:, count:]]
        task.read += count
        return whole[:, :count]

    def _make(self, clock: Task, count: int) -> None:
        """Compute the next samples of a task of analog inputs, and of all that follow its clock."""
        moved = clock.run.advance(count) if clock.run is not None else np.zeros((0, count))
        followers = [
            t
            for t in self.tasks.values()
            if t.kind in {"CI", "DI"} and t.state == "running" and self._leader(t) is clock
        ]
        first = clock.made
        for task in (clock, *followers):
            task.queue.append(self._compute(task, moved, first, count))
            if task.made - task.read + count > max(self.buffer_of(task), 2 * _LONGEST_STEP) and task is not clock:
                task.fault, task.queue = -200279, []
            task.made += count
        self._forget_played(clock)

    def _compute(self, task: Task, moved: Samples, first: int, count: int) -> Samples:
        outputs = self.plant.outputs if self.plant is not None else ()
        rows = []
        for channel, run in zip(task.channels, task.sensors, strict=True):
            sensor = self.sensors.get(channel.physical)
            if sensor is not None and sensor.loopback:
                quantity = self._played(sensor.loopback, first, count)
            elif sensor is not None and sensor.output:
                quantity = moved[outputs.index(sensor.output)]
            else:
                quantity = np.zeros(count)
            rows.append(run.deliver(quantity) * channel.gain)
        return np.array(rows)

    def _forget_played(self, clock: Task) -> None:
        """Let go of output samples that have been played, but for the last one."""
        for task in self.tasks.values():
            streaming = task.kind in OUTPUTS and (task.mode == FINITE or not task.regenerates)
            if streaming and task.state == "running" and self._clock(task) is clock:
                over = min(clock.made, task.total) - 2 * _SLIP - 1 - task.first
                if over > 200_000:
                    task.written = task.written[:, over:].copy()
                    task.first += over

    def _now(self) -> float:
        return time.monotonic() * self.speed if self.speed > 0.0 else 0.0
