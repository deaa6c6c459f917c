"""Linear hydraulic motor (LHM): a symmetric cylinder moved by a flow of oil.

Q = A z' + a_m Δp + (V/(4 β)) Δp',   m z'' + b_m z' + F = A Δp
"""

from __future__ import annotations

from engine.elements import _linear_motor
from engine.elements._base import Element, Ports, Realization, Values
from engine.parameters import Param


class LinearHydraulicMotor(Element):
    """The structure of the pneumatic motor with oil: stiffer by three orders, damped mostly by leakage.

    ``force`` is the load: positive opposes the motion. The leakage default is the middle of the paper's Fig. 8
    (9.1 to 45 cm⁵/(daN·s)).
    """

    kind = "linear_hydraulic_motor"
    title = "Linear hydraulic motor"
    equation = "Q = A z' + a_m Δp + (V/(4 β)) Δp';  m z'' + b_m z' + F = A Δp"
    source = (
        "H. E. Merritt, Hydraulic Control Systems, Wiley 1967, section 6-1 (valve-piston, V/(4 β)); "
        "Assisted optimization of the dynamic behaviour of industrial robots, Figs. 3, 6, 8, 11."
    )
    parameters = (
        _linear_motor.area(65e-4),
        Param(
            name="volume", symbol="V", unit="m**3", default=1e-3, lower=0.0, lower_open=True, scale="log",
            doc="volume of both chambers together",
        ),
        Param(
            name="bulk_modulus", symbol="β", unit="Pa", default=1.4e9, lower=0.0, lower_open=True, scale="log",
            doc="effective bulk modulus of the oil with its air and the walls",
        ),
        *_linear_motor.load(leakage=27e-11, mass=300.0, viscous_friction=1200.0),
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return flow and force; position, velocity, acceleration and pressure difference."""
        return _linear_motor.PORTS

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the physical states, with the capacitance V/(4 β) of two oil columns."""
        return _linear_motor.realize(
            area=values["area"],
            capacitance=values["volume"] / (4.0 * values["bulk_modulus"]),
            leakage=values["leakage"],
            mass=values["mass"],
            viscous_friction=values["viscous_friction"],
        )
