"""Sampled command: held, in straight lines or in a spline between given points.

linear:  u(t) = values[k] + (values[k+1] - values[k]) (t - time[k]) / (time[k+1] - time[k]) for time[k] <= t < time[k+1]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from engine.model.between_samples import BetweenSamples, polynomials
from engine.model.errors import SignalError
from engine.model.parameters import Param
from engine.signals._base import FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampled(Signal):
    """A recorded or computed command. Before its first point it has the first value, after its last the last one."""

    time: FloatArray
    values: FloatArray
    between_samples: BetweenSamples = BetweenSamples.LINEAR
    _powers: FloatArray = field(init=False, repr=False)

    kind = "sampled"
    title = "Sampled"
    equation = "u(t) = interpolation of (time, values): held, linear, or a quintic spline (band_limited)"
    source = "Definition; zero-order hold, first-order hold, spline interpolation."
    parameters = (
        Param(name="time", symbol="t_k", unit="s", shape="list", lower=0.0, doc="times of the points, increasing"),
        Param(name="values", symbol="u_k", shape="list", doc="values at these times"),
        Param(
            name="between_samples", symbol="u(t)", shape="text", default=str(BetweenSamples.LINEAR),
            choices=tuple(str(way) for way in BetweenSamples),
            doc="held as by a D/A converter, in straight lines, or smooth as behind an anti-aliasing filter",
        ),
    )  # fmt: skip
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
        return cls(time=time, values=given, between_samples=BetweenSamples(values["between_samples"]))

    def __post_init__(self) -> None:
        object.__setattr__(self, "_powers", polynomials(self.values, self.between_samples, self.time))

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        after = np.searchsorted(self.time, np.real(t), side="right")
        outside = np.where(after == 0, self.values[0], self.values[-1])
        if self.time.size == 1:
            return np.asarray(outside, dtype=np.float64)
        piece = np.clip(after - 1, 0, self.time.size - 2)
        # an instant that carries an infinitesimal moves along its polynomial
        part = (t - self.time[piece]) / (self.time[piece + 1] - self.time[piece])
        found = np.zeros_like(part)
        for powers in self._powers[::-1]:
            found = found * part + powers[piece]
        return np.where((after > 0) & (after < self.time.size), found, outside)

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
        """Return that of the pieces, 0 where nothing changes."""
        return len(self._powers) - 1 if np.any(np.diff(self.values)) else 0
