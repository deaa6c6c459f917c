"""How much phase the loop may lose.

π + arg L where |L| = 1
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, LoopMetric, unclosed
from engine.metrics._loop import grazes_one, phase_margins, rivals
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject
    from engine.model.linear_system import Array


@final
class PhaseMargin(LoopMetric):
    """How much phase the loop may lose."""

    kind: ClassVar[str] = "phase_margin"
    title: ClassVar[str] = "Phase margin"
    unit: ClassVar[str] = "rad"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = (
        "Phase that the loop may lose before it becomes unstable, nearest 0 in (-π, π]; negative for phase that it may gain. "
        "Goals compare its distance from 0, |φ|."
    )
    range: ClassVar[tuple[float, float]] = (0.0, math.pi)
    compares: ClassVar[str] = "|φ|"
    usual_unit: ClassVar[str] = "deg"
    source: ClassVar[str] = "K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., chapter 10"
    absent_is_infinite: ClassVar[bool] = True

    @classmethod
    def distance(cls, value: Array) -> Array:
        """Return |φ|."""
        return np.where(value.real < 0, -value, value)

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unclosed(subject)
        if refusal is not None:
            return refusal
        margins = phase_margins(subject.response)
        if not margins:
            return Absent(
                verdict=Verdict.NEVER_CROSSES, advice="the loop gain never passes 1: the phase margin is infinite"
            )
        frequency, value = min(margins, key=lambda pair: abs(float(pair[1][0].real)))
        jumps = rivals([float(margin[0].real) for _, margin in margins]) or grazes_one(subject.response)
        return Found(value=value, at=float(frequency[0].real), verdict=subject.verdict, one_sided=jumps)
