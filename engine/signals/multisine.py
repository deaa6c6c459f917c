"""Multisine: harmonics of one fundamental, equally strong, with phases that keep the peak low.

u(t) = amplitude Σ_k sin(harmonics[k] fundamental t + φ_k),   φ_k = -π k (k - 1) / K,   k = 1..K
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
class Multisine(Signal):
    """Periodic excitation of chosen lines of the spectrum, none of the others."""

    amplitude: float
    fundamental: float
    harmonics: FloatArray

    kind = "multisine"
    title = "Multisine"
    equation = "u(t) = amplitude · Σ sin(n_k · ω · t − π·k·(k − 1)/K), k = 1…K"
    source = "M. Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85-89 (phases of low peak factor for a flat spectrum)."
    parameters = (
        Param(name="amplitude", symbol="u₀", default=1.0, doc="amplitude of each sine"),
        Param(
            name="fundamental", symbol="ω", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="angular frequency whose multiples are excited",
        ),
        Param(name="harmonics", symbol="n_k", shape="list", lower=1.0, doc="which multiples: increasing whole numbers"),
    )  # fmt: skip
    example: ClassVar[Mapping[str, Any]] = {"fundamental": 1.0, "harmonics": [1.0, 3.0, 5.0, 7.0]}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the multisine; refuse harmonics that are no increasing whole numbers."""
        harmonics = values["harmonics"]
        if not harmonics.size:
            raise SignalError("harmonics must be at least one number, got none", at=("harmonics",))
        wrong = np.flatnonzero((harmonics != np.round(harmonics)) | (np.diff(harmonics, prepend=0.0) <= 0))
        if wrong.size:
            index = int(wrong[0])
            msg = f"harmonics[{index}] must be a whole number above the one before, got {harmonics[index]:g}"
            raise SignalError(msg, at=("harmonics", index))
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        waves = np.sin(np.multiply.outer(t, self.harmonics * self.fundamental) + self._phases)
        return np.where(np.real(t) >= 0, self.amplitude * waves.sum(axis=-1), 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return time 0, where the excitation begins."""
        return (0.0,)

    def final(self) -> float | None:
        """Return None, as it does not settle, unless its amplitude is 0."""
        return 0.0 if self.amplitude == 0 else None

    def end(self) -> float | None:
        """Return None: it has no end, unless its amplitude is 0."""
        return 0.0 if self.amplitude == 0 else None

    def degree(self) -> int | None:
        """Return None: smooth, no polynomial."""
        return 0 if self.amplitude == 0 else None

    @property
    def _phases(self) -> FloatArray:
        k = np.arange(1, self.harmonics.size + 1)
        return -np.pi * k * (k - 1) / k.size

    def sines(self) -> FloatArray | None:
        """Return its harmonics."""
        each = np.full(self.harmonics.size, self.amplitude)
        return np.stack([each, self.harmonics * self.fundamental, self._phases], axis=1)

    def repeats_after(self) -> float | None:
        """Return 2π / fundamental."""
        return None if self.amplitude == 0 else 2 * np.pi / self.fundamental
