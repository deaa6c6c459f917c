"""What a driver knows: devices, channels, tasks, and the names of physical channels."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rig_simulator.faults import DriverError
from rig_simulator.plant import Run
from rig_simulator.sensors import Converter, SensorRun

Samples = npt.NDArray[np.float64]

_OF_CHASSIS = re.compile(r"(.+)Mod\d+")

FINITE, CONTINUOUS = 10178, 10123
"""nidaqmx.constants.AcquisitionType."""


@dataclass(slots=True, kw_only=True)
class Device:
    """A module; ``divider`` is the largest by which a delta-sigma module divides its ``max_rate``, 0 for any rate.

    Modules that are named as a driver names those of a chassis (cDAQ1Mod2) have no terminals of their own: the timing engines
    are in the chassis.
    """

    name: str
    model: str
    serial: int
    inputs: int = 0
    outputs: int = 0
    max_rate: float = 51200.0
    divider: int = 31
    converter: Converter = field(default_factory=Converter)
    present: bool = True

    @property
    def timed_by(self) -> str:
        """Return the device whose terminals its tasks use."""
        within = _OF_CHASSIS.fullmatch(self.name)
        return within[1] if within else self.name

    def coerce(self, rate: float) -> float:
        """Return the next rate that the module has; delta-sigma modules take the higher one."""
        lowest = self.max_rate / self.divider if self.divider else 0.0
        if not 0.0 < rate <= self.max_rate:
            raise DriverError(
                -200077, f"Property: SampClk.Rate\nRequested Value: {rate}\nMaximum Value: {self.max_rate}"
            )
        return self.max_rate / min(self.divider, math.floor(self.max_rate / rate + 1e-9)) if lowest else rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """A channel of a task; ``gain`` turns volts into what the task delivers."""

    name: str
    physical: str
    kind: str
    usage: int
    lower: float
    upper: float
    gain: float = 1.0

    @property
    def device(self) -> str:
        """The device it is on."""
        return self.physical.partition("/")[0]


@dataclass(slots=True, kw_only=True, eq=False)
class Task:
    """A task of the driver."""

    name: str
    channels: list[Channel] = field(default_factory=list)
    rate: float = 1000.0
    mode: int | None = None
    samples: int = 0
    clock: str = ""
    trigger: str = ""
    buffer: int | None = None
    attributes: dict[tuple[str, str, int], float | int | str] = field(default_factory=dict)
    regenerates: bool = True
    written: Samples = field(default_factory=lambda: np.zeros((0, 0)))
    first: int = 0
    """Number of the oldest sample in ``written``."""
    state: str = "idle"
    started: float = 0.0
    read: int = 0
    run: Run | None = None
    sensors: list[SensorRun] = field(default_factory=list)
    fault: int | None = None

    @property
    def kind(self) -> str:
        """AI or AO."""
        return self.channels[0].kind if self.channels else ""

    @property
    def device(self) -> str:
        """The device of its first channel."""
        return self.channels[0].device

    @property
    def total(self) -> int:
        """How many samples of each channel have been written."""
        return self.first + (self.written.shape[1] if self.written.size else 0)


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
