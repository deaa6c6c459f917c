"""Direct-current motor with a constant field: armature circuit, back EMF, inertia, friction and load torque.

u = R i + L i' + K_e ω,   J ω' = K_t i - b ω - M_L,   θ' = ω
ω/u = K_t / (L J s² + (R J + L b) s + R b + K_t K_e),   ω/M_L = -(L s + R) / (the same)
"""

from __future__ import annotations

from engine.elements import _electric_motor
from engine.elements._base import Element, Ports, Realization, Values, absent, plain_zero, vanishing
from engine.model.parameters import Param


class DcMotor(Element):
    """Motor driven by its armature voltage; ``load_torque`` is positive where it opposes the rotation.

    An inductance of 0 is the common simplification: the current then follows at once. There the derivative in the
    inductance does not exist (the current would have to jump), so an infinitesimal on it is dropped. The defaults are
    typical of a servo motor of 1 kW, with the middle resistance of the paper's comparison (0.33, 0.5, 0.8 ohm).
    """

    kind = "dc_motor"
    title = "DC motor"
    equation = "u = R i + L i' + K_e ω;  J ω' = K_t i - b ω - M_L;  θ' = ω"
    source = (
        "G. F. Franklin, J. D. Powell and A. Emami-Naeini, Feedback Control of Dynamic Systems, chapter 2; "
        "Assisted optimization of the dynamic behaviour of industrial robots, Fig. 4."
    )
    parameters = (
        Param(
            name="resistance", symbol="R_a", unit="ohm", default=0.5, lower=0.0, lower_open=True, scale="log",
            doc="resistance of the armature, brushes and leads included",
        ),
        Param(
            name="inductance", symbol="L_a", unit="H", default=1e-3, lower=0.0, scale="log",
            doc="inductance of the armature; 0 lets the current follow at once",
        ),
        Param(
            name="back_emf_constant", symbol="K_e", unit="V*s/rad", default=0.2, lower=0.0, scale="log",
            doc="voltage induced at a speed of 1 rad/s; without losses in the iron as large as the torque constant",
        ),
        *_electric_motor.shaft(torque_constant=0.2, inertia=2e-3, viscous_friction=1e-3),
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return voltage and load torque; angle, speed, acceleration, current and torque."""
        return _electric_motor.ports("voltage")

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return angle, speed and current as states; without inductance only the first two."""
        resistance, inductance, induced = (
            values["resistance"],
            plain_zero(values["inductance"]),
            values["back_emf_constant"],
        )
        shaft = {name: values[name] for name in ("torque_constant", "inertia", "viscous_friction")}
        if absent(inductance):
            return _electric_motor.realize(
                rate=None, drive=0.0, current=[-induced / resistance], direct=1.0 / resistance, **shaft
            )
        # In a batch, a member without inductance takes its current from the voltage and lets the state decay unseen.
        ideal = vanishing(inductance)
        charge = inductance + ideal
        return _electric_motor.realize(
            rate=[-induced / charge, -resistance / charge],
            drive=1.0 / charge,
            current=[-ideal * induced / resistance, 1.0 - ideal],
            direct=ideal / resistance,
            **shaft,
        )
