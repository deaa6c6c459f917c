"""Step: 0, then a constant.

u(t) = amplitude for t >= start, else 0
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from engine.model.parameters import Param
from engine.signals._base import START, FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True)
class Step(Signal):
    """The command behind rise time, overshoot and settling time."""

    amplitude: float
    start: float

    kind = "step"
    title = "Step"
    equation = "u(t) = amplitude for t ≥ start"
    source = "Definition."
    parameters = (Param(name="amplitude", symbol="u₀", default=1.0, doc="height of the step"), START)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the step."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        return np.where(np.real(t) >= np.real(self.start), self.amplitude, 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the start."""
        return (self.start,)

    def final(self) -> float | None:
        """Return the amplitude."""
        return self.amplitude

    def end(self) -> float | None:
        """Return the start: nothing changes after it."""
        return self.start

    def degree(self) -> int | None:
        """Return 0: constant pieces."""
        return 0
