"""Ramp: 0, then a constant slope without end.

u(t) = slope (t - start) for t >= start, else 0
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from engine.model.parameters import Param
from engine.signals._base import START, FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True)
class Ramp(Signal):
    """The command behind the following error at constant velocity."""

    slope: float
    start: float

    kind = "ramp"
    title = "Ramp"
    equation = "u(t) = slope · (t − start) for t ≥ start"
    source = "Definition."
    parameters = (Param(name="slope", symbol="v", default=1.0, doc="growth in one second"), START)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the ramp."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        return self.slope * np.where(np.real(t) >= np.real(self.start), t - self.start, 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the start."""
        return (self.start,)

    def final(self) -> float | None:
        """Return None, as a ramp does not settle, unless its slope is 0."""
        return 0.0 if self.slope == 0 else None

    def end(self) -> float | None:
        """Return None: a ramp has no end, unless its slope is 0."""
        return self.start if self.slope == 0 else None

    def degree(self) -> int | None:
        """Return 1: linear pieces."""
        return 1
