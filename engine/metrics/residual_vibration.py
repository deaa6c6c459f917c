"""What goes on swinging after the command has ended.

(max y - min y) / 2 for t >= t_end
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Absent, Found, TimeMetric, unsettled
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.time.curve import Curve
    from engine.metrics._base import Finding, TimeSubject
    from engine.model.linear_system import Array


@final
class ResidualVibration(TimeMetric):
    """What goes on swinging after the command has ended."""

    kind: ClassVar[str] = "residual_vibration"
    title: ClassVar[str] = "Residual vibration"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = "Half the difference of the largest and the smallest value after the command ends."
    source: ClassVar[str] = "N. Singer, W. Seering, ASME J. Dyn. Syst. Meas. Control 112 (1990) 76-82"
    amplitude_power: ClassVar[int] = 1
    of_the_end: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        refusal = unsettled(subject.verdict)
        if refusal is not None:
            return refusal
        if subject.end is None:
            return Absent(verdict=Verdict.NOT_APPLICABLE, advice="it needs a command that ends")
        rest = subject.curve.since(subject.end)
        highest, lowest = (_of_rest(subject, rest, found) for found in (rest.largest(), rest.smallest()))
        if subject.final is not None:  # what is only approached counts as well
            highest = subject.final if subject.final[0].real > highest[0].real else highest
            lowest = subject.final if subject.final[0].real < lowest[0].real else lowest
        return Found(value=(highest - lowest) / 2, at=subject.end)


def _of_rest(subject: TimeSubject, rest: Curve, found: tuple[Array, float]) -> Array:
    """Return an extremum; one at the end of the command moves along the curve when that end moves."""
    value, instant = found
    if subject.moving_end is None or subject.end is None or instant != subject.end:
        return value
    return np.asarray(value + rest.slope.values[0, 0].real * (subject.moving_end - subject.end))
