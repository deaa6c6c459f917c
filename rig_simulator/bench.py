"""Devices and tasks as a driver has them: channels, sample clock, start trigger, buffers, and faults on command.

It knows neither gRPC nor C: two front doors (:mod:`rig_simulator.grpc_server`, :mod:`rig_simulator.driver_library`) turn
calls into these methods, and :class:`DriverError` into what each of them calls an error.
"""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rig_simulator.devices import CONTINUOUS, FINITE, Channel, Device, Task, expand
from rig_simulator.faults import DriverError
from rig_simulator.plant import Plant, PlantError
from rig_simulator.sensors import Sensor, SensorRun

Samples = npt.NDArray[np.float64]

_TERMINAL = re.compile(r"a[io]/(sampleclock|starttrigger)|pfi\d+")

_LONGEST_STEP = 20_000
"""Samples that are computed in one go, so that a fault on command is seen soon."""


class Bench:
    """A rig: devices, what is connected to them, and the tasks of whoever uses it.

    Parameters
    ----------
    devices : sequence of Device
    plant : Plant, optional
    drives : mapping
        Physical output -> (input of the plant, what 1 V is there).
    sensors : mapping
        Physical input -> sensor.
    speed : float
        Simulated seconds in one of the clock; 0: time passes as samples are read.
    seed : int
        Of the noise.
    """

    def __init__(
        self,
        devices: Sequence[Device],
        *,
        plant: Plant | None = None,
        drives: Mapping[str, tuple[str, float]] | None = None,
        sensors: Mapping[str, Sensor] | None = None,
        speed: float = 1.0,
        seed: int = 1,
    ) -> None:
        self.devices = {device.name: device for device in devices}
        self.plant, self.drives, self.sensors = plant, dict(drives or {}), dict(sensors or {})
        self.speed, self._seed = speed, seed
        self.tasks: dict[str, Task] = {}
        self.levels: dict[str, float] = {}
        """Physical output -> V at which it stands: a module holds its last value."""
        self.lock = threading.RLock()
        self.awake = threading.Event()
        self.awake.set()
        self._unnamed = 0
        self._unplug_after: dict[str, int] = {}
        self._stuck = False

    # Faults on command

    def unplug(self, device: str, *, after: int = 0) -> None:
        """Take a device away, at once or when a run of its inputs has come to some sample."""
        if device not in self.devices:
            raise ValueError(f"device must be one of {', '.join(self.devices)}, got {device!r}")
        if after:
            self._unplug_after[device] = after
        else:
            self.devices[device].present = False

    def plug(self, device: str) -> None:
        """Bring a device back."""
        self._unplug_after.pop(device, None)
        self.devices[device].present = True

    def overrun(self) -> None:
        """Let the next read come too late for the buffer."""
        self._stuck = True

    # Tasks

    def create(self, name: str) -> Task:
        """Make a task; one without a name gets one."""
        with self.lock:
            if not name:
                self._unnamed += 1
                name = f"_unnamedTask<{self._unnamed}>"
            if name in self.tasks:
                raise DriverError(-200089, f"Task Name: {name}")
            self.tasks[name] = Task(name=name)
            return self.tasks[name]

    def task(self, name: str) -> Task:
        """Return a task."""
        found = self.tasks.get(name)
        if found is None:
            raise DriverError(-200088, f"Task Name: {name}")
        return found

    def device(self, name: str) -> Device:
        """Return a device that is there."""
        found = self.devices.get(name)
        if found is None:
            raise DriverError(-200220, f"Device Specified: {name}")
        if not found.present:
            raise DriverError(-201003, f"Device: {name}")
        return found

    def add_channels(
        self, task: Task, kind: str, physical: str, label: str, *, usage: int, lower: float, upper: float, gain: float
    ) -> None:
        """Add channels to a task; ``physical`` may be a list or a range."""
        names = expand(physical)
        for i, name in enumerate(names):
            device, _, number = name.partition("/")
            found = self.device(device)
            count = found.inputs if kind == "AI" else found.outputs
            if not (number[:2] == kind.lower() and number[2:].isdigit() and int(number[2:]) < count):
                raise DriverError(-200170, f"Physical Channel Name: {number}\nDevice: {device}")
            shown = name if not label else label if len(names) == 1 else f"{label}{i}"
            task.channels.append(
                Channel(name=shown, physical=name, kind=kind, usage=usage, lower=lower, upper=upper, gain=gain)
            )

    def set_clock(self, task: Task, *, rate: float, source: str, mode: int, samples: int) -> None:
        """Time a task; the rate becomes one that the device has."""
        if not task.channels:
            raise DriverError(-200428, f"Task Name: {task.name}")
        external = self._clock_of(source)
        task.rate = external.rate if external else self.device(task.device).coerce(rate)
        task.mode, task.samples, task.clock = mode, samples, source

    def terminal(self, task: Task, what: str) -> str:
        """Return the name of a task's internal terminal, SampleClock or StartTrigger."""
        return f"/{self.devices[task.device].timed_by}/{task.kind.lower()}/{what}"

    def _is(self, terminal: str, task: Task, what: str) -> bool:
        """Say whether a terminal is that of a task, however it is written."""
        return terminal.strip("/").lower() == self.terminal(task, what).strip("/").lower()

    def _clock_of(self, source: str) -> Task | None:
        """Return the input task whose sample clock a terminal is."""
        return next((t for t in self.tasks.values() if t.kind == "AI" and self._is(source, t, "SampleClock")), None)

    def _check_terminals(self, task: Task) -> None:
        """Refuse a clock or a trigger from a terminal that no device has, as a driver does when a task is started."""
        devices = {device.timed_by.lower() for device in self.devices.values()}
        for terminal in filter(None, (task.clock, task.trigger)):
            device, _, rest = terminal.strip("/").lower().partition("/")
            if terminal.lower() != "onboardclock" and not (device in devices and _TERMINAL.fullmatch(rest)):
                raise DriverError(-89120, f"Source Terminal: {terminal}\nTask Name: {task.name}")

    def start(self, task: Task) -> None:
        """Start a task, or arm it where it waits for another's start."""
        with self.lock:
            if not task.channels:
                raise DriverError(-200428, f"Task Name: {task.name}")
            self.device(task.device)
            self._check_terminals(task)
            for other in self.tasks.values():
                busy = other.state in {"armed", "running"} and not self.done(other)
                if other is not task and other.kind == task.kind and busy and other.device == task.device:
                    raise DriverError(-50103, f"Task Name: {task.name}")
            if task.kind == "AO" and not task.written.size:
                raise DriverError(-200462, f"Task Name: {task.name}")
            task.read, task.fault = 0, None
            if task.trigger:
                task.state = "armed"
                return
            task.state, task.started = "running", self._now()
            if task.kind == "AI":
                self._start_input(task)

    def _start_input(self, task: Task) -> None:
        for other in self.tasks.values():
            if other.state == "armed" and self._is(other.trigger, task, "StartTrigger"):
                other.state, other.started = "running", task.started
        rng = np.random.default_rng(self._seed)
        plain = Sensor(noise=20e-6)
        task.sensors = [
            SensorRun(
                self.sensors.get(channel.physical, plain),
                self.devices[channel.device].converter,
                rate=task.rate,
                rng=rng,
            )
            for channel in task.channels
        ]
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
        """Return what an output plays at samples of the common clock; it holds its last value before and after."""
        for task in self.tasks.values():
            if task.kind != "AO" or task.state != "running" or not self._clock_of(task.clock):
                continue
            for row, channel in enumerate(task.channels):
                if channel.physical == physical:
                    return self._of_buffer(task, row, first, count)
        return np.full(count, self.levels.get(physical, 0.0))

    def _of_buffer(self, task: Task, row: int, first: int, count: int) -> Samples:
        number = np.arange(first, first + count)
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

    def acquired(self, task: Task) -> int:
        """Return how many samples a task has taken or played."""
        if task.state != "running":
            return 0
        if self.speed > 0.0:
            count = int((self._now() - task.started) * task.rate)
        else:
            clock = task if task.kind == "AI" else self._clock_of(task.clock)
            count = clock.read if clock else task.samples
        return min(count, task.samples) if task.mode == FINITE else count

    def done(self, task: Task) -> bool:
        """Say whether a task has nothing more to do."""
        if task.state != "running":
            return task.state == "idle"
        if self.speed == 0.0 and task.kind == "AI":
            return task.mode == FINITE and task.read >= task.samples
        return task.mode == FINITE and self.acquired(task) >= task.samples

    def available(self, task: Task) -> int:
        """Return how many samples wait to be read."""
        return max(self.acquired(task) - task.read, 0)

    def read(
        self, task: Task, count: int, timeout: float, *, cancelled: Callable[[], bool] = lambda: False
    ) -> tuple[int, Samples]:
        """Return (status, samples of shape (channels, n)); status -200284 when fewer came in time."""
        if task.state == "idle":
            self.start(task)
        until = time.monotonic() + timeout if timeout >= 0.0 else math.inf
        while True:
            self.awake.wait()
            with self.lock:
                have, wanted = self._look(task, count)
                if have >= wanted:
                    return 0, self._take(task, wanted)
                if time.monotonic() >= until or cancelled():
                    return -200284, self._take(task, have)
            time.sleep(0.001)

    def _look(self, task: Task, count: int) -> tuple[int, int]:
        """Return how many samples there are and how many are wanted, or find what is wrong."""
        have = self.available(task)
        if self.speed == 0.0:
            left = task.samples - task.read if task.mode == FINITE else max(count, 0)
            have = left if count < 0 else min(count, left)
        wanted = count if count >= 0 else (task.samples - task.read if task.mode == FINITE else have)
        after = self._unplug_after.get(task.device)
        if after is not None and task.read + have >= after:
            self.devices[task.device].present = False
        if not self.devices[task.device].present:
            raise DriverError(-201003, f"Device: {task.device}\nTask Name: {task.name}", read=0)
        if self._stuck or (self.speed > 0.0 and have > self.buffer_of(task)):
            self._stuck = False
            task.state = "over"
            raise DriverError(-200279, f"Task Name: {task.name}", read=0)
        if task.mode == FINITE and task.read + wanted > task.samples and task.read + have >= task.samples:
            raise DriverError(-200278, f"Task Name: {task.name}", read=0)
        return have, wanted

    def buffer_of(self, task: Task) -> int:
        """Return the size of a task's buffer as DAQmx chooses it: by the rate, or as it was asked for."""
        if task.buffer is not None:
            return task.buffer
        if task.mode == FINITE:
            return task.samples
        usual = 1_000 if task.rate <= 100 else 10_000 if task.rate <= 10_000 else 100_000
        return max(usual, task.samples)

    def _take(self, task: Task, count: int) -> Samples:
        steps = [min(_LONGEST_STEP, count - first) for first in range(0, count, _LONGEST_STEP)]
        return np.concatenate([self._compute(task, step) for step in steps or [0]], axis=1)

    def _compute(self, task: Task, count: int) -> Samples:
        outputs = self.plant.outputs if self.plant is not None else ()
        moved = task.run.advance(count) if task.run is not None else np.zeros((0, count))
        rows = []
        for channel, run in zip(task.channels, task.sensors, strict=True):
            sensor = self.sensors.get(channel.physical)
            if sensor is not None and sensor.loopback:
                quantity = self._played(sensor.loopback, task.read, count)
            elif sensor is not None and sensor.output:
                quantity = moved[outputs.index(sensor.output)]
            else:
                quantity = np.zeros(count)
            rows.append(run.volts(quantity) * channel.gain)
        task.read += count
        self._forget_played(task)
        return np.array(rows)

    def _forget_played(self, clock: Task) -> None:
        """Let go of output samples that have been played, but for the last one."""
        for task in self.tasks.values():
            streaming = task.kind == "AO" and (task.mode == FINITE or not task.regenerates)
            if streaming and task.state == "running" and self._clock_of(task.clock) is clock:
                over = min(clock.read, task.total) - 1 - task.first
                if over > 200_000:
                    task.written = task.written[:, over:].copy()
                    task.first += over

    def write(self, task: Task, data: Samples, *, auto_start: bool) -> int:
        """Put samples of shape (channels, n) into the buffer of an output task; without a clock, on the output."""
        with self.lock:
            self.awake.wait()
            for channel, row in zip(task.channels, data, strict=True):
                self.device(channel.device)
                if row.size and (row.max() > channel.upper or row.min() < channel.lower):
                    raise DriverError(-200561, f"Channel Name: {channel.name}\nTask Name: {task.name}")
            if task.fault is not None:
                raise DriverError(task.fault, f"Task Name: {task.name}")
            if task.mode is None:
                for channel, row in zip(task.channels, data, strict=True):
                    self.levels[channel.physical] = float(row[-1])
            elif task.written.size and task.state in {"armed", "running"}:
                task.written = np.concatenate([task.written, data], axis=1)
            else:
                task.written, task.first = data.copy(), 0
            if auto_start and task.mode is not None:
                self.start(task)
            return int(data.shape[1])

    def wait(self, task: Task, timeout: float, *, cancelled: Callable[[], bool] = lambda: False) -> None:
        """Wait for the end of a task."""
        until = time.monotonic() + timeout if timeout >= 0.0 else math.inf
        while not self.done(task):
            self.awake.wait()
            self.device(task.device)
            if time.monotonic() >= until or cancelled():
                raise DriverError(-200560, f"Task Name: {task.name}")
            time.sleep(0.001)

    def stop(self, task: Task) -> None:
        """Stop a task; an output stays where it is."""
        with self.lock:
            if task.kind == "AO" and task.state == "running" and task.written.size:
                played = self.acquired(task)
                for row, channel in enumerate(task.channels):
                    if played > 0:
                        number = min(max(played - 1 - task.first, 0), task.written.shape[1] - 1)
                        self.levels[channel.physical] = float(task.written[row, number])
            task.state = "idle"

    def clear(self, name: str) -> None:
        """Forget a task."""
        with self.lock:
            self.stop(self.task(name))
            del self.tasks[name]

    def _now(self) -> float:
        return time.monotonic() * self.speed if self.speed > 0.0 else 0.0
