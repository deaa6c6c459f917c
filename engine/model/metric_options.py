"""Numbers that a request may give to the metrics that ask for one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from engine.model.errors import DiagramError

USUAL_BAND = 0.02
"""Half of the band of a settling time, a part of the way, where none is given."""


OPTIONAL = frozenset({"derivative"})
"""Numbers that follow from something else where they are not given."""

MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "settling_band": "half of the band of `settling_time`, a part of the way: 0.02 is ±2 %",
        "recovery_band": "half of the band of `recovery_time`, in the output's unit",
        "derivative": "how often the output is differentiated for `max_velocity`, `max_acceleration` or `control_effort`: 0, 1 or 2",
        "noise_density": "of the white noise of `noise_rms`: one-sided power spectral density, (input's unit)² per Hz",
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What some metrics take besides where they are measured; None where it must be given to have the metric.

    Parameters
    ----------
    settling_band : float
        Half of the band of `settling_time` around the final value, a part of the way, 0..1.
    recovery_band : float, optional
        Half of the band of `recovery_time` around where the output was, unit of the output, > 0.
    derivative : int, optional
        How often the output is differentiated, 0..2; follows from its unit where it is not given.
    noise_density : float, optional
        Of the white noise of `noise_rms`: its one-sided power spectral density, (unit of the input)² per Hz, > 0.

    Raises
    ------
    DiagramError
        At the name of a number that is out of its range.
    """

    settling_band: float = USUAL_BAND
    recovery_band: float | None = None
    noise_density: float | None = None
    derivative: int | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.settling_band < 1.0:
            raise DiagramError(
                f"settling_band must be > 0 and < 1 of the way, got {self.settling_band:g}", at=("settling_band",)
            )
        if self.derivative not in {None, 0, 1, 2}:
            raise DiagramError(f"derivative must be 0, 1 or 2, got {self.derivative:g}", at=("derivative",))
        for name, unit in (("recovery_band", "in the output's unit"), ("noise_density", "in (input's unit)²/Hz")):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise DiagramError(f"{name} must be > 0 {unit}, got {value:g}", at=(name,))

    def lacking(self, names: tuple[str, ...]) -> str:
        """Return the first of the names of which there is no number, or an empty string."""
        return next((name for name in names if name not in OPTIONAL and getattr(self, name) is None), "")

    def needless(self, names: tuple[str, ...]) -> str:
        """Return the first number that is given and not among the names, or an empty string."""
        return next((n for n in MEANINGS if n not in names and getattr(self, n) != getattr(USUAL, n)), "")


USUAL = Options()
"""What holds where nothing is given."""
