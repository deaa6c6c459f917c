"""The frequency at which the system wants to swing.

|p| of the complex pole pair with the largest real part
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, SystemMetric
from engine.metrics._poles import oscillatory
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, SystemSubject


@final
class CriticalFrequency(SystemMetric):
    """The frequency at which the system wants to swing."""

    kind: ClassVar[str] = "critical_frequency"
    title: ClassVar[str] = "Critical frequency"
    unit: ClassVar[str] = "rad/s"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = "Undamped natural frequency of the complex pole pair with the largest real part."
    source: ClassVar[str] = (
        "the critical frequency of the influence-coefficient method; natural frequency of the dominant oscillatory pair"
    )
    time_power: ClassVar[float] = -1

    @classmethod
    def measure(cls, subject: SystemSubject) -> Finding:
        """Return the value or the reason why there is none."""
        pairs = oscillatory(subject)
        if not pairs:
            return Absent(verdict=Verdict.NOT_OSCILLATORY, advice="the system has no complex pole pair")
        real, imaginary = max(pairs, key=lambda pair: float(pair[0][0].real))
        return Found(value=np.sqrt(real * real + imaginary * imaginary), at=float(abs(imaginary[0].real)))
