"""What a driver knows: devices, channels, tasks, and the names of physical channels."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from rig_simulator.families import FAMILIES, Family
from rig_simulator.faults import DriverError
from rig_simulator.plant import Run
from rig_simulator.sensors import Converter, InputRun

Samples = npt.NDArray[np.float64]

_OF_CHASSIS = re.compile(r"(.+)Mod\d+")

FINITE, CONTINUOUS = 10178, 10123
"""nidaqmx.constants.AcquisitionType."""


@dataclass(slots=True, kw_only=True)
class Device:
    """A device or module; what is not given is what its family has, and a device of no known family takes whatever is given.

    ``divider`` is the largest by which a delta-sigma module divides its ``max_rate``, 0 for any rate. Modules that are named as
    a driver names those of a chassis (cDAQ1Mod2) have no terminals of their own: the timing engines are in the chassis.

    Raises
    ------
    ValueError
        For more channels, a wider range or a higher rate than the family has.
    """

    name: str
    model: str
    serial: int
    inputs: int = 0
    outputs: int = 0
    max_rate: float = 0.0
    divider: int = -1
    converter: Converter | None = None
    present: bool = True

    def __post_init__(self) -> None:
        row = self.family
        if row is None:
            self.max_rate, self.divider = self.max_rate or 51200.0, 31 if self.divider < 0 else self.divider
            self.converter = self.converter or Converter()
            return
        top, most = max(row.input_rate, row.output_rate), max(row.ranges, default=0.0)
        for what, given, limit in (
            ("inputs", self.inputs, row.inputs),
            ("outputs", self.outputs, row.outputs),
            ("max_rate", self.max_rate, top),
            ("range", self.converter.range if self.converter else 0.0, most or math.inf),
        ):
            if given > limit:
                raise ValueError(f"{what} of {self.name} must be at most {limit:g}, as {row.model} has, got {given:g}")
        if self.divider >= 0 and self.divider != row.divider:
            raise ValueError(f"divider of {self.name} must be {row.divider}, as {row.model} has, got {self.divider}")
        self.inputs, self.outputs = self.inputs or row.inputs, self.outputs or row.outputs
        self.max_rate, self.divider = self.max_rate or top, row.divider
        self.converter = self.converter or Converter(range=most or 10.0, bits=row.bits)

    @property
    def family(self) -> Family | None:
        """The row of the table of families, None for a model that is not in it."""
        return FAMILIES.get(self.model)

    @property
    def timed_by(self) -> str:
        """Return the device whose terminals its tasks use."""
        within = _OF_CHASSIS.fullmatch(self.name)
        return within[1] if within else self.name

    def coerce(self, rate: float, *, most: float = 0.0, timebase: float = 0.0) -> float:
        """Return the next rate that the module has; delta-sigma modules take the higher one.

        Parameters
        ----------
        most : float
            Highest rate, where it is another than ``max_rate``: that of the outputs say.
        timebase : float
            Hz, of another module that a delta-sigma module follows.
        """
        highest = timebase / 256 if timebase and self.divider else most or self.max_rate
        if not 0.0 < rate <= highest * (1 + 1e-9):
            raise DriverError(-200077, f"Property: SampClk.Rate\nRequested Value: {rate}\nMaximum Value: {highest}")
        return highest / min(self.divider, math.floor(highest / rate + 1e-9)) if self.divider else rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A channel of a task; ``gain`` turns volts into what the task delivers, ``step`` is what an encoder counts (rad or m)."""

    name: str
    physical: str
    kind: str
    usage: int
    lower: float
    upper: float
    gain: float = 1.0
    what: str = "voltage"
    step: float = 0.0

    @property
    def device(self) -> str:
        """The device it is on."""
        return self.physical.partition("/")[0]

    @property
    def line(self) -> int:
        """Number of a digital line in its port."""
        return int(self.physical.rpartition("line")[2])


@dataclass(slots=True, kw_only=True, eq=False)
class Task:
    """A task of the driver."""

    name: str
    channels: list[Channel] = field(default_factory=list)
    rate: float = 1000.0
    asked: float = 1000.0
    mode: int | None = None
    samples: int = 0
    clock: str = ""
    trigger: str = ""
    timebase: str = ""
    sync_pulse: str = ""
    engine: str = ""
    """Of the timing engines of a chassis, the one that was reserved."""
    reserved: bool = False
    """Whether its client has reserved it, so that it stays so when it is stopped."""
    buffer: int | None = None
    attributes: dict[tuple[str, str, int], float | int | str] = field(default_factory=dict)
    regenerates: bool = True
    written: Samples = field(default_factory=lambda: np.zeros((0, 0)))
    first: int = 0
    """Number of the oldest sample in ``written``."""
    state: str = "idle"
    started: float = 0.0
    read: int = 0
    made: int = 0
    """Samples that were computed, the last of which wait in ``queue``."""
    queue: list[Samples] = field(default_factory=list)
    run: Run | None = None
    sensors: list[InputRun] = field(default_factory=list)
    fault: int | None = None

    @property
    def kind(self) -> str:
        """AI, AO, CI, DI or DO."""
        return self.channels[0].kind if self.channels else ""

    @property
    def device(self) -> str:
        """The device of its first channel."""
        return self.channels[0].device

    @property
    def uses(self) -> set[tuple[str, str]]:
        """What it needs for itself: a subsystem of each device, of counters each one."""
        return {(entry.kind, entry.physical if entry.kind == "CI" else entry.device) for entry in self.channels}

    @property
    def total(self) -> int:
        """How many samples of each channel have been written."""
        return self.first + (self.written.shape[1] if self.written.size else 0)


def written(task: Task, data: npt.NDArray[Any]) -> Samples:
    """Return what a client has written, shape (channels, n), as levels: the value of a line is in the bit of its number."""
    if task.kind != "DO":
        return np.array(data, dtype=np.float64)
    lines = np.array([[channel.line] for channel in task.channels], dtype=np.uint32)
    return np.asarray((data.astype(np.uint32) >> lines) & 1, dtype=np.float64)


def expand(physical: str) -> list[str]:
    """Return every channel of a list with ranges.

    Examples
    --------
    >>> expand("Dev1/ai0:2, Dev1/ai5")
    ['Dev1/ai0', 'Dev1/ai1', 'Dev1/ai2', 'Dev1/ai5']
    """
    found = []
    for part in (part.strip() for part in physical.split(",")):
        head, colon, last = part.partition(":")
        if not colon:
            found += [part] if part else []
            continue
        stem = head.rstrip("0123456789")
        end = last.removeprefix(stem).lstrip("abcdefghijklmnopqrstuvwxyz")
        if not (end.isdigit() and head[len(stem) :].isdigit()):
            raise DriverError(-200170, f"Physical Channel Name: {part}")
        found += [f"{stem}{i}" for i in range(int(head[len(stem) :]), int(end) + 1)]
    return found
