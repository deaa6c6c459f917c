"""How far the loop gain may fall.

max 1/|L| over arg L = -π with |L| >= 1, 0 without such a crossing
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Found, LoopMetric, unclosed
from engine.metrics._loop import finite, gain_distance, gain_margins_on

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject
    from engine.model.linear_system import Array


@final
class GainMarginDown(LoopMetric):
    """How far the loop gain may fall."""

    kind: ClassVar[str] = "gain_margin_down"
    title: ClassVar[str] = "Gain margin downwards"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = (
        "Factor below 1 to which the loop gain may fall before the loop becomes unstable; 0 where it may fall to nothing. Goals "
        "compare how far it falls, 1/g."
    )
    range: ClassVar[tuple[float, float]] = (1.0, math.inf)
    compares: ClassVar[str] = "1/g"
    usual_unit: ClassVar[str] = "dB"
    seldom_beyond: ClassVar[float] = 5.0
    source: ClassVar[str] = "K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., chapter 10"
    absent_is_infinite: ClassVar[bool] = True

    @classmethod
    def distance(cls, value: Array) -> Array:
        """Return 1/g."""
        return gain_distance(value)

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unclosed(subject)
        if refusal is not None:
            return refusal
        margins = gain_margins_on(subject.response, subject.static, "down")
        if not margins:
            return Found(value=np.zeros(subject.response.system.lanes), verdict=subject.verdict)
        frequency, value = max(margins, key=lambda pair: float(pair[1][0].real))
        return Found(value=value, at=finite(frequency), verdict=subject.verdict)
