"""Control laws, corrections and sensors against their formulas at 40 digits: responses and exact derivatives to 1e-12.

The formulas below are those of the sources that the elements name, written for any kind of number; a derivative is that of
the formula at 40 digits, so that no step size enters. Networks are computed from the impedances of their components.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from scipy import signal

from engine.diagram.diagram import compile_system
from engine.elements import Realization, catalogue
from engine.model.traced import Graph, Traced, nominal
from tests.reference import mpmath_oracle as oracle
from tests.reference.systems import block, system

mp = oracle.mp

FREQUENCIES = (0.01, 1.0, 37.0, 300.0, 2e4)
STEP = 1e-30

Formula = Callable[[Any, Mapping[str, Any]], Any]


def lead_lag(s: Any, p: Mapping[str, Any]) -> Any:
    return p["gain"] * (1 + s / p["zero_frequency"]) / (1 + s / p["pole_frequency"])


def notch(s: Any, p: Mapping[str, Any]) -> Any:
    w, rest = p["frequency"], s**2 + p["frequency"] ** 2
    return (rest + p["depth"] * p["width"] * w * s) / (rest + p["width"] * w * s)


def low_pass_2(s: Any, p: Mapping[str, Any]) -> Any:
    w = p["frequency"]
    return w**2 / (s**2 + 2 * p["damping_ratio"] * w * s + w**2)


def low_pass_5(s: Any, p: Mapping[str, Any]) -> Any:
    # Butterworth's polynomial of order 5: (x + 1)(x² + x/φ + 1)(x² + φ x + 1), φ the golden ratio.
    x, golden = s / p["frequency"], (1 + mp.sqrt(5)) / 2
    return 1 / ((x + 1) * (x**2 + x / golden + 1) * (x**2 + golden * x + 1))


def derivative(s: Any, p: Mapping[str, Any]) -> Any:
    return p["gain"] * s * p["filter_frequency"] / (s + p["filter_frequency"])


def roll_off(s: Any, p: Mapping[str, Any]) -> Any:
    x = s / p["filter_frequency"]
    return 1 / (1 + 2 * p["filter_damping"] * x + x**2)


def feed_forward(s: Any, p: Mapping[str, Any]) -> Any:
    return (p["kf"] + p["kv"] * s + p["ka"] * s**2) * roll_off(s, p)


def pd2(s: Any, p: Mapping[str, Any]) -> Any:
    return (p["kp"] + p["kd1"] * s + p["kd2"] * s**2) * roll_off(s, p)


def parallel_pid(s: Any, p: Mapping[str, Any]) -> Any:
    return p["kp"] + p["ki"] / s + p["kd"] * s / (1 + s / p["filter_frequency"])


def ideal_pid(s: Any, p: Mapping[str, Any]) -> Any:
    law = 1 + 1 / (p["integral_time"] * s) + p["derivative_time"] * s / (1 + s / p["filter_frequency"])
    return p["kp"] * law


def network(s: Any, p: Mapping[str, Any]) -> Any:
    """The voltage divider of two impedances; a component that is not there is open (in Z1) or a wire (in Z2)."""
    admittance = (1 / p["r1"] if "r1" in p else 0) + (p["c1"] * s if "c1" in p else 0)
    shunt = p.get("r2", 0) + (1 / (p["c2"] * s) if "c2" in p else 0)
    return shunt / (1 / admittance + shunt)


def first_order_sensor(s: Any, p: Mapping[str, Any]) -> Any:
    return p["gain"] / (1 + p["time_constant"] * s)


def accelerometer(s: Any, p: Mapping[str, Any]) -> Any:
    w = p["natural_frequency"]
    deflection = -1 / (s**2 + 2 * p["damping_ratio"] * w * s + w**2)
    corner = p.get("high_pass_frequency", 0)
    return -p["sensitivity"] * w**2 * deflection * s / (s + corner)


def velocity_transducer(s: Any, p: Mapping[str, Any]) -> Any:
    seismic, band = mp.mpf(1), mp.mpf(1)
    if "natural_frequency" in p:
        w = p["natural_frequency"]
        seismic = s**2 / (s**2 + 2 * p["damping_ratio"] * w * s + w**2)
    if "bandwidth" in p:
        band = p["bandwidth"] / (s + p["bandwidth"])
    return p["sensitivity"] * seismic * band


FILTER = {"filter_frequency": 500.0, "filter_damping": 0.6}
CASES: list[tuple[str, Mapping[str, Any], Formula]] = [
    ("lead_lag", {"gain": 2.0, "zero_frequency": 20.0, "pole_frequency": 300.0}, lead_lag),
    ("lead_lag", {"gain": 0.3, "zero_frequency": 900.0, "pole_frequency": 4.0}, lead_lag),
    ("notch", {"frequency": 280.0, "depth": 0.2, "width": 0.7}, notch),
    ("notch", {"frequency": 280.0, "depth": 1.0, "width": 2.5}, notch),
    ("low_pass", {"frequency": 70.0, "order": 2, "damping_ratio": 0.4}, low_pass_2),
    ("low_pass", {"frequency": 70.0, "order": 5}, low_pass_5),
    ("derivative", {"gain": 3.0, "filter_frequency": 150.0}, derivative),
    ("feed_forward", {"kf": 0.5, "kv": 1.1, "ka": 0.02, **FILTER}, feed_forward),
    ("pd2", {"kp": 2.0, "kd1": 0.1, "kd2": 0.001, **FILTER}, pd2),
    ("pid", {"kp": 3.0, "ki": 2.0, "kd": 0.5, "filter_frequency": 50.0}, parallel_pid),
    ("pid", {"kp": 3.0, "integral_time": 1.5, "derivative_time": 0.2, "filter_frequency": 50.0}, ideal_pid),
    ("rc_network", {"network": "low_pass", "r1": 1e4, "c2": 1e-6}, network),
    ("rc_network", {"network": "high_pass", "c1": 1e-6, "r2": 2e4}, network),
    ("rc_network", {"network": "lead", "r1": 1e5, "c1": 1e-7, "r2": 1e4}, network),
    ("rc_network", {"network": "lag", "r1": 1e5, "r2": 1e4, "c2": 1e-6}, network),
    ("rc_network", {"network": "lead_lag", "r1": 1e5, "c1": 1e-7, "r2": 1e4, "c2": 1e-5}, network),
    ("first_order_sensor", {"gain": 0.01, "time_constant": 0.003}, first_order_sensor),
    ("accelerometer", {"sensitivity": 0.0102, "natural_frequency": 5e3, "damping_ratio": 0.03}, accelerometer),
    ("accelerometer",
     {"sensitivity": 0.0102, "natural_frequency": 5e3, "damping_ratio": 0.7, "high_pass_frequency": 3.0}, accelerometer),
    ("velocity_transducer", {"sensitivity": 28.0}, velocity_transducer),
    ("velocity_transducer", {"sensitivity": 0.06, "bandwidth": 800.0}, velocity_transducer),
    ("velocity_transducer", {"sensitivity": 28.0, "natural_frequency": 28.0, "damping_ratio": 0.56}, velocity_transducer),
    ("velocity_transducer",
     {"sensitivity": 28.0, "natural_frequency": 28.0, "damping_ratio": 0.56, "bandwidth": 800.0}, velocity_transducer),
]  # fmt: skip
IDS = [f"{kind}-{'-'.join(str(value) for value in given.values())}" for kind, given, _ in CASES]


def realized(kind: str, given: Mapping[str, Any]) -> Realization:
    element = catalogue()[kind]
    values = {param.name: param.default for param in element.parameters} | dict(given)
    element.check(frozenset(given), values)
    return element.realize(values)


def exactly(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: mp.mpf(value) if isinstance(value, float) else value for name, value in given.items()}


def response(r: Realization, s: complex) -> complex:
    return complex((r.c @ np.linalg.solve(s * np.eye(len(r.a)) - r.a, r.b) + r.d)[0, 0])


def sensitivity(r: Realization, s: complex) -> complex:
    """dH/dp at s, where the imaginary parts of the coefficients are STEP times their derivatives."""
    resolvent = np.linalg.inv(s * np.eye(len(r.a)) - r.a.real)
    x = resolvent @ r.b.real
    da, db, dc, dd = (matrix.imag / STEP for matrix in (r.a, r.b, r.c, r.d))
    return complex((dc @ x + r.c.real @ resolvent @ (da @ x + db) + dd)[0, 0])


def agree(got: list[complex], expected: list[complex], *, relative: float, rounding: float) -> None:
    """Compare over all frequencies; where a zero at the origin cancels, rounding is measured by the largest response."""
    np.testing.assert_allclose(got, expected, rtol=relative, atol=rounding * max(abs(value) for value in expected))


@pytest.mark.parametrize(("kind", "given", "formula"), CASES, ids=IDS)
def test_response(kind: str, given: Mapping[str, Any], formula: Formula) -> None:
    r = realized(kind, given)
    expected = [complex(formula(mp.mpc(0, frequency), exactly(given))) for frequency in FREQUENCIES]
    agree([response(r, 1j * frequency) for frequency in FREQUENCIES], expected, relative=1e-12, rounding=2e-16)


@pytest.mark.parametrize(("kind", "given", "formula"), CASES, ids=IDS)
def test_derivative_in_every_parameter(kind: str, given: Mapping[str, Any], formula: Formula) -> None:
    for name in (name for name, value in given.items() if isinstance(value, float)):
        stepped = realized(kind, {**given, name: complex(given[name], STEP)})
        expected = []
        for frequency in FREQUENCIES:
            s = mp.mpc(0, frequency)

            def of(value: Any, s: Any = s, name: str = name) -> Any:
                return formula(s, exactly(given) | {name: value})

            expected.append(complex(mp.diff(of, mp.mpf(given[name]))))
        agree(
            [sensitivity(stepped, 1j * frequency) for frequency in FREQUENCIES],
            expected,
            relative=1e-11,
            rounding=1e-13,
        )


@pytest.mark.parametrize(("kind", "given", "formula"), CASES, ids=IDS)
def test_the_formula_of_every_coefficient_can_be_traced(kind: str, given: Mapping[str, Any], formula: Formula) -> None:
    plain = realized(kind, given)
    graph = Graph()
    traced = realized(
        kind, {name: graph.parameter(value) if isinstance(value, float) else value for name, value in given.items()}
    )
    assert any(isinstance(entry, Traced) for array in (traced.a, traced.b, traced.c, traced.d) for entry in array.flat)
    for name in ("a", "b", "c", "d"):
        np.testing.assert_allclose(nominal(getattr(traced, name)), getattr(plain, name), rtol=1e-15)


@pytest.mark.parametrize("order", range(1, 9))
def test_butterworth_by_its_definition(order: int) -> None:
    # |H(jw)|² = 1/(1 + (w/wc)^2n) with all poles on the left half of the circle of radius wc (Butterworth 1930).
    corner = 40.0
    r = realized("low_pass", {"frequency": corner, "order": order})
    for ratio in (0.0, 0.3, 1.0, 2.0, 5.0):
        magnitude = abs(response(r, 1j * ratio * corner))
        assert magnitude == pytest.approx((1 + ratio ** (2 * order)) ** -0.5, rel=1e-12)
    angles = np.pi * (2 * np.arange(1, order + 1) + order - 1) / (2 * order)
    poles = sorted(np.linalg.eigvals(r.a), key=lambda pole: pole.imag)
    expected = sorted(corner * np.exp(1j * angles), key=lambda pole: pole.imag)
    np.testing.assert_allclose(poles, expected, rtol=1e-12, atol=1e-11)
    numerator, denominator = signal.butter(order, corner, analog=True)
    for s in (3j, 40j, 200j):
        assert response(r, s) == pytest.approx(np.polyval(numerator, s) / np.polyval(denominator, s), rel=1e-11)


def test_the_phase_of_a_lead_is_largest_at_the_geometric_mean() -> None:
    # arcsin((r - 1)/(r + 1)), r = 10: 54.9°, Franklin, Powell, Emami-Naeini, section 6.7.
    r = realized("lead_lag", {"gain": 1.0, "zero_frequency": 20.0, "pole_frequency": 200.0})
    middle = np.sqrt(20.0 * 200.0)
    phase = np.angle([response(r, 1j * middle * factor) for factor in (0.99, 1.0, 1.01)])
    assert phase[1] == pytest.approx(np.arcsin(9 / 11), rel=1e-13)
    assert phase[1] > max(phase[0], phase[2])


def test_the_notch_in_its_own_words() -> None:
    r = realized("notch", {"frequency": 300.0, "depth": 0.05, "width": 0.4})
    assert response(r, 300j) == pytest.approx(0.05, rel=1e-12)
    assert abs(response(r, 0j)) == pytest.approx(1.0, rel=1e-15)
    full = realized("notch", {"frequency": 300.0, "depth": 0.0, "width": 0.4})
    # The -3 dB frequencies of a full notch lie width · frequency apart, with the centre as geometric mean.
    edges = 300 * (np.sqrt(1 + 0.2**2) + np.array([-0.2, 0.2]))
    np.testing.assert_allclose([abs(response(full, 1j * edge)) for edge in edges], 2**-0.5, rtol=1e-13)
    # depth · width = 2 z puts the zeros on the poles of a mode with the damping ratio z.
    mode = realized("low_pass", {"frequency": 300.0, "order": 2, "damping_ratio": 0.01})
    zeros = np.linalg.eigvals(r.a - r.b @ r.c / r.d[0, 0])
    np.testing.assert_allclose(sorted(zeros, key=np.imag), sorted(np.linalg.eigvals(mode.a), key=np.imag), rtol=1e-12)


def test_setpoint_weights_act_on_the_reference_alone() -> None:
    # u = kp (b r - y) + ki ∫(r - y) + kd s/(1 + s/w) (c r - y), Åström and Hägglund, chapter 3.
    given = {
        "kp": 3.0,
        "ki": 2.0,
        "kd": 0.5,
        "filter_frequency": 50.0,
        "setpoint_weight_p": 0.6,
        "setpoint_weight_d": 0.1,
    }
    r = realized("pid", given)
    for frequency in FREQUENCIES:
        s = 1j * frequency
        rate = 0.5 * s / (1 + s / 50)
        h = r.c @ np.linalg.solve(s * np.eye(len(r.a)) - r.a, r.b) + r.d
        np.testing.assert_allclose(h[0], [3 * 0.6 + 2 / s + 0.1 * rate, -(3 + 2 / s + rate)], rtol=1e-12)


def test_the_high_pass_of_an_accelerometer_hides_a_lasting_acceleration() -> None:
    r = realized("accelerometer", {"sensitivity": 0.01, "natural_frequency": 5e3, "high_pass_frequency": 3.0})
    assert response(r, 0j) == 0
    without = realized("accelerometer", {"sensitivity": 0.01, "natural_frequency": 5e3})
    assert response(without, 0j) == pytest.approx(0.01, rel=1e-15)


def test_feed_forward_of_the_inverse_plant_leaves_no_error() -> None:
    # m x'' + b x' = F with F = (b s + m s²) r/(1 + ...): x/r is the roll-off itself.
    mass, friction = 20.0, 300.0
    diagram = system(
        {
            "r": block("input"),
            "ahead": block("feed_forward", kv=friction, ka=mass, filter_frequency=100.0, filter_damping=0.7),
            "plant": block("transfer_function", numerator=[1.0], denominator=[mass, friction, 0.0]),
        },
        ["r -> ahead", "ahead -> plant"],
        {"x": "plant"},
    )
    linear = compile_system(diagram.system).realize()
    for s in (0.5j, 20j, 300j):
        h = linear.c1 @ np.linalg.solve(s * np.eye(linear.states) - linear.a, linear.b1) + linear.d11
        assert h[0, 0] == pytest.approx(1 / (1 + 1.4 * s / 100 + s**2 / 1e4), rel=1e-12)
