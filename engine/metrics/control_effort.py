"""The largest absolute value of the control output named.

max |u(t)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric
from engine.metrics._largest import largest_magnitude

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class ControlEffort(TimeMetric):
    """The largest absolute value of the control output named."""

    kind: ClassVar[str] = "control_effort"
    title: ClassVar[str] = "Control effort"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "The largest absolute value of what a controller or actuator gives, the output named. "
        "Without such a unit `derivative` says how often the output is differentiated."
    )
    source: ClassVar[str] = "S. Skogestad, I. Postlethwaite, Multivariable Feedback Control, 2nd ed., section 2.4"
    belongs_to: ClassVar[tuple[str, ...]] = ("1", "V", "A", "m**3/s")
    amplitude_power: ClassVar[int] = 1
    of_the_window: ClassVar[bool] = True
    order: ClassVar[int] = 0
    options: ClassVar[tuple[str, ...]] = ("derivative",)

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return largest_magnitude(subject)
