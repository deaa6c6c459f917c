"""Linear pneumatic motor (LPM): a cylinder moved by a flow of compressible air.

Q = A z' + a_m Δp + (V/(χ p)) Δp',   m z'' + b_m z' + F = A Δp
"""

from __future__ import annotations

from engine.elements import _linear_motor
from engine.elements._base import Element, Ports, Realization, Values
from engine.model.parameters import Param


class LinearPneumaticMotor(Element):
    """Eq. (1)-(2) of the paper, with the load path that it leaves out; defaults are its mid-range values.

    ``force`` is the load: positive opposes the motion. It acts on the acceleration at once.
    """

    kind = "linear_pneumatic_motor"
    title = "Linear pneumatic motor"
    equation = "Q = A z' + a_m Δp + (V/(χ p)) Δp';  m z'' + b_m z' + F = A Δp"
    source = (
        "Assisted optimization of the dynamic behaviour of industrial robots, eq. (1)-(2), Fig. 2. The defaults are from the "
        "middle of its ranges: A 50-80 cm², V 500-1000 cm³, Δp 4-6 daN/cm², a_m 0.2-0.7 cm⁵/(daN s), "
        "m 0.1-0.6 daN s²/cm, b_m 0.8-1.8 daN s/cm."
    )
    parameters = (
        _linear_motor.area(65e-4),
        Param(
            name="volume", symbol="V", unit="m**3", default=750e-6, lower=0.0, lower_open=True, scale="log",
            doc="volume of the rooms under pressure",
        ),
        Param(
            name="pressure", symbol="p", unit="Pa", default=5e5, lower=0.0, lower_open=True, scale="log",
            doc="absolute working pressure",
        ),
        Param(
            name="adiabatic_index", symbol="χ", unit="1", default=1.4, lower=0.0, lower_open=True,
            doc="ratio of the specific heats: 1.4 for air, 1 for isothermal change",
        ),
        *_linear_motor.load(leakage=0.4e-11, mass=300.0, viscous_friction=1200.0),
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return flow and force; position, velocity, acceleration and pressure difference."""
        return _linear_motor.PORTS

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the physical states, with the capacitance V/(χ p) of a gas."""
        return _linear_motor.realize(
            area=values["area"],
            capacitance=values["volume"] / (values["adiabatic_index"] * values["pressure"]),
            leakage=values["leakage"],
            mass=values["mass"],
            viscous_friction=values["viscous_friction"],
        )
