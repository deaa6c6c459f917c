"""How much a path makes of white noise, and of an impulse.

‖G‖₂ = √((1/2π) ∫ |G(jω)|² dω) = √(∫ g² dt)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

from engine.metrics._base import PathMetric
from engine.metrics._noise import h2_norm

if TYPE_CHECKING:
    from engine.metrics._base import Finding, PathSubject


@final
class H2Norm(PathMetric):
    """How much a path makes of white noise, and of an impulse."""

    kind: ClassVar[str] = "h2_norm"
    title: ClassVar[str] = "H2 norm"
    unit: ClassVar[str] = "output/input/s**0.5"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Root of the energy of the path's impulse response, √(∫ g² dt); infinite where the path has a direct gain."
    )
    source: ClassVar[str] = "K. Zhou, J. Doyle, K. Glover, Robust and Optimal Control, section 4.6"
    time_power: ClassVar[float] = -0.5
    by_default: ClassVar[bool] = False

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        return h2_norm(subject)
