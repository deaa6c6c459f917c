"""Straight lines between points, with jumps where an instant is given twice.

u(t) = values[k] + (values[k+1] - values[k]) (t - time[k]) / (time[k+1] - time[k]) for time[k] <= t < time[k+1]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from engine.model.errors import SignalError
from engine.model.parameters import Param
from engine.signals._base import FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PiecewiseLinear(Signal):
    """A drawn command: ramps, holds and jumps. Before its first point it has the first value, after its last the last one."""

    time: FloatArray
    values: FloatArray

    kind = "piecewise_linear"
    title = "Straight lines between points"
    equation = "u(t) = linear interpolation of (time, values); the same instant twice is a jump"
    source = "Definition."
    parameters = (
        Param(
            name="time", symbol="t_k", unit="s", shape="list", lower=0.0, doc="times of the points, rising; twice the same: a jump"
        ),
        Param(name="values", symbol="u_k", shape="list", doc="values at these times"),
    )  # fmt: skip
    example: ClassVar[Mapping[str, Any]] = {"time": [0.0, 1.0, 2.0, 2.0], "values": [0.0, 1.0, 1.0, 0.0]}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the signal; refuse times that fall, stand still for more than a jump, or do not match the values."""
        time, given = values["time"], values["values"]
        if not time.size:
            raise SignalError("time must have at least one point, got none", at=("time",))
        if time.size != given.size:
            raise SignalError(f"values must be as many as time ({time.size}), got {given.size}", at=("values",))
        for index in range(1, time.size):
            if time[index] < time[index - 1] or (index > 1 and time[index] == time[index - 2]):
                raise SignalError(
                    f"time[{index}] must be >= {time[index - 1]:g} s (the one before) and there at most twice, "
                    f"got {time[index]:g}",
                    at=("time", index),
                )
        return cls(time=time, values=given)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        # the last point that is not later: at a jump the second of the two
        after = np.searchsorted(self.time, np.real(t), side="right")
        piece = np.clip(after - 1, 0, self.time.size - 1)
        inside = (after > 0) & (after < self.time.size)
        following = np.minimum(piece + 1, self.time.size - 1)
        width = np.where(inside, self.time[following] - self.time[piece], 1.0)
        slope = np.where(inside, (self.values[following] - self.values[piece]) / width, 0.0)
        return np.asarray(self.values[piece] + slope * (t - self.time[piece]))

    def breakpoints(self) -> tuple[float, ...]:
        """Return time 0 and all points."""
        return tuple(sorted({0.0, *self.time.tolist()}))

    def final(self) -> float | None:
        """Return the last value."""
        return float(self.values[-1])

    def end(self) -> float | None:
        """Return the time of the last point."""
        return float(self.time[-1])

    def degree(self) -> int | None:
        """Return 1: linear pieces, or 0 where nothing changes."""
        return 1 if np.any(np.diff(self.values)) else 0
