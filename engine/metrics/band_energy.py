"""How much of the movement lies in a band of the spectrum, where a structure resonates, say.

(1/π) ∫ |Y(jω)|² dω over the band;   over all frequencies that is ∫ y² dt
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.exact.frequency.energy import band_energy
from engine.metrics._base import NEGLIGIBLE, Absent, Found, TimeMetric, unsettled
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class BandEnergy(TimeMetric):
    """How much of the movement lies in a band of the spectrum."""

    kind: ClassVar[str] = "band_energy"
    title: ClassVar[str] = "Energy in a band"
    unit: ClassVar[str] = "output**2*s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Energy of the output's departure from its initial value in the band, (1/π) ∫ |Y(jω)|² dω."
    )
    source: ClassVar[str] = "Parseval's theorem: A. Oppenheim, A. Willsky, Signals and Systems, 2nd ed., section 4.3.7"
    amplitude_power: ClassVar[int] = 2
    time_power: ClassVar[float] = 1
    of_the_end: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unsettled(subject.verdict)
        if refusal is not None:
            return refusal
        if subject.band is None:
            return Absent(verdict=Verdict.NOT_APPLICABLE, advice="it needs 'band': two angular frequencies")
        if subject.final is None:
            advice = "it needs a command that settles at a constant: one without end has infinite energy"
            return Absent(verdict=Verdict.NOT_APPLICABLE, advice=advice)
        low, high = subject.band
        away = subject.final - subject.initial
        largest = float(np.abs(subject.curve.values[:, :, 0].real).max())
        stays_away = abs(float(away[0].real)) > NEGLIGIBLE * largest
        if stays_away and low == 0:
            advice = "the output stays away from where it began: begin the band above 0 rad/s, or look at its velocity"
            return Absent(verdict=Verdict.DIVERGES, advice=advice)
        departure = subject.curve + -subject.initial
        return Found(value=band_energy(departure, low, high, final=away if stays_away else None))
