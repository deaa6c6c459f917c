"""Dead zone: nothing happens between two limits, beyond them the output follows what exceeds them.

y = u - upper (u > upper),   0,   u - lower (u < lower)
"""

from __future__ import annotations

from engine.elements._base import Array, Values
from engine.elements._fundamental import limited
from engine.elements._limiting import Limiting, Shape
from engine.elements._nonlinear import Mode, Moment, Signals
from engine.elements._three_zones import ThreeZones
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class DeadZone(ThreeZones):
    """Overlap of a valve, play without a memory, an insensitive sensor."""

    kind = "dead_zone"
    title = "Dead zone"
    equation = "y = u - upper (u > upper), 0 between, u - lower (u < lower)"
    source = "J.-J. E. Slotine, W. Li, Applied Nonlinear Control, Prentice Hall 1991, section 5.2."
    note = "the slope of the dead zone at its operating point counts: 0 inside, 1 outside"
    parameters = (
        Param(name="lower", symbol="u_1", default=-1.0, doc="lower edge"),
        Param(name="upper", symbol="u_2", default=1.0, doc="upper edge"),
    )
    example = {"lower": -0.2, "upper": 0.3}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse edges in the wrong order."""
        if values["lower"].real > values["upper"].real:
            raise DiagramError(
                f"upper must be >= lower ({values['lower'].real:g}), got {values['upper'].real:g}", at=("upper",)
            )

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return 0 (mode 0), or what exceeds the upper edge (1) or the lower one (-1)."""
        if mode == 0:
            return [0.0 * m.z[0]]
        return [m.z[0] - (values["upper"] if mode > 0 else values["lower"])]

    @classmethod
    def limiting(cls, values: Values) -> Limiting:
        """Return what is beyond the edges."""
        return Limiting(values["lower"], values["upper"], shape=Shape.BEYOND)

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return what a limiter at the two edges leaves of the sine."""
        return 1.0 - 0.5 * (limited(values["upper"] / amplitude) + limited(-values["lower"] / amplitude)) + 0j
