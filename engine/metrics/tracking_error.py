"""How far a response is from a reference of straight lines, in the mean square.

√(∫ (y - r)² dt / duration of the reference)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Found, TimeMetric
from engine.metrics._held import beyond_reach, differences
from engine.model.masks import Polyline

if TYPE_CHECKING:
    from engine.metrics._base import Finding, MaskKind, TimeSubject


@final
class TrackingError(TimeMetric):
    """How far a response is from a reference of straight lines, in the mean square."""

    kind: ClassVar[str] = "tracking_error"
    title: ClassVar[str] = "Tracking error"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "Root of the mean square of output minus reference over the reference's duration."
    source: ClassVar[str] = "L. Ljung, System Identification: Theory for the User, 2nd ed., section 7.2"
    amplitude_power: ClassVar[int] = 1
    mask: ClassVar[MaskKind] = "reference"

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        assert isinstance(subject.mask, Polyline)
        line = subject.mask
        refusal = beyond_reach(subject, line.times[-1])
        if refusal is not None:
            return refusal
        total = sum((part.squared().integral() for part in differences(subject, line)), np.zeros(1))
        span = sum(part.end - part.start for part in line.segments)
        return Found(value=np.sqrt(total / span) if total[0].real > 0 else np.zeros(total.shape))
