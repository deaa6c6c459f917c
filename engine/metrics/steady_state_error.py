"""What remains of the error.

e∞ = lim (r - y)
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import Absent, Found, TimeMetric, unsettled
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class SteadyStateError(TimeMetric):
    """What remains of the error."""

    kind: ClassVar[str] = "steady_state_error"
    title: ClassVar[str] = "Steady-state error"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "What remains of the error reference minus output, signed."
    range: ClassVar[tuple[float, float]] = (-math.inf, math.inf)
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"
    amplitude_power: ClassVar[int] = 1
    of_the_end: ClassVar[bool] = True
    of_the_error: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unsettled(subject.verdict)
        if refusal is not None:
            return refusal
        if subject.error is None:
            return Absent(verdict=Verdict.NOT_APPLICABLE, advice="it needs a reference input")
        if subject.error_final is None:
            return Absent(
                verdict=Verdict.NOT_APPLICABLE, advice="it needs a command that settles at a constant, such as a step"
            )
        return Found(value=subject.error_final)
