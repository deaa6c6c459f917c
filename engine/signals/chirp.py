"""Chirp: a sine whose frequency grows linearly with time, then 0.

u(t) = amplitude sin(w0 t + (w1 - w0) t² / (2 duration)) for 0 <= t < duration, else 0
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from engine.model.parameters import Param
from engine.signals._base import FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True)
class Chirp(Signal):
    """Excitation that sweeps from one frequency to another."""

    amplitude: float
    start_frequency: float
    end_frequency: float
    duration: float

    kind = "chirp"
    title = "Chirp"
    equation = "u(t) = amplitude · sin(ω₀ t + (ω₁ − ω₀) t²/(2 duration)) for t < duration"
    source = "Definition; linear sweep."
    parameters = (
        Param(name="amplitude", symbol="u₀", default=1.0, doc="half of the peak-to-peak value"),
        Param(name="start_frequency", symbol="ω₀", unit="rad/s", lower=0.0, doc="angular frequency at time 0"),
        Param(name="end_frequency", symbol="ω₁", unit="rad/s", lower=0.0, doc="angular frequency at the end"),
        Param(name="duration", symbol="T", unit="s", lower=0.0, lower_open=True, doc="length of the sweep; then 0"),
    )
    example: ClassVar[Mapping[str, Any]] = {"start_frequency": 1.0, "end_frequency": 20.0, "duration": 10.0}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the chirp."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        rate = (self.end_frequency - self.start_frequency) / self.duration
        active = (np.real(t) >= 0) & (np.real(t) < np.real(self.duration))
        inside = np.where(active, t, 0.0)
        return np.where(active, self.amplitude * np.sin((self.start_frequency + 0.5 * rate * inside) * inside), 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return time 0 and the end, where the command falls to 0."""
        return (0.0, self.duration)

    def final(self) -> float | None:
        """Return 0."""
        return 0.0

    def end(self) -> float | None:
        """Return the duration."""
        return self.duration

    def degree(self) -> int | None:
        """Return None: smooth, no polynomial."""
        return 0 if self.amplitude == 0 else None
