"""Drives and mechanics against their physical laws at 40 digits: all paths, and their exact derivatives, to 1e-12.

The laws below are written from the balances of force, torque, flow and voltage, each for itself, in s and for any kind of
number; where they are several they are solved at 40 digits. A derivative is that of the law, so that no step size enters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from engine.elements import Realization, catalogue
from engine.model.traced import Graph, Traced, nominal
from tests.reference import mpmath_oracle as oracle

mp = oracle.mp

FREQUENCIES = (0.02, 3.0, 41.0, 700.0, 3e4)
STEP = 1e-30

Rows = Sequence[Sequence[Any]]
Law = Callable[[Any, Mapping[str, Any]], Rows]
"""(s, parameters) -> one row for each output, with an entry for each input."""


def solved(equations: Rows, drives: Rows) -> list[list[Any]]:
    """Return X of equations X = drives: a row for each unknown, a column for each input."""
    columns = [mp.lu_solve(mp.matrix(equations), mp.matrix(list(column))) for column in zip(*drives, strict=True)]
    return [[column[i] for column in columns] for i in range(len(equations))]


def motion(s: Any, row: Sequence[Any]) -> list[list[Any]]:
    """Return a displacement, its velocity and its acceleration."""
    return [[s**power * entry for entry in row] for power in range(3)]


def hydraulic_load(s: Any, *, area: Any, capacity: Any, leakage: Any, mass: Any, friction: Any) -> Rows:
    """A z s + (a + C s) p = Q,  (m s² + b s) z - A p = -F, for z and p; a turning load by the same equations."""
    z, p = solved([[area * s, leakage + capacity * s], [mass * s**2 + friction * s, -area]], [[1, 0], [0, -1]])
    return [*motion(s, z), p]


def pneumatic_motor(s: Any, p: Mapping[str, Any]) -> Rows:
    return hydraulic_load(
        s, area=p["area"], capacity=p["volume"] / (p["adiabatic_index"] * p["pressure"]), leakage=p["leakage"],
        mass=p["mass"], friction=p["viscous_friction"],
    )  # fmt: skip


def symmetric_cylinder(s: Any, p: Mapping[str, Any]) -> Rows:
    # Two rooms of half the volume: (Q - A z' - C_i Δp - C_e p1) = V/(2β) p1', and the same for p2 with the other sign;
    # half their difference is the law of Δp = p1 - p2.
    return hydraulic_load(
        s, area=p["area"], capacity=p["volume"] / (4 * p["bulk_modulus"]),
        leakage=p["leakage"] + p["external_leakage"] / 2, mass=p["mass"], friction=p["viscous_friction"],
    )  # fmt: skip


def rotary_motor(s: Any, p: Mapping[str, Any]) -> Rows:
    return hydraulic_load(
        s, area=p["displacement"], capacity=p["volume"] / (4 * p["bulk_modulus"]),
        leakage=p["leakage"] + p["external_leakage"] / 2, mass=p["inertia"], friction=p["viscous_friction"],
    )  # fmt: skip


def differential_cylinder(s: Any, p: Mapping[str, Any]) -> Rows:
    first_area, second_area = p["area"], p.get("rod_area", p["area"])
    share = p.get("piston_volume_share", first_area / (first_area + second_area))
    first, second = (p["volume"] * part / p["bulk_modulus"] for part in (share, 1 - share))
    inside, outside, ratio = p["leakage"], p["external_leakage"], second_area / first_area
    equations = [  # unknowns z, p1, p2: flow into the piston side, flow out of the rod side, force
        [first_area * s, inside + outside + first * s, -inside],
        [second_area * s, inside, -inside - outside - second * s],
        [p["mass"] * s**2 + p["viscous_friction"] * s, -first_area, second_area],
    ]
    z, p1, p2 = solved(equations, [[1, 0], [ratio, 0], [0, -1]])
    load_pressure = [one - ratio * other for one, other in zip(p1, p2, strict=True)]
    return [*motion(s, z), load_pressure, p1, p2]


def electric_shaft(s: Any, p: Mapping[str, Any], *, circuit: Sequence[Any], command: Any) -> Rows:
    """circuit[0] ω + circuit[1] i = command · u and (J s + b) ω - K_t i = -M_L, for ω and i."""
    mechanics = [p["inertia"] * s + p["viscous_friction"], -p["torque_constant"]]
    speed, current = solved([circuit, mechanics], [[command, 0], [0, -1]])
    angle = [entry / s for entry in speed]
    return [*motion(s, angle), current, [p["torque_constant"] * entry for entry in current]]


def dc_motor(s: Any, p: Mapping[str, Any]) -> Rows:
    return electric_shaft(
        s, p, circuit=[p["back_emf_constant"], p["resistance"] + p["inductance"] * s], command=1
    )  # fmt: skip


def ac_servo_axis(s: Any, p: Mapping[str, Any]) -> Rows:
    return electric_shaft(s, p, circuit=[0, 1 + s / p["current_bandwidth"]], command=1)


def power_amplifier(s: Any, p: Mapping[str, Any]) -> Rows:
    return [[p["gain"] / (1 + s / p["bandwidth"])]]


def spool(s: Any, p: Mapping[str, Any]) -> Any:
    if "time_constant" in p:
        return 1 / (1 + p["time_constant"] * s)
    x = s / p["natural_frequency"]
    return 1 / (1 + 2 * p["damping_ratio"] * x + x**2)


def lost(p: Mapping[str, Any]) -> list[Any]:
    return [-p["flow_pressure_coefficient"]] if "flow_pressure_coefficient" in p else []


def proportional_valve(s: Any, p: Mapping[str, Any]) -> Rows:
    return [[p["flow_gain"] * spool(s, p), *lost(p)]]


def servo_valve(s: Any, p: Mapping[str, Any]) -> Rows:
    # Both edges in series: Q = Q_N sqrt(drop/rated drop) at full opening, and at the centre the whole supply drops.
    opening = spool(s, p) / p["rated_current"]
    flow = p["rated_flow"] * mp.sqrt(p["supply_pressure"] / p["rated_pressure_drop"]) * opening
    return [[flow, *lost(p)], [opening, *[0 for _ in lost(p)]]]


def mass_spring_damper(s: Any, p: Mapping[str, Any]) -> Rows:
    resistance = p["damping"] * s + p["stiffness"]
    whole = p["mass"] * s**2 + resistance
    forced = [1 / whole, s / whole, s**2 / whole, resistance / whole]
    if "base" not in p:
        return [[entry] for entry in forced]
    moved = [resistance / whole, s * resistance / whole]
    if p["base"] == "displacement":
        return [[x, y] for x, y in zip(forced, moved, strict=False)]
    # Displacement and velocity of the base as two signals: the spring sees the one, the damper the other.
    spring, damper = p["stiffness"], p["damping"]
    return [
        *[[x, x * spring, x * damper] for x in forced[:3]],
        [forced[3], spring * (forced[3] - 1), damper * (forced[3] - 1)],
    ]


def two_mass_correction(s: Any, p: Mapping[str, Any]) -> Rows:
    (m2, m3, h1, h2), (k1, k2, k3, k4) = (
        [p[name] for name in names] for names in (("m2", "m3", "h1", "h2"), ("k1", "k2", "k3", "k4"))
    )
    top = h1 * h2 * s**2 + (h1 * k3 + h2 * k1) * s + k1 * k3
    a3 = m3 * h2 + m2 * h1 + m2 * h2
    a2 = h1 * h2 + m2 * (k1 + k2 + k3) + m3 * (k3 + k4)
    a1 = h1 * (k3 + k4) + h2 * (k1 + k2 + k4)
    a0 = k1 * k3 + k1 * k4 + k2 * k3 + k2 * k4 + k3 * k4
    return [[top / (m2 * m3 * s**4 + a3 * s**3 + a2 * s**2 + a1 * s + a0)]]


def two_inertia(s: Any, p: Mapping[str, Any]) -> Rows:
    n, shaft = p["gear_ratio"], p["stiffness"] + p["damping"] * s
    equations = [
        [p["motor_inertia"] * s**2 + p["motor_friction"] * s + shaft / n**2, -shaft / n],
        [-shaft / n, p["load_inertia"] * s**2 + p["load_friction"] * s + shaft],
    ]
    motor, load = solved(equations, [[1, 0], [0, -1]])
    torque = [shaft * (one / n - other) for one, other in zip(motor, load, strict=True)]
    return [*motion(s, motor), *motion(s, load), torque]


def gear(s: Any, p: Mapping[str, Any]) -> Rows:
    return [[1 / p["ratio"], 0], [0, 1 / p["ratio"]]]


def ball_screw(s: Any, p: Mapping[str, Any]) -> Rows:
    h = p["lead"] / (2 * mp.pi)
    if "stiffness" not in p:
        return [[h, 0], [0, h]]
    force = [h * p["stiffness"], -p["stiffness"]]
    if "damping" in p:
        force += [h * p["damping"], -p["damping"]]
    return [force, [h * entry for entry in force]]


def viscous_damper(s: Any, p: Mapping[str, Any]) -> Rows:
    return [[p["damping"]]]


def compliant_arm(s: Any, p: Mapping[str, Any]) -> Rows:
    def compliance(one: Sequence[Any], other: Sequence[Any]) -> Any:
        modes = zip(p["frequencies"], p["damping_ratios"], one, other, strict=True)
        return sum(a * b / (s**2 + 2 * d * w * s + w**2) for w, d, a, b in modes)

    base, end = p["base_shape"], p["end_effector_shape"]
    ends = [[compliance(x, base), compliance(x, end)] for x in (base, end)]
    rows = [[x, y, x - y] for x, y in ends]  # the damper pulls the base forth and the end-effector back
    stroke = [y - x for x, y in zip(*rows, strict=True)]
    return [*motion(s, rows[0]), *motion(s, rows[1]), stroke, [s * entry for entry in stroke]]


CYLINDER = {
    "area": 65e-4, "volume": 1e-3, "bulk_modulus": 1.4e9, "leakage": 27e-11, "mass": 300.0, "viscous_friction": 1200.0,
    "external_leakage": 4e-11,
}  # fmt: skip
DC = {
    "resistance": 0.33, "inductance": 1.5e-3, "back_emf_constant": 0.21, "torque_constant": 0.2, "inertia": 2e-3,
    "viscous_friction": 3e-3,
}  # fmt: skip
SPOOL = {"natural_frequency": 420.0, "damping_ratio": 0.65}
SERVO = {"rated_flow": 6e-4, "rated_current": 0.03, "rated_pressure_drop": 7e6, "supply_pressure": 16e6, **SPOOL}
MASS = {"mass": 40.0, "stiffness": 3e4, "damping": 150.0}
JOINT = {
    "motor_inertia": 2e-3, "load_inertia": 0.9, "stiffness": 4e3, "damping": 1.5, "motor_friction": 1e-3,
    "load_friction": 0.2, "gear_ratio": 30.0,
}  # fmt: skip
ARM = {
    "frequencies": [0.0, 40.0, 95.0, 260.0],
    "damping_ratios": [0.0, 0.02, 0.005, 0.03],
    "base_shape": [0.07, 0.05, 0.09, -0.02],
    "end_effector_shape": [0.07, 0.2, -0.12, 0.03],
}
CASES: list[tuple[str, Mapping[str, Any], Law]] = [
    ("linear_pneumatic_motor",
     {"area": 65e-4, "volume": 750e-6, "pressure": 5e5, "adiabatic_index": 1.4, "leakage": 0.4e-11, "mass": 300.0,
      "viscous_friction": 1200.0}, pneumatic_motor),
    ("linear_hydraulic_motor", CYLINDER, symmetric_cylinder),
    ("linear_hydraulic_motor", {**CYLINDER, "rod_area": 42e-4}, differential_cylinder),
    ("linear_hydraulic_motor", {**CYLINDER, "rod_area": 42e-4, "external_leakage": 0.0}, differential_cylinder),
    ("linear_hydraulic_motor", {**CYLINDER, "rod_area": 42e-4, "piston_volume_share": 0.8}, differential_cylinder),
    ("linear_hydraulic_motor", {**CYLINDER, "piston_volume_share": 0.3}, differential_cylinder),
    ("rotary_hydraulic_motor",
     {"displacement": 8e-6, "volume": 2e-4, "bulk_modulus": 1.2e9, "leakage": 2e-12, "external_leakage": 1e-12,
      "inertia": 0.05, "viscous_friction": 0.1}, rotary_motor),
    ("dc_motor", DC, dc_motor),
    ("ac_servo_axis",
     {"current_bandwidth": 2500.0, "torque_constant": 0.7, "inertia": 1.2e-3, "viscous_friction": 2e-3}, ac_servo_axis),
    ("power_amplifier", {"gain": 12.0, "bandwidth": 5e3}, power_amplifier),
    ("proportional_valve", {"flow_gain": 2e-4, **SPOOL}, proportional_valve),
    ("proportional_valve", {"flow_gain": 2e-4, **SPOOL, "flow_pressure_coefficient": 3e-12}, proportional_valve),
    ("proportional_valve", {"flow_gain": 2e-4, "time_constant": 0.01, "flow_pressure_coefficient": 3e-12},
     proportional_valve),
    ("servo_valve", SERVO, servo_valve),
    ("servo_valve", {**SERVO, "flow_pressure_coefficient": 3e-12}, servo_valve),
    ("mass_spring_damper", MASS, mass_spring_damper),
    ("mass_spring_damper", {**MASS, "base": "displacement"}, mass_spring_damper),
    ("mass_spring_damper", {**MASS, "base": "motion"}, mass_spring_damper),
    ("two_mass_correction",
     {"m2": 50.0, "m3": 20.0, "h1": 400.0, "h2": 300.0, "k1": 6e4, "k2": 2e4, "k3": 4e4, "k4": 1e4}, two_mass_correction),
    ("two_inertia", JOINT, two_inertia),
    ("two_inertia", {**JOINT, "gear_ratio": 1.0, "motor_friction": 0.0, "load_friction": 0.0}, two_inertia),
    ("gear", {"ratio": 12.5}, gear),
    ("ball_screw", {"lead": 0.02}, ball_screw),
    ("ball_screw", {"lead": 0.02, "stiffness": 1.3e8}, ball_screw),
    ("ball_screw", {"lead": 0.02, "stiffness": 1.3e8, "damping": 7e3}, ball_screw),
    ("viscous_damper", {"damping": 820.0}, viscous_damper),
    ("compliant_arm", ARM, compliant_arm),
]  # fmt: skip
WITHOUT_STATE: list[tuple[str, Mapping[str, Any], Law]] = [
    ("dc_motor", {**DC, "inductance": 0.0}, dc_motor),
    ("proportional_valve", {"flow_gain": 2e-4, "time_constant": 0.0, "flow_pressure_coefficient": 3e-12},
     proportional_valve),
]  # fmt: skip
"""Where the derivative in the value that is 0 does not exist."""

TRAPPED: list[tuple[str, Mapping[str, Any], Law]] = [
    ("linear_hydraulic_motor", {**CYLINDER, "rod_area": 42e-4, "leakage": 0.0, "external_leakage": 0.0},
     differential_cylinder),
    ("linear_hydraulic_motor", {**CYLINDER, "piston_volume_share": 0.3, "external_leakage": 0.0}, differential_cylinder),
    ("linear_hydraulic_motor", {**CYLINDER, "rod_area": 65e-4, "external_leakage": 0.0}, differential_cylinder),
]  # fmt: skip
"""Where oil under pressure cannot leave both rooms, so that only motion and load pressure have all derivatives."""

EVERYWHERE = CASES + WITHOUT_STATE + TRAPPED


def ids(cases: Sequence[tuple[str, Mapping[str, Any], Law]]) -> list[str]:
    return [f"{kind}-{'-'.join(str(value) for value in given.values())}" for kind, given, _ in cases]


def realized(kind: str, given: Mapping[str, Any]) -> Realization:
    element = catalogue()[kind]
    values = {param.name: param.default for param in element.parameters} | dict(given)
    element.check(frozenset(given), values)
    return element.realize(values)


def exactly(value: Any) -> Any:
    if isinstance(value, list):
        return [exactly(entry) for entry in value]
    return mp.mpf(value) if isinstance(value, float) else value


def exact(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: exactly(value) for name, value in given.items()}


def exact_matrix(array: np.ndarray) -> Any:
    rows, columns = array.shape
    result = mp.zeros(rows, columns)
    for i in range(rows):
        for j in range(columns):
            result[i, j] = mp.mpf(float(array[i, j]))
    return result


def responses(r: Realization, s: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return H(s) and its derivative, of coefficients whose imaginary parts are STEP times their derivatives.

    The states differ by 13 orders of magnitude: at 40 digits only the rounding of the coefficients themselves is left.
    """
    d, dd = exact_matrix(r.d.real), exact_matrix(r.d.imag / STEP)
    if not len(r.a):
        return plain(d), plain(dd)
    a, b, c = (exact_matrix(array.real) for array in (r.a, r.b, r.c))
    da, db, dc = (exact_matrix(array.imag / STEP) for array in (r.a, r.b, r.c))
    resolvent = (s * mp.eye(len(r.a)) - a) ** -1
    x = resolvent * b
    return plain(c * x + d), plain(dc * x + c * (resolvent * (da * x + db)) + dd)


