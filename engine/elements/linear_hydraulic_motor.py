"""Linear hydraulic motor (LHM): a symmetric or differential cylinder moved by a flow of oil.

Symmetric:     Q = A z' + (a_m + C_e/2) Δp + (V/(4 β)) Δp',   m z'' + b_m z' + F = A Δp
Differential:  Q = A z' + a_m (p1 - p2) + C_e p1 + (V1/β) p1',   α Q = A2 z' + a_m (p1 - p2) - C_e p2 - (V2/β) p2',
               m z'' + b_m z' + F = A p1 - A2 p2,   α = A2/A
"""

from __future__ import annotations

from engine.elements import _linear_motor
from engine.elements._base import Element, Ports, Realization, Values, absent, plain_zero, vanishing
from engine.model.parameters import Param, Scalar


class LinearHydraulicMotor(Element):
    """The structure of the pneumatic motor with oil: stiffer by three orders, damped mostly by leakage.

    ``force`` is the load: positive opposes the motion. The leakage default is the middle of the paper's Fig. 8
    (9.1 to 45 cm⁵/(daN·s)).

    Where ``rod_area`` or ``piston_volume_share`` is given, both rooms are modelled and their pressures are outputs.
    ``flow`` enters the piston side, and the valve lets α times as much return from the rod side, as it does at any
    steady operating point. ``pressure_difference`` is then the load pressure p1 - α p2, which makes the force A·p.
    """

    kind = "linear_hydraulic_motor"
    title = "Linear hydraulic motor"
    equation = (
        "Q = A z' + (a_m + C_e/2) Δp + (V/(4 β)) Δp';  m z'' + b_m z' + F = A Δp;  differential: "
        "Q = A z' + a_m (p1 - p2) + C_e p1 + (V1/β) p1';  α Q = A2 z' + a_m (p1 - p2) - C_e p2 - (V2/β) p2';  "
        "m z'' + b_m z' + F = A p1 - A2 p2;  α = A2/A"
    )
    source = (
        "H. E. Merritt, Hydraulic Control Systems, Wiley 1967, chapter 6 (valve controlled piston, V/(4 β)); "
        "M. Jelali and A. Kroll, Hydraulic Servo-systems, Springer 2003, chapter 4 (differential cylinder); "
        "Assisted optimization of the dynamic behaviour of industrial robots, Figs. 3, 6, 8, 11."
    )
    parameters = (
        _linear_motor.area(65e-4),
        Param(
            name="rod_area", symbol="A2", unit="m**2", required=False, lower=0.0, lower_open=True, scale="log",
            doc="effective area of the rod side where it differs from that of the piston side",
        ),
        Param(
            name="volume", symbol="V", unit="m**3", default=1e-3, lower=0.0, lower_open=True, scale="log",
            doc="volume of both chambers together",
        ),
        Param(
            name="piston_volume_share", symbol="V1/V", unit="1", required=False, lower=0.01, upper=0.99,
            doc="share of the piston side in the volume; absent: the piston in the middle, A/(A + A2)",
        ),
        _linear_motor.bulk_modulus(),
        *_linear_motor.load(leakage=27e-11, mass=300.0, viscous_friction=1200.0),
        _linear_motor.external_leakage(),
    )  # fmt: skip

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return flow and force; position, velocity, acceleration and pressures."""
        symmetric = _linear_motor.PORTS
        if _is_symmetric(values):
            return symmetric
        return Ports(
            inputs=symmetric.inputs,
            outputs=(*symmetric.outputs, "piston_pressure", "rod_pressure"),
            output_units=(*symmetric.output_units, "Pa", "Pa"),
            loads=symmetric.loads,
            input_units=symmetric.input_units,
        )

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return position, velocity and pressure difference as states, or both pressures where the rooms differ."""
        leakage, external = values["leakage"], values["external_leakage"]
        if _is_symmetric(values):
            return _linear_motor.realize(
                area=values["area"],
                capacitance=values["volume"] / (4.0 * values["bulk_modulus"]),
                leakage=leakage + external / 2.0,
                mass=values["mass"],
                viscous_friction=values["viscous_friction"],
            )
        area, rod = values["area"], values["rod_area"]
        rod = area if rod is None else rod
        ratio, share = rod / area, values["piston_volume_share"]
        share = area / (area + rod) if share is None else share
        compressed = values["volume"] / values["bulk_modulus"]
        rooms = compressed * share, compressed * (1.0 - share)
        # Oil that both rooms hold under pressure gets away to the tank, or through the piston where the areas differ.
        escape = plain_zero(external) + plain_zero(leakage) * plain_zero(area - rod) ** 2
        if absent(escape):
            return _one_pressure(values, ratio, rooms)
        return _two_pressures(values, ratio, rooms, trapped=vanishing(escape))


def _is_symmetric(values: Values) -> bool:
    return values["rod_area"] is None and values["piston_volume_share"] is None


def _one_pressure(values: Values, ratio: Scalar, rooms: tuple[Scalar, Scalar]) -> Realization:
    """Return the load pressure as the only state of the oil: what both rooms hold besides stays 0, moved by nothing.

    An infinitesimal leakage moves it, but acts on it only once more by itself: so motion and load pressure have their exact
    derivatives here. Those of the pressure of each room leave it out.
    """
    first, second = rooms
    together = second + ratio * ratio * first
    series = together * first * second
    across = values["leakage"] * (second + ratio * first) ** 2
    outwards = values["external_leakage"] * (second * second + ratio * ratio * first * first)
    return _linear_motor.realize_rooms(
        area=values["area"],
        mass=values["mass"],
        viscous_friction=values["viscous_friction"],
        push=[values["area"]],
        fill=[together / (first * second)],
        loss=[[-(across + outwards) / series]],
        pressures=[[1.0], [second / together], [-ratio * first / together]],
    )


def _two_pressures(values: Values, ratio: Scalar, rooms: tuple[Scalar, Scalar], *, trapped: Scalar) -> Realization:
    """Return both pressures as states; ``trapped`` is 1 for members of a batch where what both hold must decay unseen."""
    (first, second), area = rooms, values["area"]
    inside, lost = values["leakage"], values["leakage"] + values["external_leakage"]
    decay = trapped / (second + ratio * ratio * first)
    return _linear_motor.realize_rooms(
        area=area,
        mass=values["mass"],
        viscous_friction=values["viscous_friction"],
        push=[area, -ratio * area],
        fill=[1.0 / first, -ratio / second],
        loss=[
            [-lost / first - decay * ratio * ratio * first, inside / first - decay * ratio * second],
            [inside / second - decay * ratio * first, -lost / second - decay * second],
        ],
        pressures=[[1.0, -ratio], [1.0, 0.0], [0.0, 1.0]],
    )
