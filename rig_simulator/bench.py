"""Devices and tasks as a driver has them: channels, sample clock, start trigger, buffers, and faults on command.

It knows neither gRPC nor C: two front doors (:mod:`rig_simulator.grpc_server`, :mod:`rig_simulator.driver_library`) turn
calls into these methods, and :class:`DriverError` into what each of them calls an error.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rig_simulator import checks, routing
from rig_simulator.channels import Call, gain, steps
from rig_simulator.devices import FINITE, Channel, Device, Task, expand, written
from rig_simulator.faults import DriverError
from rig_simulator.flow import FOLLOWERS, INPUTS, OUTPUTS, Flow, Samples
from rig_simulator.plant import Plant
from rig_simulator.sensors import Sensor

_VERIFY, _COMMIT, RESERVE, _UNRESERVE, _ABORT = 2, 3, 4, 5, 6
"""nidaqmx.constants.TaskMode."""


class Bench(Flow):
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

    def create_channels(self, task: Task, call: Call, given: Mapping[str, Any]) -> None:
        """Add the channels that a call of the driver asks for; ``given`` are its arguments by name."""
        sensitivity = given.get("sensitivity")
        low, high = given.get("min_val", 0.0), given.get("max_val", 1.0 if call.subsystem == "DO" else 0.0)
        step, per_unit = steps(given) if call.what == "encoder" else (0.0, 1.0)
        factor = gain(
            units=given.get("units", 0), sensitivity=sensitivity, sensitivity_units=given.get("sensitivity_units", 0)
        )
        self.add_channels(
            task,
            call.subsystem,
            given[call.names[0]],
            given[call.names[1]],
            usage=call.usage,
            lower=low,
            upper=high,
            gain=per_unit if step else factor,
            what=call.what,
            given=given,
            step=step,
        )

    def add_channels(
        self,
        task: Task,
        kind: str,
        physical: str,
        label: str,
        *,
        usage: int,
        lower: float,
        upper: float,
        gain: float,
        what: str = "",
        given: Mapping[str, Any] | None = None,
        step: float = 0.0,
    ) -> None:
        """Add channels to a task; ``physical`` may be a list or a range."""
        what = what or ("output voltage" if kind == "AO" else "voltage")
        names = expand(physical)
        for i, name in enumerate(names):
            device, _, number = name.partition("/")
            found = self.device(device)
            checks.exists(found, kind, number)
            limits = (lower / gain, upper / gain)
            checks.channel(found, number, subsystem=kind, what=what, given=given or {}, limits=limits)
            shown = name if not label else label if len(names) == 1 else f"{label}{i}"
            task.channels.append(
                Channel(
                    name=shown,
                    physical=name,
                    kind=kind,
                    usage=usage,
                    lower=lower,
                    upper=upper,
                    gain=gain,
                    what=what,
                    step=step,
                )
            )

    def set_clock(self, task: Task, *, rate: float, source: str, mode: int, samples: int) -> None:
        """Time a task; the rate becomes one that the device has."""
        if not task.channels:
            raise DriverError(-200428, f"Task Name: {task.name}")
        devices = [self.device(name) for name in dict.fromkeys(entry.device for entry in task.channels)]
        for device in devices:
            checks.clock(device, task, source)
        task.asked, task.mode, task.samples, task.clock = rate, mode, samples, source
        external = self._leader(task)
        task.rate = external.rate if external else self.rate_of(task)

    def rate_of(self, task: Task) -> float:
        """Return the rate that a task has for the one that it was asked for: delta-sigma modules divide the fastest timebase."""
        if task.kind not in {"AI", "AO"}:
            return task.asked
        devices = [self.device(name) for name in dict.fromkeys(entry.device for entry in task.channels)]
        timebase = max((d.family.timebase for d in devices if d.family is not None), default=0.0)
        leading = self._leader(task)
        if leading is not None and task.timebase:
            timebase = self._timebase(leading)
        rates = [device.coerce(task.asked, most=checks.rate(device, task), timebase=timebase) for device in devices]
        return max(rates)

    def _timebase(self, task: Task) -> float:
        rows = [self.devices[entry.device].family for entry in task.channels]
        return max((row.timebase for row in rows if row is not None), default=0.0)

    def terminal(self, task: Task, what: str) -> str:
        """Return the name of a task's internal terminal."""
        return routing.terminal(self.devices, task, what)

    def control(self, task: Task, action: int) -> None:
        """Verify, reserve or commit a task, or let go of what it has reserved."""
        with self.lock:
            if action in {_VERIFY, _COMMIT, RESERVE}:
                self._check(task)
            if action in {_COMMIT, RESERVE}:
                routing.reserve(self.devices, self.tasks, task)
                task.reserved = True
            elif action in {_UNRESERVE, _ABORT}:
                task.reserved = False
                self.stop(task)

    def _check(self, task: Task) -> None:
        """Refuse what no device of the task has, as a driver does when a task is verified."""
        if not task.channels:
            raise DriverError(-200428, f"Task Name: {task.name}")
        if task.trigger and task.mode is None:
            raise DriverError(-200262, f"Task Name: {task.name}")
        for name in dict.fromkeys(entry.device for entry in task.channels):
            checks.timebase(self.device(name), task)
        routing.check(self.devices, task)
        if task.timebase:
            task.rate = self.rate_of(task)

    def start(self, task: Task) -> None:
        """Start a task, or arm it where it waits for another's start."""
        with self.lock:
            self._check(task)
            for other in self.tasks.values():
                busy = other.state in {"armed", "running"} and not self.done(other)
                if other is not task and busy and other.uses & task.uses:
                    raise DriverError(-50103, f"Task Name: {task.name}")
            routing.reserve(self.devices, self.tasks, task)
            if task.kind in OUTPUTS and task.mode is not None and not task.written.size:
                raise DriverError(-200462, f"Task Name: {task.name}")
            task.read, task.made, task.queue, task.fault = 0, 0, [], None
            if task.kind in INPUTS:
                task.sensors = self._sensors(task)
            if task.trigger or (task.kind in FOLLOWERS and task.mode is not None):
                task.state = "armed"
                return
            task.state, task.started = "running", self._now()
            if task.kind == "AI":
                self._start_input(task)

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
        if task.fault is not None:
            raise DriverError(task.fault, f"Task Name: {task.name}", read=0)
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

    def write(self, task: Task, given: npt.NDArray[Any], *, auto_start: bool) -> int:
        """Put samples of shape (channels, n) into the buffer of an output task; without a clock, on the output."""
        data = written(task, given)
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
                task.written, task.first = data, 0
            if auto_start and task.mode is not None:
                self.start(task)
            return int(data.shape[1])

    def is_done(self, task: Task) -> bool:
        """Answer whether a task is done; one whose device has gone, or that has failed, says so."""
        for name in dict.fromkeys(channel.device for channel in task.channels):
            self.device(name)
        if task.fault is not None:
            raise DriverError(task.fault, f"Task Name: {task.name}")
        return self.done(task)

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
            if task.kind in OUTPUTS and task.state == "running" and task.written.size:
                played = self.acquired(task)
                for row, channel in enumerate(task.channels):
                    if played > 0:
                        number = min(max(played - 1 - task.first, 0), task.written.shape[1] - 1)
                        self.levels[channel.physical] = float(task.written[row, number])
            task.state = "idle"
            if not task.reserved:
                task.engine = ""

    def clear(self, name: str) -> None:
        """Forget a task."""
        with self.lock:
            self.stop(self.task(name))
            del self.tasks[name]