def plain(matrix: Any) -> np.ndarray:
    return np.array([[complex(matrix[i, j]) for j in range(matrix.cols)] for i in range(matrix.rows)])


@pytest.mark.parametrize(("kind", "given", "law"), EVERYWHERE, ids=ids(EVERYWHERE))
def test_response(kind: str, given: Mapping[str, Any], law: Law) -> None:
    r = realized(kind, given)
    for frequency in FREQUENCIES:
        s = mp.mpc(0, frequency)
        got, expected = responses(r, s)[0], plain(mp.matrix(law(s, exact(given))))
        # An acceleration far below the resonances is a small rest of what the force gives at once, which is rounded.
        assert np.all(abs(got - expected) <= 1e-12 * abs(expected) + 1e-15 * abs(r.d)), f"{frequency} rad/s"


@pytest.mark.parametrize(("kind", "given", "law"), CASES + TRAPPED, ids=ids(CASES + TRAPPED))
def test_derivative_in_every_parameter(kind: str, given: Mapping[str, Any], law: Law) -> None:
    rows = slice(4 if (kind, given, law) in TRAPPED else None)
    for name, index, value in numbers(given):
        size = value or 1.0
        stepped = realized(kind, replaced(given, name, index, complex(value, size * STEP)))
        for frequency in FREQUENCIES[1::2]:
            s = mp.mpc(0, frequency)
            # Each side has 40 digits, so their difference is good to 20 of them.
            h = mp.mpf("1e-20")
            up, down = (
                mp.matrix(law(s, exact(replaced(given, name, index, mp.mpf(value) + sign * h * size))))
                for sign in (1, -1)
            )
            expected = plain((up - down) / (2 * h))[rows]
            whole, got = (matrix[rows] for matrix in responses(stepped, s))
            # Where a derivative is a small rest of large terms, what counts is the response that it changes.
            assert np.all(abs(got - expected) <= 1e-11 * abs(expected) + 1e-13 * abs(whole)), f"{name} {index}"


