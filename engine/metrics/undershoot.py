"""How far the output goes the wrong way.

(y0 - min y) / (y∞ - y0), 0 if negative
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import NEGLIGIBLE, Found, TimeMetric, span, without_final_value
from engine.metrics._largest import has_rival

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class Undershoot(TimeMetric):
    """How far the output goes the wrong way."""

    kind: ClassVar[str] = "undershoot"
    title: ClassVar[str] = "Undershoot"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "How far the output first goes the wrong way, as a ratio of its way; 0 when it does not."
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
        initial, way, sign = span(subject)
        facing = subject.curve * sign
        bottom, at = facing.smallest()
        below = (sign * initial - bottom) / (sign * way)
        if float(below[0].real) <= NEGLIGIBLE:
            return Found(value=np.zeros(len(below)))
        return Found(value=below, at=at, kinked=has_rival(facing, bottom, at))
