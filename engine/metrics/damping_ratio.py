"""How well the least damped mode is damped.

min over pairs of -Re p / |p|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, SystemMetric, oscillatory
from engine.verdicts import Verdict

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
        "Smallest damping ratio of any complex pole pair; of the endless many of a loop with a delay, the dominant pair's."
    )
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"

    @classmethod
    def measure(cls, subject: SystemSubject) -> Finding:
        """Return the value or the reason why there is none."""
        pairs = oscillatory(subject)
        if not pairs:
            return Absent(verdict=Verdict.NOT_OSCILLATORY, advice="the system has no complex pole pair")
        ratios = [(-real / np.sqrt(real * real + imaginary * imaginary), imaginary) for real, imaginary in pairs]
        value, imaginary = min(ratios, key=lambda pair: float(pair[0][0].real))
        return Found(value=value, at=float(abs(imaginary[0].real)))