def numbers(given: Mapping[str, Any]) -> list[tuple[str, int | None, float]]:
    """Return name, place in the list (None where there is none) and value of every number."""
    found: list[tuple[str, int | None, float]] = []
    for name, value in given.items():
        if isinstance(value, float):
            found.append((name, None, value))
        elif isinstance(value, list):
            found.extend((name, i, entry) for i, entry in enumerate(value))
    return found


def replaced(given: Mapping[str, Any], name: str, index: int | None, new: Any) -> dict[str, Any]:
    value = new if index is None else [new if i == index else entry for i, entry in enumerate(given[name])]
    return {**given, name: value}


@pytest.mark.parametrize(("kind", "given", "law"), EVERYWHERE, ids=ids(EVERYWHERE))
def test_the_formula_of_every_coefficient_can_be_traced(kind: str, given: Mapping[str, Any], law: Law) -> None:
    expected, graph = realized(kind, given), Graph()
    traced = {}
    for name, value in given.items():
        if isinstance(value, list):
            traced[name] = [graph.parameter(entry) for entry in value]
        else:
            traced[name] = graph.parameter(value) if isinstance(value, float) else value
    r = realized(kind, traced)
    assert any(isinstance(entry, Traced) for array in (r.a, r.b, r.c, r.d) for entry in array.flat)
    # A value of 0 that is going to vary keeps its state, so what is compared are the paths.
    floats = Realization(a=nominal(r.a), b=nominal(r.b), c=nominal(r.c), d=nominal(r.d))
    s = mp.mpc(0, FREQUENCIES[2])
    got = responses(floats, s)[0]
    assert np.all(abs(got - responses(expected, s)[0]) <= 1e-13 * abs(got))
