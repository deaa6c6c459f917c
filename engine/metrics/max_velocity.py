"""The largest absolute value of the velocity output named.

max |v(t)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric
from engine.metrics._largest import largest_magnitude

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class MaxVelocity(TimeMetric):
    """The largest absolute value of the velocity output named."""

    kind: ClassVar[str] = "max_velocity"
    title: ClassVar[str] = "Largest velocity"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "higher"
    definition: ClassVar[str] = (
        "The largest absolute value of the velocity: of the output named when its unit says so, of a position its first derivative. "
        "Without such a unit `derivative` says how often the output is differentiated."
    )
    source: ClassVar[str] = "the dynamic behaviour parameter v of the influence-coefficient method"
    belongs_to: ClassVar[tuple[str, ...]] = ("m/s", "rad/s")
    amplitude_power: ClassVar[int] = 1
    of_the_window: ClassVar[bool] = True
    order: ClassVar[int] = 1
    options: ClassVar[tuple[str, ...]] = ("derivative",)

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return largest_magnitude(subject)
