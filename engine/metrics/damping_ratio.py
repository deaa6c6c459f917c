"""How well the least damped mode is damped.

min -Re p / |p| over all poles p but those at 0
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, SystemMetric
from engine.metrics._poles import oscillatory, real_poles
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, SystemSubject


@final
class DampingRatio(SystemMetric):
    """How well the least damped mode is damped."""

    kind: ClassVar[str] = "damping_ratio"
    title: ClassVar[str] = "Damping ratio"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = (
        "Smallest -Re p / |p| of any pole p: a real stable pole has 1, an unstable one -1. A pole at 0 only integrates and has "
        "none; a system without other poles has an infinite one. Of the endless many pairs of a loop with a delay those count "
        "of which more than 1/e is left after the delay, and the dominant one."
    )
    range: ClassVar[tuple[float, float]] = (-1.0, 1.0)
    usual_unit: ClassVar[str] = "%"
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"
    absent_is_infinite: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: SystemSubject) -> Finding:
        """Return the value or the reason why there is none."""
        ratios = [
            (-real / np.sqrt(real * real + imaginary * imaginary), imaginary)
            for real, imaginary in oscillatory(subject)
        ]
        ratios += [(-np.sign(real.real), np.zeros_like(real)) for real in real_poles(subject)]
        if not ratios:
            return Absent(
                verdict=Verdict.NOT_OSCILLATORY, advice="the system has no pole but at 0: the damping ratio is infinite"
            )
        value, imaginary = min(ratios, key=lambda pair: float(pair[0][0].real))
        return Found(value=value, at=float(abs(imaginary[0].real)))
