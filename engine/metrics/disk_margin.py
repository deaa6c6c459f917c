"""How much gain and phase the loop bears at once: the symmetric disk margin.

α = 1 / max |S(jω) - 1/2|,   S - 1/2 = (1 - L) / (2 (1 + L))

The loop stays stable for every factor in the disk with the diameter from (2 - α)/(2 + α) to (2 + α)/(2 - α): the gain may change by
either of them, the phase by ±2 atan(α/2).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.exact.frequency.response import SMALLEST_LOOP_GAIN
from engine.exact.frequency.shapes import squared_balanced_sensitivity
from engine.metrics._base import Absent, Found, LoopMetric, unclosed
from engine.metrics._largest import highest
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.metrics._base import Finding, LoopSubject


@final
class DiskMargin(LoopMetric):
    """How much gain and phase the loop bears at once."""

    kind: ClassVar[str] = "disk_margin"
    title: ClassVar[str] = "Disk margin"
    unit: ClassVar[str] = "1"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = (
        "Symmetric disk margin α = 1 / max |S - 1/2|: the loop bears gains from (2 - α)/(2 + α) to (2 + α)/(2 - α), phases of "
        "±2 atan(α/2), and both together within the disk of these. At most 2 for a loop gain that fades."
    )
    source: ClassVar[str] = (
        "P. Seiler, A. Packard, P. Gahinet, An Introduction to Disk Margins, IEEE Control Systems Magazine 40(5), 2020, σ = 0"
    )

    @classmethod
    def measure(cls, subject: LoopSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unclosed(subject)
        if refusal is not None:
            return refusal
        if subject.verdict is not Verdict.OK:
            return Absent(
                verdict=Verdict.DIVERGES, advice="the closed loop has poles on the imaginary axis: the disk margin is 0"
            )
        response, static, direct = subject.response, subject.static, subject.response.direct
        half = np.full(response.system.lanes, 0.5)
        at_rest = half if static is None else 1 / (1 + static) - 0.5  # with an integrator L(0) is infinite
        found = highest(response, squared_balanced_sensitivity, at_rest=at_rest, at_infinity=1 / (1 + direct) - 0.5)
        if isinstance(found, Absent):
            return found
        faded = response.system.m > 0 and abs(response.scan[1][-1]) < SMALLEST_LOOP_GAIN
        if faded and float(found.value[0].real) <= 0.5:  # behind a delay, too, L ends at 0
            return Found(value=1 / half)
        return Found(value=1 / found.value, at=found.at, kinked=found.kinked)
