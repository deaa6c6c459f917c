"""Sine of constant frequency from time 0 on.

u(t) = amplitude sin(frequency t + phase)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from engine.model.parameters import Param
from engine.signals._base import FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True)
class Sine(Signal):
    """Harmonic excitation."""

    amplitude: float
    frequency: float
    phase: float

    kind = "sine"
    title = "Sine"
    equation = "u(t) = amplitude · sin(frequency · t + phase)"
    source = "Definition."
    parameters = (
        Param(name="amplitude", symbol="u₀", default=1.0, doc="half of the peak-to-peak value"),
        Param(
            name="frequency", symbol="ω", unit="rad/s", lower=0.0, lower_open=True, scale="log", doc="angular frequency"
        ),
        Param(name="phase", symbol="φ", unit="rad", default=0.0, doc="phase at time 0"),
    )
    example: ClassVar[Mapping[str, Any]] = {"frequency": 2.0}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the sine."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        return np.where(np.real(t) >= 0, self.amplitude * np.sin(self.frequency * t + self.phase), 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return time 0, where the sine begins."""
        return (0.0,)

    def final(self) -> float | None:
        """Return None, as a sine does not settle, unless its amplitude is 0."""
        return 0.0 if self.amplitude == 0 else None

    def end(self) -> float | None:
        """Return None: a sine has no end, unless its amplitude is 0."""
        return 0.0 if self.amplitude == 0 else None

    def degree(self) -> int | None:
        """Return None: smooth, no polynomial."""
        return 0 if self.amplitude == 0 else None

    def sines(self) -> FloatArray | None:
        """Return itself."""
        return np.array([[self.amplitude, self.frequency, self.phase]])

    def repeats_after(self) -> float | None:
        """Return 2π / frequency."""
        return None if self.amplitude == 0 else 2 * np.pi / self.frequency
