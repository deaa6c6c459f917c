"""How near the complementary sensitivity of a loop comes to its bounds over frequency.

max over ω of |T| / upper and lower / |T|,   T = L / (1 + L)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.exact.frequency.shapes import squared_complementary
from engine.metrics._base import LoopMetric
from engine.metrics._bounded import loop_ratio

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject, MaskKind


@final
class ComplementaryBound(LoopMetric):
    """How near the complementary sensitivity of a loop comes to its bounds over frequency."""

    kind: ClassVar[str] = "complementary_bound"
    title: ClassVar[str] = "Complementary sensitivity against bounds"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "How near the complementary sensitivity of a loop comes to its bounds over frequency; met at 1."
    )
    source: ClassVar[str] = "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., section 2.8"
    mask: ClassVar[MaskKind] = "frequency bounds"

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return loop_ratio(subject, squared_complementary)
