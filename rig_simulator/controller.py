"""Runs and ways home on a bench, as the program of a controller or of a data logger does them.

Its front doors are :mod:`rig_simulator.opcua_server` and :mod:`rig_simulator.file_writer`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from rig_simulator.bench import Bench
from rig_simulator.channels import USAGES
from rig_simulator.devices import FINITE, Task
from rig_simulator.faults import DriverError

Samples = npt.NDArray[np.float64]

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
        """Return channel -> largest magnitude; ``direction`` is "ai" or "ao"."""
        return {
            f"{device.name}/{direction}{i}": device.converter.range
            for device in self.bench.devices.values()
            for i in range(device.inputs if direction == "ai" else device.outputs)
        }

    @property
    def serial(self) -> str:
        """Number of the first device."""
        return f"{next(iter(self.bench.devices.values())).serial:08X}"

    def prepare(self, rate: float, inputs: Sequence[str]) -> float:
        """Time some inputs, and return the rate that they really have."""
        self.clear()
        self._task = task = self.bench.create("controller-in")
        usage = USAGES["CreateAIVoltageChan"][1]
        ranges = self.ranges("ai")
        for name in inputs:
            limit = ranges.get(name, 10.0)
            self._call(task, "AI", name, usage=usage, limit=limit)
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
                self._drive(output, values, rate=task.rate, source=self.bench.terminal(task, "SampleClock"))
                assert self._output is not None
                self._output.trigger = self.bench.terminal(task, "StartTrigger")
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
            self._drive(output, way, rate=rate, source="")
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

    def _drive(self, output: str, values: Samples, *, rate: float, source: str) -> None:
        self._output = task = self.bench.create("controller-out")
        self._call(
            task, "AO", output, usage=USAGES["CreateAOVoltageChan"][1], limit=self.ranges("ao").get(output, 10.0)
        )
        self.bench.set_clock(task, rate=rate, source=source, mode=FINITE, samples=values.size)
        self.bench.write(task, values[None, :], auto_start=False)

    def _call(self, task: Task, kind: str, name: str, *, usage: int, limit: float) -> None:
        try:
            self.bench.add_channels(task, kind, name, "", usage=usage, lower=-limit, upper=limit, gain=1.0)
        except DriverError as error:
            raise ControllerError.of(error) from error

    def _prepared(self) -> Task:
        if self._task is None:
            raise ControllerError("not_prepared", "a run must be prepared before it begins")
        return self._task
