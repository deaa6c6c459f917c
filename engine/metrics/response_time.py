"""When the output enters the ±5 % band for the last time.

t_s = min t such that |y(t') - y∞| <= 0.05 |y∞ - y0| for all t' >= t
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric, last_entry

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class ResponseTime(TimeMetric):
    """When the output enters the ±5 % band for the last time."""

    kind: ClassVar[str] = "response_time"
    title: ClassVar[str] = "Response time"
    unit: ClassVar[str] = "s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Time from the command's start to the last entry into the band of ±5 % of the way around the final value."
    )
    source: ClassVar[str] = "the response time t_r of the influence-coefficient method; band of 5 %"
    time_power: ClassVar[float] = 1
    of_the_end: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return last_entry(subject, 0.05)
