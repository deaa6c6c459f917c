"""How much white noise at an input, that of a sensor say, moves an output.

σ² = ∫₀^∞ S |G(j 2π f)|² df = S/2 ‖G‖₂²,   S one-sided, per Hz
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, final

import numpy as np

from engine.metrics._base import Found, PathMetric
from engine.metrics._noise import h2_norm

if TYPE_CHECKING:
    from engine.metrics._base import Finding, PathSubject


@final
class NoiseRms(PathMetric):
    """How much white noise at an input moves an output."""

    kind: ClassVar[str] = "noise_rms"
    title: ClassVar[str] = "Noise, effective value"
    unit: ClassVar[str] = "output"
    better: ClassVar[Literal["lower", "higher"]] = "lower"
    definition: ClassVar[str] = (
        "Standard deviation of the output for white noise at the input of the one-sided power spectral density "
        "`noise_density`: √(noise_density/2) times the H2 norm."
    )
    source: ClassVar[str] = "K. J. Astrom, Introduction to Stochastic Control Theory, chapter 5"
    options: ClassVar[tuple[str, ...]] = ("noise_density",)

    @classmethod
    def measure(cls, subject: PathSubject) -> Finding:
        """Return the value or the reason why there is none."""
        found, density = h2_norm(subject), subject.options.noise_density
        assert density is not None
        if not isinstance(found, Found):
            return found
        return Found(value=found.value * np.sqrt(density / 2), one_sided=found.one_sided)
