"""Pulse: 0, a constant for a while, then 0 again.

u(t) = amplitude for start <= t < start + width, else 0
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from engine.model.parameters import Param
from engine.signals._base import START, FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True)
class Pulse(Signal):
    """A load that comes and goes, or a command that is taken back."""

    start: float
    width: float
    amplitude: float

    kind = "pulse"
    title = "Pulse"
    equation = "u(t) = amplitude for start ≤ t < start + width, else 0"
    source = "Definition."
    parameters = (
        START,
        Param(name="width", symbol="T", unit="s", lower=0.0, lower_open=True, doc="how long it lasts"),
        Param(name="amplitude", symbol="u₀", default=1.0, doc="height of the pulse"),
    )
    example: ClassVar[Mapping[str, Any]] = {"width": 0.5}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the pulse."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        begin, end = np.real(self.start), np.real(self.start + self.width)
        return np.where((np.real(t) >= begin) & (np.real(t) < end), self.amplitude, 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return where it begins and ends."""
        return (self.start, self.start + self.width)

    def final(self) -> float | None:
        """Return 0."""
        return 0.0

    def end(self) -> float | None:
        """Return where it ends."""
        return self.start + self.width

    def degree(self) -> int | None:
        """Return 0: constant pieces."""
        return 0
