"""Impulse: all at once at time 0, over before anything else has moved.

u(t) = area δ(t)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from engine.model.parameters import Param
from engine.signals._base import FloatArray, Signal


@dataclass(frozen=True, slots=True, kw_only=True)
class Impulse(Signal):
    """A blow: the response is that of the states it leaves behind. Where it would go straight to an output it is refused."""

    area: float

    kind = "impulse"
    title = "Impulse"
    equation = "u(t) = area · δ(t)"
    source = "Definition."
    parameters = (
        Param(name="area", symbol="J", default=1.0, doc="integral over the impulse: unit of the input times s"),
    )

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the impulse."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return 0: what is left of it after time 0."""
        return 0.0 * t

    def breakpoints(self) -> tuple[float, ...]:
        """Return time 0."""
        return (0.0,)

    def final(self) -> float | None:
        """Return 0."""
        return 0.0

    def end(self) -> float | None:
        """Return 0."""
        return 0.0

    def degree(self) -> int | None:
        """Return None: no polynomial."""
        return None

    def impulse(self) -> float:
        """Return the area."""
        return self.area
