"""Viscous damper: a force in proportion to the velocity between its ends.

F = d v
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class ViscousDamper(Element):
    """Linear dashpot; positive ``force`` opposes a positive ``velocity`` of one end against the other."""

    kind = "viscous_damper"
    title = "Viscous damper"
    equation = "F = d v"
    source = "Definition."
    parameters = (
        Param(
            name="damping", symbol="d", unit="N*s/m", lower=0.0, scale="log",
            doc="force for a velocity of 1 m/s between the ends",
        ),
    )  # fmt: skip
    example = {"damping": 500.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return velocity and force."""
        return Ports(inputs=("velocity",), outputs=("force",), output_units=("N",))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return F = d v."""
        return Realization.static(matrix([[values["damping"]]]))
