"""How far the output goes beyond its final value.

(max y - y∞) / (y∞ - y0), 0 if negative
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import NEGLIGIBLE, Found, TimeMetric, span, without_final_value
from engine.metrics._largest import has_rival

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class Overshoot(TimeMetric):
    """How far the output goes beyond its final value."""

    kind: ClassVar[str] = "overshoot"
    title: ClassVar[str] = "Overshoot"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "How far the output goes beyond its final value, as a ratio of its way; 0 when it does not."
    )
    usual_unit: ClassVar[str] = "%"
    seldom_beyond: ClassVar[float] = 1.0
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"
    of_the_end: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = without_final_value(subject)
        if refusal is not None:
            return refusal
        assert subject.final is not None
        _, way, sign = span(subject)
        facing = subject.curve * sign
        top, at = facing.largest()
        beyond = (top - sign * subject.final) / (sign * way)
        if float(beyond[0].real) <= NEGLIGIBLE:
            return Found(value=np.zeros(len(beyond)))
        return Found(value=beyond, at=at, kinked=has_rival(facing, top, at))
