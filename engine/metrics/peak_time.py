"""When the output is largest.

t_p = argmax |y(t)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import TOUCHES, Absent, Found, TimeMetric
from engine.metrics._largest import largest_magnitude, seen
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class PeakTime(TimeMetric):
    """When the output is largest."""

    kind: ClassVar[str] = "peak_time"
    title: ClassVar[str] = "Peak time"
    unit: ClassVar[str] = "s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "Time from the command's start to the largest absolute value of the output."
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"
    time_power: ClassVar[float] = 1
    of_the_window: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        peak = largest_magnitude(subject)
        if isinstance(peak, Absent):
            return peak
        if peak.at is None or _barely(subject, float(peak.value[0].real)):
            return Absent(verdict=Verdict.NEVER_CROSSES, advice="the output approaches its final value without a peak")
        size = float(peak.value[0].real)
        return Found(
            value=subject.since_start(seen(subject).turning(peak.at)),
            at=peak.at,
            one_sided=_tied(subject, size, peak.at),
        )


def _tied(subject: TimeSubject, peak: float, at: float) -> bool:
    """Return whether another peak is as high: a little more or less, and the instant of the highest jumps there."""
    curve = seen(subject)
    instants, turns = curve.turnings(0.9 * peak)
    apart = np.abs(instants - at) > TOUCHES * curve.end
    return bool(np.any(apart & (np.abs(turns) >= (1 - TOUCHES) * peak)))


def _barely(subject: TimeSubject, peak: float) -> bool:
    """Return whether the peak exceeds the final value by so little that its instant is not defined by the curve."""
    if subject.final is None or subject.duration is not None:
        return False
    return peak - abs(float(subject.final[0].real)) <= 1e-8 * peak
