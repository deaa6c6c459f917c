"""How hard the control works on average.

sqrt(1/T ∫₀^T u² dt)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, TimeMetric
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class ControlEffortRms(TimeMetric):
    """How hard the control works on average."""

    kind: ClassVar[str] = "control_effort_rms"
    title: ClassVar[str] = "Root mean square control effort"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "Root mean square of the control output over the duration."
    source: ClassVar[str] = "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., section 2.4"
    belongs_to: ClassVar[tuple[str, ...]] = ("1", "V", "A", "m**3/s")
    amplitude_power: ClassVar[int] = 1

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        if subject.duration is None:
            advice = "it is a mean over time: give the simulation a duration"
            return Absent(verdict=Verdict.NOT_APPLICABLE, advice=advice)
        energy = subject.during(subject.curve, subject.final).squared().integral()
        return Found(value=np.sqrt(energy / subject.duration))
