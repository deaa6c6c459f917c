"""Band-limited noise that is the same on every machine: sines side by side in the band, with phases and places drawn by a seed.

u(t) = rms √(2/K) Σ_k sin(ω_k t + φ_k),  ω_k = low + (k - 1 + a_k)(high - low)/K,  k = 1..K

a_k in 0..1 and φ_k in 0..2π come from the seed; a sum of many sines of random phases is Gaussian, its density flat in the band.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, Self

import numpy as np

from engine.model.errors import SignalError
from engine.model.parameters import Param
from engine.signals._base import FloatArray, Signal

_SINES: Final = 128
_WORD: Final = 2**64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Noise(Signal):
    """Disturbances and measuring noise of known strength and band."""

    band: FloatArray
    rms: float
    seed: float
    frequencies: FloatArray = field(repr=False)
    phases: FloatArray = field(repr=False)

    kind = "noise"
    title = "Noise in a band"
    equation = "u(t) = rms · √(2/K) · Σ sin(ω_k·t + φ_k), ω_k in K = 128 equal parts of the band"
    source = (
        "M. Shinozuka, G. Deodatis, Applied Mechanics Reviews 44 (1991) 191-204 (spectral representation); "
        "G. Steele, D. Lea, C. Flood, OOPSLA 2014 (SplitMix64, from which the draws come)."
    )
    parameters = (
        Param(name="band", symbol="[ω₁, ω₂]", unit="rad/s", shape="list", lower=0.0, doc="lowest and highest angular frequency"),
        Param(name="rms", symbol="σ", default=1.0, lower=0.0, doc="root of the mean square over a long time"),
        Param(name="seed", symbol="n", default=1.0, lower=0.0, upper=2.0**53, doc="whole number; another one is another record"),
    )  # fmt: skip
    example: ClassVar[Mapping[str, Any]] = {"band": [1.0, 20.0]}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the noise; refuse a band that is none, and a seed that is no whole number."""
        band, seed = values["band"], values["seed"]
        if band.size != 2 or not band[0] < band[1]:
            shown = ", ".join(f"{end:g}" for end in band[:3])
            raise SignalError(f"band must be [low, high] with 0 <= low < high rad/s, got [{shown}]", at=("band",))
        if np.iscomplexobj(seed) or seed != np.floor(seed):
            raise SignalError(f"seed must be a whole number, got {np.real(seed):g}", at=("seed",))
        drawn = np.array(_drawn(int(seed), 2 * _SINES))
        width = (band[1] - band[0]) / _SINES
        frequencies = band[0] + width * (np.arange(_SINES) + drawn[:_SINES])
        return cls(**values, frequencies=frequencies, phases=2 * np.pi * drawn[_SINES:])

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        waves = np.sin(np.multiply.outer(t, self.frequencies) + self.phases).sum(axis=-1)
        return np.where(np.real(t) >= 0, self.rms * np.sqrt(2 / _SINES) * waves, 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return time 0, where the noise begins."""
        return (0.0,)

    def final(self) -> float | None:
        """Return None, as it does not settle, unless its strength is 0."""
        return 0.0 if self.rms == 0 else None

    def end(self) -> float | None:
        """Return None: it has no end, unless its strength is 0."""
        return 0.0 if self.rms == 0 else None

    def degree(self) -> int | None:
        """Return None: smooth, no polynomial."""
        return 0 if self.rms == 0 else None

    def sines(self) -> FloatArray | None:
        """Return those that were drawn."""
        each = np.full(_SINES, self.rms * np.sqrt(2 / _SINES))
        return np.stack([each, self.frequencies, self.phases], axis=1)


def _drawn(seed: int, count: int) -> list[float]:
    """Return numbers evenly drawn from 0..1 by SplitMix64: whole numbers only, so that they are the same everywhere."""
    state, found = seed, []
    for _ in range(count):
        state = (state + 0x9E3779B97F4A7C15) % _WORD
        z = state
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 % _WORD
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB % _WORD
        found.append(((z ^ (z >> 31)) >> 11) * 2.0**-53)
    return found
