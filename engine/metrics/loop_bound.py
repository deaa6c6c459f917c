"""How near the gain of an open loop comes to the bounds of its shape.

max over ω of |L| / upper and lower / |L|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.exact.frequency.shapes import squared_magnitude
from engine.metrics._base import LoopMetric
from engine.metrics._bounded import loop_ratio

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject, MaskKind


@final
class LoopBound(LoopMetric):
    """How near the gain of an open loop comes to the bounds of its shape."""

    kind: ClassVar[str] = "loop_bound"
    title: ClassVar[str] = "Loop shape against bounds"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "How near the gain of an open loop comes to the bounds of its shape; met at 1."
    source: ClassVar[str] = "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., section 2.6"
    mask: ClassVar[MaskKind] = "frequency bounds"

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return loop_ratio(subject, squared_magnitude)
