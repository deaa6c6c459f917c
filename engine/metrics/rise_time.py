"""How long the output takes from 10 % to 90 % of its way.

t_r = t(y0 + 0.9 (y∞ - y0)) - t(y0 + 0.1 (y∞ - y0)), first crossings
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import Absent, Found, TimeMetric, passage, touched, without_final_value
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class RiseTime(TimeMetric):
    """How long the output takes from 10 % to 90 % of its way."""

    kind: ClassVar[str] = "rise_time"
    title: ClassVar[str] = "Rise time"
    unit: ClassVar[str] = "s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Time from 10 % to 90 % of the way from the value before the command to the final value, first crossings."
    )
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"
    time_power: ClassVar[float] = 1
    of_the_end: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = without_final_value(subject)
        if refusal is not None:
            return refusal
        low, high = passage(subject, 0.1), passage(subject, 0.9)
        if low is None or high is None:
            return Absent(verdict=Verdict.NEVER_CROSSES, advice="the output does not pass 10 % and 90 % of its way")
        jumps = touched(subject, 0.1, low) or touched(subject, 0.9, high)
        return Found(value=high - low, at=float(high[0].real), one_sided=jumps)
