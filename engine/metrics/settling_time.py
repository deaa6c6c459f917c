"""When the output enters the band around its final value for the last time.

t_s = min t such that |y(t') - y∞| <= b |y∞ - y0| for all t' >= t;   b = 0.02 unless `settling_band` says otherwise
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric, last_entry

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class SettlingTime(TimeMetric):
    """When the output enters the band around its final value for the last time."""

    kind: ClassVar[str] = "settling_time"
    title: ClassVar[str] = "Settling time"
    unit: ClassVar[str] = "s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Time from the command's start to the last entry into the band of ±2 % of the way around the final value, "
        "or of ± `settling_band` of it."
    )
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"
    time_power: ClassVar[float] = 1
    options: ClassVar[tuple[str, ...]] = ("settling_band",)
    of_the_end: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return last_entry(subject, subject.options.settling_band)
