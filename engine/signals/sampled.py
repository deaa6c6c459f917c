"""Sampled command: straight lines between given points.

u(t) = values[k] + (values[k+1] - values[k]) (t - time[k]) / (time[k+1] - time[k]) for time[k] <= t < time[k+1]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from engine.errors import SignalError
from engine.parameters import Param
from engine.signals._base import FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampled(Signal):
    """A recorded or computed command. Before its first point it has the first value, after its last the last one."""

    time: FloatArray
    values: FloatArray

    kind = "sampled"
    title = "Sampled"
    equation = "u(t) = linear interpolation of (time, values)"
    source = "Definition; first-order hold."
    parameters = (
        Param(name="time", symbol="t_k", unit="s", shape="list", lower=0.0, doc="times of the points, increasing"),
        Param(name="values", symbol="u_k", shape="list", doc="values at these times"),
    )
    example: ClassVar[Mapping[str, Any]] = {"time": [0.0, 1.0, 2.0], "values": [0.0, 1.0, 1.0]}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the signal; refuse times that do not increase or do not match the values."""
        time, given = values["time"], values["values"]
        if not time.size:
            raise SignalError("time must have at least one point, got none", at=("time",))
        if time.size != given.size:
            raise SignalError(f"values must be as many as time ({time.size}), got {given.size}", at=("values",))
        backward = np.flatnonzero(np.diff(time) <= 0)
        if backward.size:
            index = int(backward[0]) + 1
            raise SignalError(
                f"time[{index}] must be > {time[index - 1]:g} s (the one before), got {time[index]:g}",
                at=("time", index),
            )
        return cls(time=time, values=given)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        real = np.asarray(np.interp(np.real(t), self.time, self.values), dtype=np.float64)
        if not np.iscomplexobj(t) or self.time.size == 1:
            return real
        # an instant that carries an infinitesimal moves along its straight line
        piece = np.clip(np.searchsorted(self.time, np.real(t), side="right") - 1, 0, self.time.size - 2)
        inside = (np.real(t) >= self.time[0]) & (np.real(t) < self.time[-1])
        slope = np.where(inside, (np.diff(self.values) / np.diff(self.time))[piece], 0.0)
        return np.asarray(real + 1j * slope * np.imag(t))

    def breakpoints(self) -> tuple[float, ...]:
        """Return time 0 and all points."""
        points = tuple(self.time.tolist())
        return points if points[0] == 0 else (0.0, *points)

    def final(self) -> float | None:
        """Return the last value."""
        return float(self.values[-1])

    def end(self) -> float | None:
        """Return the time of the last point."""
        return float(self.time[-1])

    def degree(self) -> int | None:
        """Return 1: linear pieces, or 0 where nothing changes."""
        return 1 if np.any(np.diff(self.values)) else 0
