"""How much the reference is amplified at worst.

Mt = max over ω of |L / (1 + L)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.exact.frequency.shapes import squared_complementary
from engine.metrics._base import Absent, LoopMetric, unclosed
from engine.metrics._largest import highest
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject


@final
class ComplementaryPeak(LoopMetric):
    """How much the reference is amplified at worst."""

    kind: ClassVar[str] = "complementary_peak"
    title: ClassVar[str] = "Complementary sensitivity peak"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "How much the reference is amplified at worst."
    usual_unit: ClassVar[str] = "dB"
    seldom_beyond: ClassVar[float] = 4.0
    source: ClassVar[str] = "K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., chapter 10"

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unclosed(subject)
        if refusal is not None:
            return refusal
        if subject.verdict is not Verdict.OK:
            return Absent(
                verdict=Verdict.DIVERGES, advice="the closed loop has poles on the imaginary axis: the peak is infinite"
            )
        static, direct = subject.static, subject.response.direct
        at_rest = np.ones(1) if static is None else static / (1 + static)  # with an integrator L(0) is infinite
        return highest(subject.response, squared_complementary, at_rest=at_rest, at_infinity=direct / (1 + direct))
