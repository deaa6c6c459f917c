"""Saturation: the output follows the input between two limits and stays at the limit beyond.

y = min(max(u, lower), upper)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from engine.elements._base import Array, Values
from engine.elements._fundamental import limited
from engine.elements._limiting import Limiting
from engine.elements._nonlinear import Mode, Moment, Signals
from engine.elements._three_zones import ThreeZones
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class Saturation(ThreeZones):
    """Limits of an actuator, an amplifier or a spool. Between the limits it is a gain of 1, exactly."""

    kind = "saturation"
    title = "Saturation"
    equation = "y = min(max(u, lower), upper)"
    source = "J.-J. E. Slotine, W. Li, Applied Nonlinear Control, Prentice Hall 1991, section 5.2."
    parameters = (
        Param(name="lower", symbol="u_min", default=-1.0, doc="least output"),
        Param(name="upper", symbol="u_max", default=1.0, doc="greatest output"),
    )
    example = {"lower": -2.0, "upper": 3.0}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse limits in the wrong order."""
        if values["lower"].real >= values["upper"].real:
            raise DiagramError(
                f"upper must be > lower ({values['lower'].real:g}), got {values['upper'].real:g}", at=("upper",)
            )

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the input (mode 0), the upper limit (1) or the lower one (-1)."""
        if mode == 0:
            return [m.z[0]]
        return [values["upper"] if mode > 0 else values["lower"]]

    @classmethod
    def limits(cls, values: Values) -> Sequence[tuple[Any, Any]]:
        """Return the limits."""
        return [(values["lower"], values["upper"])]

    @classmethod
    def limiting(cls, values: Values) -> Limiting:
        """Return the limits."""
        return Limiting(values["lower"], values["upper"])

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return the mean gain of the two half-waves, each cut off at its limit."""
        return 0.5 * (limited(values["upper"] / amplitude) + limited(-values["lower"] / amplitude)) + 0j
