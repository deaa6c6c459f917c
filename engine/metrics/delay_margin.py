"""How much more delay the loop bears.

min over crossings of (phase margin in [0, 2π)) / ω
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import Absent, Found, LoopMetric, unclosed
from engine.metrics._loop import delay_margins, grazes_one
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject


@final
class DelayMargin(LoopMetric):
    """How much more delay the loop bears."""

    kind: ClassVar[str] = "delay_margin"
    title: ClassVar[str] = "Delay margin"
    unit: ClassVar[str] = "s"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = "Smallest additional delay in the loop that makes it unstable."
    source: ClassVar[str] = "K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., chapter 10"
    time_power: ClassVar[float] = 1
    absent_is_infinite: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unclosed(subject)
        if refusal is not None:
            return refusal
        margins = delay_margins(subject.response, subject.verdict)
        if not margins:
            return Absent(verdict=Verdict.NEVER_CROSSES, advice="the loop gain never passes 1: any delay is borne")
        frequency, value = min(margins, key=lambda pair: float(pair[1][0].real))
        jumps = grazes_one(subject.response)
        return Found(value=value, at=float(frequency[0].real), verdict=subject.verdict, one_sided=jumps)
