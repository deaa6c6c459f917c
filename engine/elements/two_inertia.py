"""Two inertias on a flexible joint, with a gear between them where there is one.

φ = θ_m/n - θ_l,   M_s = k φ + d φ'
J_m ω_m' = M - b_m ω_m - M_s/n,   J_l ω_l' = M_s - b_l ω_l - M_L
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values, by_rates, matrix
from engine.model.parameters import Param, Scalar


def _friction(side: str, symbol: str) -> Param:
    return Param(
        name=f"{side}_friction", symbol=symbol, unit="N*m*s/rad", default=0.0, lower=0.0, scale="log",
        doc=f"viscous friction torque on the {side} side for a speed of 1 rad/s there",
    )  # fmt: skip


def _inertia(side: str, symbol: str) -> Param:
    return Param(
        name=f"{side}_inertia", symbol=symbol, unit="kg*m**2", lower=0.0, lower_open=True, scale="log",
        doc=f"moment of inertia on the {side} side",
    )  # fmt: skip


class TwoInertia(Element):
    """Motor, gear, flexible shaft and load. The flexibility is counted on the load side of the gear.

    ``load_torque`` is positive where it opposes the rotation; ``shaft_torque`` is what the shaft drives the load with.
    With gear_ratio 1, stiff shafts resonate at sqrt(k (1/J_m + 1/J_l)), and the motor stands still at sqrt(k/J_l).
    """

    kind = "two_inertia"
    title = "Two inertias on a flexible joint"
    equation = "φ = θ_m/n - θ_l;  M_s = k φ + d φ';  J_m ω_m' = M - b_m ω_m - M_s/n;  J_l ω_l' = M_s - b_l ω_l - M_L"
    source = "M. W. Spong, Modeling and control of elastic joint robots, ASME J. Dyn. Syst. Meas. Control 109, 1987."
    parameters = (
        _inertia("motor", "J_m"),
        _inertia("load", "J_l"),
        Param(
            name="stiffness", symbol="k", unit="N*m/rad", lower=0.0, scale="log",
            doc="torque of the shaft for a twist of 1 rad",
        ),
        Param(
            name="damping", symbol="d", unit="N*m*s/rad", default=0.0, lower=0.0, scale="log",
            doc="torque of the shaft for a twist that grows by 1 rad/s",
        ),
        _friction("motor", "b_m"),
        _friction("load", "b_l"),
        Param(
            name="gear_ratio", symbol="n", unit="1", default=1.0, lower=0.0, lower_open=True, scale="log",
            doc="turns of the motor for one of the load",
        ),
    )  # fmt: skip
    example = {"motor_inertia": 2e-3, "load_inertia": 5e-3, "stiffness": 200.0, "damping": 0.02}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return both torques; the motion of both sides and the torque of the shaft."""
        motion = ("angle", "speed", "acceleration")
        return Ports(
            inputs=("motor_torque", "load_torque"),
            outputs=(*(f"{side}_{name}" for side in ("motor", "load") for name in motion), "shaft_torque"),
            output_units=("rad", "rad/s", "rad/s**2", "rad", "rad/s", "rad/s**2", "N*m"),
            loads=("load_torque",),
            input_units=("N*m", "N*m"),
        )

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return load angle, twist, motor speed and load speed as states.

        The twist is a state, not the difference of two angles that grow without bound and take its digits away.
        """
        ratio = values["gear_ratio"]
        damping = values["damping"]
        shaft: list[Scalar] = [0.0, values["stiffness"], damping / ratio, -damping]
        motor, load = 1.0 / values["motor_inertia"], 1.0 / values["load_inertia"]
        lost = {"motor": values["motor_friction"], "load": values["load_friction"]}
        motor_rate = [-(torque / ratio) * motor for torque in shaft]
        motor_rate[2] = motor_rate[2] - lost["motor"] * motor
        load_rate = [torque * load for torque in shaft]
        load_rate[3] = load_rate[3] - lost["load"] * load
        c = matrix([
            [ratio, ratio, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], motor_rate,
            [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], load_rate,
            shaft,
        ])  # fmt: skip
        d = matrix([
            [0.0, 0.0], [0.0, 0.0], [motor, 0.0],
            [0.0, 0.0], [0.0, 0.0], [0.0, -load],
            [0.0, 0.0],
        ])  # fmt: skip
        return Realization(
            a=matrix([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0 / ratio, -1.0], motor_rate, load_rate]),
            b=matrix([[0.0, 0.0], [0.0, 0.0], [motor, 0.0], [0.0, -load]]),
            c=c, d=d, reading=by_rates(c, d, {2: [0.0, 0.0, 1.0, 0.0], 5: [0.0, 0.0, 0.0, 1.0]}),
        )  # fmt: skip
