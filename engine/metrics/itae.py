"""Integral of time-weighted absolute error.

∫ t |r - y| dt
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric
from engine.metrics._integrals import integral_of_error

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class Itae(TimeMetric):
    """Integral of time-weighted absolute error."""

    kind: ClassVar[str] = "itae"
    title: ClassVar[str] = "Integral of time-weighted absolute error"
    unit: ClassVar[str] = "output*s**2"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Integral of time-weighted absolute error from the command's start to the duration, or to infinity."
    )
    source: ClassVar[str] = "D. Graham, R. C. Lathrop, Trans. AIEE 72 (1953) 273-288"
    amplitude_power: ClassVar[int] = 1
    time_power: ClassVar[float] = 2
    of_the_error: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return integral_of_error(subject, "itae")
