"""Up to which frequency the output follows.

first ω with |T(jω)| = 10^(-3/20) |T(0)|
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.exact.frequency.shapes import squared_magnitude
from engine.exact.frequency.touching import touches
from engine.metrics._base import NEGLIGIBLE, TOUCHES, Absent, Found, PathMetric, unsettled
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, PathSubject


@final
class Bandwidth(PathMetric):
    """Up to which frequency the output follows."""

    kind: ClassVar[str] = "bandwidth"
    title: ClassVar[str] = "Bandwidth"
    unit: ClassVar[str] = "rad/s"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = "First frequency at which the magnitude falls 3 dB (10^(-3/20)) below its static value."
    source: ClassVar[str] = (
        "G. Franklin, J. D. Powell, A. Emami-Naeini, Feedback Control of Dynamic Systems, section 6.1"
    )
    time_power: ClassVar[float] = -1
    absent_is_infinite: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unsettled(subject.verdict)
        if refusal is not None:
            return refusal
        assert subject.static is not None
        top = float(subject.response.peak(squared_magnitude)[0][0].real)
        if abs(float(subject.static[0].real)) <= NEGLIGIBLE * math.sqrt(max(top, 0.0)):
            return Absent(
                verdict=Verdict.ZERO_STATIC_GAIN, advice="the static gain is 0, so there is nothing to fall 3 dB from"
            )
        level = subject.static**2 * 10**-0.3
        crossing = next(iter(subject.response.crossings(squared_magnitude, level)), None)
        if crossing is None:
            return Absent(verdict=Verdict.NEVER_CROSSES, advice="the magnitude never falls 3 dB below its static value")
        at, height = float(crossing[0].real), float(level[0].real)
        jumps = touches(subject.response, squared_magnitude, height, tolerance=TOUCHES * height, until=at)
        return Found(value=crossing, at=at, one_sided=jumps)
