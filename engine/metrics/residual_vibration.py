"""What goes on swinging after the command has ended.

(max y - min y) / 2 for t >= t_end
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import Absent, Found, TimeMetric, unsettled
from engine.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class ResidualVibration(TimeMetric):
    """What goes on swinging after the command has ended."""

    kind: ClassVar[str] = "residual_vibration"
    title: ClassVar[str] = "Residual vibration"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "Half the difference of the largest and the smallest value after the command ends."
    source: ClassVar[str] = "N. Singer, W. Seering, ASME J. Dyn. Syst. Meas. Control 112 (1990) 76-82"
    amplitude_power: ClassVar[int] = 1

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unsettled(subject.verdict)
        if refusal is not None:
            return refusal
        if subject.end is None:
            return Absent(verdict=Verdict.NOT_APPLICABLE, advice="it needs a command that ends")
        rest = subject.curve.since(subject.end)
        return Found(value=(rest.largest()[0] - rest.smallest()[0]) / 2, at=subject.end)
