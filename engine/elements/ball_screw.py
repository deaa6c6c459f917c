"""Ball screw: rotation becomes travel, and the force on the nut comes back as a torque.

Rigid:   x = h θ,   M = h F,   h = lead/(2π)
Elastic: F = k (h θ - x) + d (h ω - v),   M = h F
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class BallScrew(Element):
    """Screw without friction: M ω = F v. ``torque`` opposes the rotation, so it goes to the load_torque of a motor.

    Rigid, ``motion`` is the angle, speed or acceleration of the screw, ``travel`` the same of the nut, and ``force`` is
    the load, positive where it opposes the travel. With an axial stiffness the nut's position is that of a mass of its own:
    ``force`` is then an output and pushes that mass. With an axial damping the velocities are inputs too.
    """

    kind = "ball_screw"
    title = "Ball screw"
    equation = "h = lead/(2π);  x = h θ, M = h F;  or elastic: F = k (h θ - x) + d (h ω - v), M = h F"
    source = (
        "Definition: no slip, and no loss of power; Y. Altintas et al., Machine tool feed drives, CIRP Annals 60, 2011."
    )
    parameters = (
        Param(
            name="lead", symbol="p", unit="m", default=0.01, lower=0.0, lower_open=True, scale="log",
            doc="travel for one turn",
        ),
        Param(
            name="stiffness", symbol="k", unit="N/m", required=False, lower=0.0, lower_open=True, scale="log",
            doc="axial stiffness of screw, nut and bearings; absent: rigid",
        ),
        Param(
            name="damping", symbol="d", unit="N*s/m", required=False, lower=0.0, scale="log",
            doc="axial damping beside the stiffness; absent: none",
        ),
    )  # fmt: skip

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse an axial damping of a rigid screw."""
        if "damping" in given and "stiffness" not in given:
            raise DiagramError("damping must be absent where there is no stiffness", at=("damping",))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return motion and force; travel and torque. Elastic: both motions; force and torque."""
        if values["stiffness"] is None:
            return Ports(inputs=("motion", "force"), outputs=("travel", "torque"), output_units=(None, "N*m"))
        moving = () if values["damping"] is None else ("speed", "velocity")
        return Ports(inputs=("angle", "position", *moving), outputs=("force", "torque"), output_units=("N", "N*m"))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the ratio of travel to rotation both ways, or the elastic force."""
        ratio, stiffness, damping = values["lead"] / (2.0 * np.pi), values["stiffness"], values["damping"]
        if stiffness is None:
            return Realization.static(matrix([[ratio, 0.0], [0.0, ratio]]))
        force = [stiffness * ratio, -stiffness]
        if damping is not None:
            force += [damping * ratio, -damping]
        return Realization.static(matrix([force, [ratio * share for share in force]]))
