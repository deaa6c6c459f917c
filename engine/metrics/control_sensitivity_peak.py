"""The largest gain from the reference to the control.

Mks = max over ω of |K S (jω)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import PathMetric
from engine.metrics._largest import highest_magnitude

if TYPE_CHECKING:
    from engine.metrics._base import Finding, PathSubject


@final
class ControlSensitivityPeak(PathMetric):
    """The largest gain from the reference to the control."""

    kind: ClassVar[str] = "control_sensitivity_peak"
    title: ClassVar[str] = "Control sensitivity peak"
    unit: ClassVar[str] = "output/input"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "The largest gain from the reference to the control."
    source: ClassVar[str] = "M. Hast et al., PID design by convex-concave optimization, ECC 2013"

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return highest_magnitude(subject)
