"""Square wave without end, from time 0 on.

u(t) = amplitude in the first half of each period, -amplitude in the second
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Self

import numpy as np

from engine.model.errors import UnresolvedError
from engine.model.parameters import Param
from engine.signals._base import FloatArray, Signal

_MOST: Final = 1_000_000
"""More jumps are not listed: whoever asks for so many would follow them for hours."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Square(Signal):
    """Steps back and forth: wear tests, identification, relay-like commands."""

    period: float
    amplitude: float

    kind = "square"
    title = "Square wave"
    equation = "u(t) = amplitude for 0 ≤ t mod period < period/2, else −amplitude"
    source = "Definition."
    parameters = (
        Param(name="period", symbol="T", unit="s", lower=0.0, lower_open=True, scale="log", doc="of one cycle"),
        Param(name="amplitude", symbol="u₀", default=1.0, doc="half of the peak-to-peak value"),
    )
    example: ClassVar[Mapping[str, Any]] = {"period": 2.0}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the wave."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u(t)."""
        now, half = np.real(t), np.real(self.period) / 2
        count = np.floor(now / half)
        # rounding must not move an instant to the other side of a jump, which is at count·half
        count = np.where((count + 1) * half <= now, count + 1, np.where(count * half > now, count - 1, count))
        return np.where(now < 0, 0.0, np.where(count % 2 == 0, self.amplitude, -self.amplitude))

    def breakpoints(self) -> tuple[float, ...]:
        """Return those of the first period."""
        return (0.0, self.period / 2)

    def breaks(self, horizon: float) -> tuple[float, ...]:
        """Return all up to ``horizon`` (s)."""
        half = self.period / 2
        count = horizon / np.real(half)
        if count > _MOST:
            raise UnresolvedError(f"a square wave must jump at most {_MOST} times, got {count:.3g} up to {horizon:g} s")
        return tuple(k * half for k in range(max(2, int(count) + 1)))

    def final(self) -> float | None:
        """Return None, as it does not settle, unless its amplitude is 0."""
        return 0.0 if self.amplitude == 0 else None

    def end(self) -> float | None:
        """Return None: it has no end, unless its amplitude is 0."""
        return 0.0 if self.amplitude == 0 else None

    def degree(self) -> int | None:
        """Return 0: constant pieces."""
        return 0

    def repeats_after(self) -> float | None:
        """Return the period."""
        return None if self.amplitude == 0 else self.period
