"""Integrated error.

|∫ (r - y) dt|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import TimeMetric
from engine.metrics._integrals import integral_of_error

if TYPE_CHECKING:
    from engine.metrics._base import Finding, TimeSubject


@final
class Ie(TimeMetric):
    """Integrated error: after a step of load on the plant's input it is 1/ki, whatever the plant."""

    kind: ClassVar[str] = "ie"
    title: ClassVar[str] = "Integrated error"
    unit: ClassVar[str] = "output*s"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Magnitude of the integral of the error with its sign, from the command's start to the duration, or to infinity."
    )
    source: ClassVar[str] = "K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006, section 4.2"
    amplitude_power: ClassVar[int] = 1
    time_power: ClassVar[float] = 1
    of_the_error: ClassVar[bool] = True

    @classmethod
    def measure(cls, subject: TimeSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return integral_of_error(subject, "ie")
