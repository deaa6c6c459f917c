"""The largest absolute value of the output.

max |y(t)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric
from engine.metrics._largest import largest_magnitude

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class Peak(TimeMetric):
    """The largest absolute value of the output."""

    kind: ClassVar[str] = "peak"
    title: ClassVar[str] = "Peak"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "The largest absolute value of the output. Nothing is differentiated: name the output that carries it."
    )
    source: ClassVar[str] = "K. Ogata, Modern Control Engineering, 5th ed., section 5-3"
    amplitude_power: ClassVar[int] = 1
    of_the_window: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return largest_magnitude(subject)
