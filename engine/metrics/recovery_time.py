"""How long a load keeps the output away from where it was.

t_r = min t such that |y(t') - y(t_d-)| <= b for all t' >= t,  minus t_d: the instant at which the last command begins
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, TimeMetric, away_from, grazes, unsettled
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject
    from engine.model.linear_system import Array


@final
class RecoveryTime(TimeMetric):
    """How long a load keeps the output away from where it was."""

    kind: ClassVar[str] = "recovery_time"
    title: ClassVar[str] = "Recovery time"
    unit: ClassVar[str] = "s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Time from the start of the last command, a load say, until the output is within ± `recovery_band` of where it "
        "was just before, for good; 0 if it never leaves."
    )
    source: ClassVar[str] = "G. Ellis, Control System Design Guide, 4th ed., chapter 7: the response to a disturbance"
    time_power: ClassVar[float] = 1
    options: ClassVar[tuple[str, ...]] = ("recovery_band",)
    of_the_end: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unsettled(subject.verdict)
        if refusal is not None:
            return refusal
        if subject.final is None:
            return Absent(
                verdict=Verdict.NOT_APPLICABLE, advice="it needs commands that settle at a constant, such as a step"
            )
        band = subject.options.recovery_band
        assert band is not None
        start = float(subject.loading[0].real)
        before = _just_before(subject, start)
        left = abs(float((subject.final - before)[0].real))
        if left > band:
            return Absent(
                verdict=Verdict.NEVER_CROSSES,
                advice=f"the output comes to rest {left:.3g} from where it was: add integral action or widen the band",
            )
        away = away_from(subject, before, band).since(start)
        half = np.full(1, band)
        lasts = [next((t for t, _ in away.crossings(edge, backwards=True)), None) for edge in (half, -half)]
        entry = max((t for t in lasts if t is not None), key=lambda t: float(t[0].real), default=subject.loading)
        return Found(value=entry - subject.loading, at=float(entry[0].real), one_sided=grazes(away, half))


def _just_before(subject: TimeSubject, start: float) -> Array:
    """Return the output at the end of what goes before an instant, as the instant itself moves."""
    curve = subject.curve
    if start <= curve.times[0]:
        return subject.initial
    ends = np.flatnonzero(
        np.abs(curve.times[1:] - start) <= 1e-12 * start
    )  # a command breaks the curve where it begins
    return curve.values[ends[0], -1] if len(ends) else curve.read(start)
