"""How much the loop gain may change.

1 / |L| where the phase of L is -180°
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, LoopMetric, unclosed
from engine.metrics._loop import NO_LIMIT_ABOVE, finite, gain_distance, gain_margins, rivals
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject
    from engine.model.linear_system import Array


@final
class GainMargin(LoopMetric):
    """How much the loop gain may change."""

    kind: ClassVar[str] = "gain_margin"
    title: ClassVar[str] = "Gain margin"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = (
        "Factor by which the loop gain may change before the loop becomes unstable: the one nearest 1 on a log scale, below 1 "
        "for a reduction. Goals compare its distance from 1, max(g, 1/g)."
    )
    range: ClassVar[tuple[float, float]] = (1.0, math.inf)
    compares: ClassVar[str] = "max(g, 1/g)"
    usual_unit: ClassVar[str] = "dB"
    seldom_beyond: ClassVar[float] = 5.0
    source: ClassVar[str] = "K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., chapter 10"
    absent_is_infinite: ClassVar[bool] = True

    @classmethod
    def distance(cls, value: Array) -> Array:
        """Return max(g, 1/g)."""
        return gain_distance(value)

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unclosed(subject)
        if refusal is not None:
            return refusal
        margins, _ = gain_margins(subject.response, subject.static)
        if not margins:
            return Absent(verdict=Verdict.NEVER_CROSSES, advice=NO_LIMIT_ABOVE)
        frequency, value = min(margins, key=lambda pair: abs(float(np.log(pair[1][0].real))))
        jumps = rivals([float(np.log(margin[0].real)) for _, margin in margins])
        return Found(value=value, at=finite(frequency), verdict=subject.verdict, one_sided=jumps)
