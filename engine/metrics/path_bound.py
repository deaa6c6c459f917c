"""How near a path's gain comes to its bounds over frequency.

max over ω of |G| / upper and lower / |G|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.exact.frequency.shapes import squared_magnitude
from engine.metrics._base import PathMetric
from engine.metrics._bounded import path_ratio

if TYPE_CHECKING:
    from engine.metrics._base import Finding, MaskKind, PathSubject


@final
class PathBound(PathMetric):
    """How near a path's gain comes to its bounds over frequency."""

    kind: ClassVar[str] = "path_bound"
    title: ClassVar[str] = "Gain against bounds"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "How near the gain of a path comes to its bounds over frequency; met at 1. From the reference to the control it bounds |KS|, from a force to a position it is a compliance mask."
    )
    source: ClassVar[str] = "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., section 2.8"
    mask: ClassVar[MaskKind] = "frequency bounds"

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return path_ratio(subject, squared_magnitude)
