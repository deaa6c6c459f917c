"""Ideal gear: motion is divided by the ratio, the torque of the load comes back divided by it.

θ_l = θ_m/n,   M_m = M_L/n
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class Gear(Element):
    """Gear without losses: M_m ω_m = M_L ω_l. A loss that depends on the direction of the power is not linear.

    ``motion`` is the motor's angle, speed or acceleration, and ``load_motion`` the same of the load. ``load_torque`` is
    positive where it opposes the load's rotation; ``motor_torque`` then opposes the motor's, so it goes to the load_torque of a
    motor. A load inertia J_l adds J_l/n² to the motor's own.
    """

    kind = "gear"
    title = "Gear"
    equation = "θ_l = θ_m/n;  M_m = M_L/n"
    source = "Definition: no slip, and no loss of power."
    parameters = (
        Param(
            name="ratio", symbol="n", unit="1", lower=0.0, lower_open=True, scale="log",
            doc="turns of the motor for one of the load",
        ),
    )  # fmt: skip
    example = {"ratio": 10.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the motor's motion and the load's torque; the load's motion and the torque on the motor."""
        return Ports(
            inputs=("motion", "load_torque"), outputs=("load_motion", "motor_torque"), output_units=(None, "N*m")
        )

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the division of both."""
        share = 1.0 / values["ratio"]
        return Realization.static(matrix([[share, 0.0], [0.0, share]]))
