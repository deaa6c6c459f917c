"""How near the sensitivity of a loop comes to its bounds over frequency.

max over ω of |S| / upper and lower / |S|,   S = 1 / (1 + L)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.exact.frequency.shapes import squared_sensitivity
from engine.metrics._base import LoopMetric
from engine.metrics._bounded import loop_ratio

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject, MaskKind


@final
class SensitivityBound(LoopMetric):
    """How near the sensitivity of a loop comes to its bounds over frequency."""

    kind: ClassVar[str] = "sensitivity_bound"
    title: ClassVar[str] = "Sensitivity against bounds"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "How near the sensitivity of a loop comes to its bounds over frequency; met at 1."
    source: ClassVar[str] = "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., section 2.8"
    mask: ClassVar[MaskKind] = "frequency bounds"

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return loop_ratio(subject, squared_sensitivity)
