"""Runs and ways home on a bench, as the program of a controller or of a data logger does them.

Its front doors are :mod:`rig_simulator.opcua_server` and :mod:`rig_simulator.file_writer`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rig_simulator.bench import RESERVE, Bench
from rig_simulator.channels import CALLS
from rig_simulator.devices import FINITE, Task
from rig_simulator.faults import DriverError

Samples = npt.NDArray[np.float64]

_RANGE = 10.0
"""V of a channel of no known family."""
_WORDS = {
    -50103: "device_busy",
    -200077: "unsupported_setting",
    -200170: "unknown_channel",
    -200279: "overrun",
    -200290: "underrun",
    -200561: "drive_limit",
    -201003: "device_gone",
}


class ControllerError(Exception):
    """What the program cannot do: a word, and a sentence."""

    def __init__(self, code: str, detail: str) -> None:
        super().__init__(detail)
        self.code = code

    @classmethod
    def of(cls, error: DriverError) -> ControllerError:
        """Return what a failed call is for somebody who knows no numbers."""
        return cls(_WORDS.get(error.code, "controller_error"), " ".join(str(error).split()))


class Controller:
    """All inputs of a bench on one clock, and at most one output beside them.

    Parameters
    ----------
    bench : Bench
    """

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self._task: Task | None = None
        self._output: Task | None = None
        self._played = 0

    def ranges(self, direction: str) -> Mapping[str, float]:
        """Return channel -> largest magnitude, of those that measure or give volts; ``direction`` is "ai" or "ao"."""
        found: dict[str, float] = {}
        for device in self.bench.devices.values():
            row = device.family
            count, kind = (device.inputs, "voltage") if direction == "ai" else (device.outputs, "output voltage")
            if row is not None and kind not in row.kinds:
                continue
            if direction == "ai":
                limit = device.converter.range if device.converter else _RANGE
            else:
                limit = row.output_range[1] if row is not None else _RANGE
            found |= {f"{device.name}/{direction}{i}": limit for i in range(count)}
        return found

    @property
    def serial(self) -> str:
        """Number of the first device."""
        return f"{next(iter(self.bench.devices.values())).serial:08X}"

    def prepare(self, rate: float, inputs: Sequence[str]) -> float:
        """Time some inputs, and return the rate that they really have."""
        self.clear()
        self._task = task = self.bench.create("controller-in")
        usage = CALLS["CreateAIVoltageChan"].usage
        ranges = self.ranges("ai")
        for name in inputs:
            limit = ranges.get(name, _RANGE)
            self._call(task, "AI", name, usage=usage, lower=-limit, upper=limit)
        try:
            self.bench.set_clock(task, rate=rate, source="", mode=FINITE, samples=1000)
        except DriverError as error:
            raise ControllerError.of(error) from error
        return task.rate

    def arm(self, samples: int, output: str | None, values: Samples) -> None:
        """Set the length of a run, and what an output plays in it."""
        task = self._prepared()
        try:
            self.bench.set_clock(task, rate=task.rate, source="", mode=FINITE, samples=samples)
            if output is not None:
                self.bench.control(task, RESERVE)  # a chassis names its terminals then
                self._drive(output, values, rate=task.rate, inputs=task)
                assert self._output is not None
                self.bench.start(self._output)
        except DriverError as error:
            raise ControllerError.of(error) from error

    def start(self) -> None:
        """Let inputs and output begin."""
        try:
            self.bench.start(self._prepared())
        except DriverError as error:
            raise ControllerError.of(error) from error

    def take(self, most: int, *, within: float) -> Samples:
        """Return the next samples, shape (inputs, n), waiting some s for them; none when there are none yet or any more."""
        task = self._prepared()
        left = task.samples - task.read
        if not left:
            return np.zeros((len(task.channels), 0))
        try:
            return self.bench.read(task, min(most, left), within)[1]
        except DriverError as error:
            raise ControllerError.of(error) from error

    @property
    def played(self) -> int:
        """How many samples the output has played, also when it is stopped."""
        if self._output is not None and self._output.state == "running":
            self._played = self.bench.acquired(self._output)
        return self._played

    def stop(self) -> None:
        """Stop whatever runs; an output stays where it is."""
        _ = self.played
        for task in (self._output, self._task):
            if task is not None:
                self.bench.stop(task)

    def rest(self, output: str, way: Samples, *, rate: float) -> None:
        """Play the way to the safe value, to its end."""
        self.clear()
        try:
            self._drive(output, way, rate=rate)
            assert self._output is not None
            self.bench.start(self._output)
            self.bench.wait(self._output, way.size / rate + 60.0)
        except DriverError as error:
            raise ControllerError.of(error) from error
        finally:
            self.clear()

    def to_zero(self) -> None:
        """Bring all outputs to 0 V at once: what a controller does by itself that hears nothing any more."""
        self.clear()
        for name in self.bench.levels:
            self.bench.levels[name] = 0.0

    def clear(self) -> None:
        """Forget what was prepared."""
        self.stop()
        for task in (self._output, self._task):
            if task is not None:
                self.bench.clear(task.name)
        self._task = self._output = None
        self._played = 0

    def _drive(self, output: str, values: Samples, *, rate: float, inputs: Task | None = None) -> None:
        """Write what an output plays, by itself or sample for sample with the inputs."""
        self._output = task = self.bench.create("controller-out")
        device = self.bench.devices.get(output.partition("/")[0])
        row = device.family if device is not None else None
        lower, upper = row.output_range if row is not None else (-_RANGE, _RANGE)
        self._call(task, "AO", output, usage=CALLS["CreateAOVoltageChan"].usage, lower=lower, upper=upper)
        by_timebase = row is not None and row.output_clock == "timebase"
        source = "" if inputs is None or by_timebase else self.bench.terminal(inputs, "SampleClock")
        self.bench.set_clock(task, rate=rate, source=source, mode=FINITE, samples=values.size)
        if inputs is not None:
            task.trigger = self.bench.terminal(inputs, "StartTrigger")
            if by_timebase:
                task.timebase = self.bench.terminal(inputs, "SampleClockTimebase")
                task.sync_pulse = self.bench.terminal(inputs, "SyncPulse")
        self.bench.write(task, values[None, :], auto_start=False)

    def _call(self, task: Task, kind: str, name: str, *, usage: int, lower: float, upper: float) -> None:
        try:
            self.bench.add_channels(task, kind, name, "", usage=usage, lower=lower, upper=upper, gain=1.0)
        except DriverError as error:
            raise ControllerError.of(error) from error

    def _prepared(self) -> Task:
        if self._task is None:
            raise ControllerError("not_prepared", "a run must be prepared before it begins")
        return self._task
