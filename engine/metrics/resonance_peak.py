"""How much a frequency is amplified at worst on the way from a reference to an output.

Mr = max over ω of |y/r (jω)|
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import PathMetric
from engine.metrics._largest import highest_magnitude

if TYPE_CHECKING:
    from engine.metrics._base import Finding, PathSubject


@final
class ResonancePeak(PathMetric):
    """How much a frequency is amplified at worst on the way to an output."""

    kind: ClassVar[str] = "resonance_peak"
    title: ClassVar[str] = "Resonance peak"
    unit: ClassVar[str] = "output/input"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "The largest magnitude of the path, from a reference to the output say; its static gain where nothing resonates."
    )
    source: ClassVar[str] = "K. J. Astrom, R. M. Murray, Feedback Systems, 2nd ed., section 7.4"

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return highest_magnitude(subject)
