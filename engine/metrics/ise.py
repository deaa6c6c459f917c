"""Integral of squared error.

∫ (r - y)² dt
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric
from engine.metrics._integrals import integral_of_error

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class Ise(TimeMetric):
    """Integral of squared error."""

    kind: ClassVar[str] = "ise"
    title: ClassVar[str] = "Integral of squared error"
    unit: ClassVar[str] = "output**2*s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "Integral of squared error from the command's start to the duration, or to infinity."
    source: ClassVar[str] = "D. Graham, R. C. Lathrop, Trans. AIEE 72 (1953) 273-288"
    amplitude_power: ClassVar[int] = 2
    time_power: ClassVar[float] = 1
    of_the_error: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return integral_of_error(subject, "ise")
