"""The largest dynamic compliance, displacement per force.

max over ω of |x/F (jω)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import PathMetric
from engine.metrics._largest import highest_magnitude

if TYPE_CHECKING:
    from engine.metrics._base import Finding, PathSubject


@final
class CompliancePeak(PathMetric):
    """The largest dynamic compliance, displacement per force."""

    kind: ClassVar[str] = "compliance_peak"
    title: ClassVar[str] = "Compliance peak"
    unit: ClassVar[str] = "output/input"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "The largest dynamic compliance, displacement per force."
    source: ClassVar[str] = "D. J. Ewins, Modal Testing, 2nd ed., chapter 1"

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return highest_magnitude(subject)
