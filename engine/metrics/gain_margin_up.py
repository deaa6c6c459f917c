"""How much the loop gain may rise.

min 1/|L| over arg L = -π with |L| <= 1
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import Absent, Found, LoopMetric, unclosed
from engine.metrics._loop import NO_LIMIT_ABOVE, finite, gain_margins_on
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject


@final
class GainMarginUp(LoopMetric):
    """How much the loop gain may rise."""

    kind: ClassVar[str] = "gain_margin_up"
    title: ClassVar[str] = "Gain margin upwards"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = "Factor above 1 by which the loop gain may rise before the loop becomes unstable."
    range: ClassVar[tuple[float, float]] = (1.0, math.inf)
    usual_unit: ClassVar[str] = "dB"
    seldom_beyond: ClassVar[float] = 5.0
    source: ClassVar[str] = "K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., chapter 10"
    absent_is_infinite: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unclosed(subject)
        if refusal is not None:
            return refusal
        margins = gain_margins_on(subject.response, subject.static, "up")
        if not margins:
            return Absent(verdict=Verdict.NEVER_CROSSES, advice=NO_LIMIT_ABOVE)
        frequency, value = min(margins, key=lambda pair: float(pair[1][0].real))
        return Found(value=value, at=finite(frequency), verdict=subject.verdict)
