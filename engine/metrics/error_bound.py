"""How near the error of a path that is to follow its input comes to its bounds over frequency.

max over ω of |1 - G| / upper and lower / |1 - G|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.exact.frequency.shapes import squared_error
from engine.metrics._base import PathMetric
from engine.metrics._bounded import path_ratio

if TYPE_CHECKING:
    from engine.metrics._base import Finding, MaskKind, PathSubject


@final
class ErrorBound(PathMetric):
    """How near the error of a path that is to follow its input comes to its bounds over frequency."""

    kind: ClassVar[str] = "error_bound"
    title: ClassVar[str] = "Error against bounds"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "How near the error of a path that is to follow its input comes to its bounds over frequency; met at 1."
    )
    source: ClassVar[str] = "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., section 2.8"
    mask: ClassVar[MaskKind] = "frequency bounds"

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return path_ratio(subject, squared_error)
