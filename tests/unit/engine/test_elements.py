"""Elements: their transfer functions against closed forms, their structure and their refusals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from engine.elements import Realization, catalogue
from engine.model.errors import DiagramError
from tests.unit.engine.realizations import realized, response

S = (0.3j, 2.0 + 1.0j, 40.0j)


PID = {"kp": 3.0, "ki": 2.0, "kd": 0.5, "filter_frequency": 50.0}


@pytest.mark.parametrize(
    ("kind", "given", "expected"),
    [
        ("gain", {"gain": -2.5}, lambda s: -2.5),
        ("integrator", {"gain": 4.0}, lambda s: 4 / s),
        ("delay", {"time": 0.25}, lambda s: np.exp(-0.25 * s)),
        ("delay", {"time": 0.0}, lambda s: 1.0),
        ("transfer_function", {"numerator": [2.0, 1.0], "denominator": [3.0, 4.0, 5.0]},
         lambda s: (2 * s + 1) / (3 * s**2 + 4 * s + 5)),
        ("transfer_function", {"numerator": [0.0, 1.0, 2.0], "denominator": [0.0, 4.0, 5.0]},
         lambda s: (s + 2) / (4 * s + 5)),
        ("transfer_function", {"numerator": [3.0], "denominator": [2.0]}, lambda s: 1.5),
        ("transfer_function", {"numerator": [0.0], "denominator": [1.0, 1.0]}, lambda s: 0.0),
        ("zero_pole_gain", {"zeros": (), "poles": [-1.0, -2.0, -3.0], "gain": 6.0},
         lambda s: 6 / ((s + 1) * (s + 2) * (s + 3))),
        ("zero_pole_gain", {"zeros": [-1.0, [0.0, 3.0], [0.0, -3.0]], "poles": [-2.0, -4.0, -5.0], "gain": 2.0},
         lambda s: 2 * (s + 1) * (s**2 + 9) / ((s + 2) * (s + 4) * (s + 5))),
        ("zero_pole_gain",
         {"zeros": [-1.0, 2.0], "poles": [[-1.0, 2.0], [-1.0, -2.0], [-3.0, 0.0], [-0.5, 7.0], [-0.5, -7.0]], "gain": 1.0},
         lambda s: (s + 1) * (s - 2) / ((s**2 + 2 * s + 5) * (s + 3) * (s**2 + s + 49.25))),
        ("zero_pole_gain",
         {"zeros": [[-2.0, 1.0], [-2.0, -1.0]], "poles": [[-1.0, 2.0], [-1.0, -2.0]], "gain": 3.0},
         lambda s: 3 * (s**2 + 4 * s + 5) / (s**2 + 2 * s + 5)),
        ("zero_pole_gain", {"zeros": [], "poles": [], "gain": 3.0}, lambda s: 3.0),
        ("p", {"kp": 3.0}, lambda s: 3.0),
        ("pi", {"kp": 3.0, "ki": 2.0}, lambda s: 3 + 2 / s),
        ("pi", {"kp": 3.0, "integral_time": 1.5}, lambda s: 3 * (1 + 1 / (1.5 * s))),
        ("pd", {"kp": 3.0, "kd": 0.5, "filter_frequency": 50.0}, lambda s: 3 + 0.5 * s / (1 + s / 50)),
        ("pd", {"kp": 3.0, "kd": 0.5}, lambda s: 3 + 0.5 * s / (1 + s / 100)),
        ("pid", PID, lambda s: 3 + 2 / s + 0.5 * s / (1 + s / 50)),
        ("pid", {"kp": 3.0, "integral_time": 1.5, "derivative_time": 0.2, "filter_frequency": 50.0},
         lambda s: 3 * (1 + 1 / (1.5 * s) + 0.2 * s / (1 + s / 50))),
        ("pd2", {"kp": 3.0, "kd1": 0.5, "kd2": 0.02, "filter_frequency": 80.0, "filter_damping": 0.6},
         lambda s: (3 + 0.5 * s + 0.02 * s**2) / (1 + 1.2 * s / 80 + s**2 / 6400)),
        ("proportional_valve", {"flow_gain": 2.0, "natural_frequency": 90.0, "damping_ratio": 0.7},
         lambda s: 2 / (1 + 1.4 * s / 90 + s**2 / 8100)),
        ("proportional_valve", {"flow_gain": 2.0, "time_constant": 0.01}, lambda s: 2 / (1 + 0.01 * s)),
        ("proportional_valve", {"flow_gain": 2.0, "time_constant": 0.0}, lambda s: 2.0),
        ("proportional_valve", {"flow_gain": 2.0, "time_constant": 1e-30j}, lambda s: 2.0),
        ("delay", {"time": 1e-30j}, lambda s: 1.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("s", S)
def test_transfer_function(kind, given, expected, s):
    np.testing.assert_allclose(response(realized(kind, **given), s)[0, 0], expected(s), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("s", S)
def test_setpoint_weights(s):
    h = response(realized("pid", **PID, setpoint_weight_p=0.6, setpoint_weight_d=0.1), s)[0]
    derivative = 0.5 * s / (1 + s / 50)
    np.testing.assert_allclose(h, [3 * 0.6 + 2 / s + 0.1 * derivative, -(3 + 2 / s + derivative)], rtol=1e-13)


@pytest.mark.parametrize("s", S)
def test_a_setpoint_weight_that_is_not_given_is_1(s):
    weighted = response(realized("pid", **PID, setpoint_weight_p=1.0), s)[0]
    single = response(realized("pid", **PID), s)[0, 0]
    np.testing.assert_allclose(weighted, [single, -single], rtol=1e-13)


@pytest.mark.parametrize(
    ("given", "states"), [({}, 2), ({"ki": 0.0}, 1), ({"kd": 0.0}, 1), ({"ki": 0.0, "kd": 0.0}, 0), ({"ki": 1e-30j}, 2)]
)
def test_a_gain_of_0_leaves_no_state_unless_it_carries_an_infinitesimal(given, states):
    assert len(realized("pid", **PID | given).a) == states


def test_the_derivative_in_an_integral_gain_of_0_is_exact():
    s, step = 2.0 + 1.0j, 1e-30
    # Im is taken of each coefficient, so the derivative of H follows from those of B (here ki) by the chain rule.
    r = realized("pi", kp=3.0, ki=step * 1j)
    change = r.c.real @ np.linalg.solve(s * np.eye(1) - r.a.real, r.b.imag / step)
    np.testing.assert_allclose(change[0, 0], 1 / s, rtol=1e-15)


# Linear pneumatic motor: mid-range values of the paper's section 1 in SI, and its transfer functions, eq. (1)-(2) with the
# load path: z/Q = A/(s [C m s² + (C b + m a) s + A² + a b]), z/F = -(C s + a)/(s [same]), C = V/(χ p).
A, V, P, CHI, LEAK, M, B = 65e-4, 750e-6, 5e5, 1.4, 0.4e-11, 300.0, 1200.0
C = V / (CHI * P)


def bracket(s: complex) -> complex:
    return C * M * s**2 + (C * B + M * LEAK) * s + A**2 + LEAK * B


@pytest.mark.parametrize("s", S)
def test_pneumatic_motor_has_the_transfer_functions_of_the_paper(s):
    h = response(realized("linear_pneumatic_motor"), s)
    z_q, z_f = A / (s * bracket(s)), -(C * s + LEAK) / (s * bracket(s))
    np.testing.assert_allclose(h[:3, 0], [z_q, s * z_q, s**2 * z_q], rtol=1e-12)
    np.testing.assert_allclose(h[:3, 1], [z_f, s * z_f, s**2 * z_f], rtol=1e-12)
    pressure = (M * s**2 * z_q + B * s * z_q) / A  # force balance without load
    np.testing.assert_allclose(h[3, 0], pressure, rtol=1e-12)


def test_pneumatic_motor_mid_range_numbers():
    # paper-reading: V/(χ p) = 107.14 cm⁵/daN (1 cm⁵/daN = 1e-11 m⁵/N), bracket: 11.47 rad/s undamped, damping ratio 0.175
    assert pytest.approx(107.14e-11, rel=5e-5) == C
    poles = np.linalg.eigvals(realized("linear_pneumatic_motor").a)
    pair = poles[poles.imag > 0][0]
    assert abs(pair) == pytest.approx(11.47, abs=0.005)
    assert -pair.real / abs(pair) == pytest.approx(0.175, abs=0.0005)


def test_the_defaults_of_the_pneumatic_motor_are_from_the_middle_of_the_ranges_of_the_paper():
    # as printed, Fig. 2: A 50-80 cm², V 500-1000 cm³, Δp 4-6 daN/cm², a_m 0.2-0.7 cm⁵/(daN s), m 0.1-0.6 daN s²/cm,
    # b_m 0.8-1.8 daN s/cm; 1 daN/cm² = 1e5 Pa, 1 cm⁵/(daN s) = 1e-11 m⁵/(N s), 1 daN s²/cm = 1000 kg
    printed = {
        "area": (50e-4, 80e-4), "volume": (500e-6, 1000e-6), "pressure": (4e5, 6e5), "leakage": (0.2e-11, 0.7e-11),
        "mass": (100.0, 600.0), "viscous_friction": (800.0, 1800.0),
    }  # fmt: skip
    defaults = {param.name: param.default for param in catalogue()["linear_pneumatic_motor"].parameters}
    for name, (low, high) in printed.items():
        assert abs(defaults[name] - (low + high) / 2) <= 0.1 * (high - low) + 1e-15, name


@pytest.mark.parametrize(("parameter", "expected"), [("area", 0.99989), ("volume", -0.5), ("mass", -0.5)])
def test_elasticities_of_the_undamped_frequency(parameter, expected):
    # sqrt((A² + a_m b_m) χ p/(V m)): 0.99989 in A, -1/2 in V and m. The determinant of the moving part is its square.
    step = 1e-30
    base = {param.name: param.default for param in catalogue()["linear_pneumatic_motor"].parameters}
    a = realized("linear_pneumatic_motor", **{parameter: base[parameter] * (1 + step * 1j)}).a[1:, 1:]
    square = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    assert 0.5 * square.imag / square.real / step == pytest.approx(expected, abs=5e-6)


@pytest.mark.parametrize("s", S)
def test_hydraulic_motor_differs_by_its_capacitance(s):
    h = response(realized("linear_hydraulic_motor", leakage=0.0), s)
    capacitance = 1e-3 / (4 * 1.4e9)
    expected = 65e-4 / (s * (capacitance * 300 * s**2 + capacitance * 1200 * s + 65e-4**2))
    np.testing.assert_allclose(h[0, 0], expected, rtol=1e-12)


def test_ten_equal_lags_keep_their_poles():
    # In polynomial form the poles at -2 move by 0.11 (research: python-control 0.10.2).
    poles = np.linalg.eigvals(realized("zero_pole_gain", poles=[-2.0] * 10).a)
    np.testing.assert_array_equal(poles, np.full(10, -2.0))


def test_a_companion_matrix_is_balanced():
    # Poles at 1e-2, 1 and 1e4 rad/s: unscaled, entries of the companion matrix reach from 1 to 1e4 in one column.
    denominator = np.poly([-1e-2, -1.0, -1e4]).tolist()
    r = realized("transfer_function", numerator=[100.0], denominator=denominator)
    rows, columns = np.abs(r.a).sum(axis=1), np.abs(r.a).sum(axis=0)
    ratio = (rows - np.abs(np.diag(r.a))) / (columns - np.abs(np.diag(r.a)))
    assert np.all((ratio > 1 / 16) & (ratio < 16))
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(r.a).real), [-1e4, -1.0, -1e-2], rtol=1e-10)


BATCHED: list[tuple[str, Mapping[str, Any]]] = [
    ("pid", {**PID, "ki": np.array([0.0, 2.0]), "kd": np.array([0.5, 0.0])}),
    ("pi", {"kp": 1.0, "ki": np.array([0.0, 2.0])}),
    ("delay", {"time": np.array([0.0, 0.1])}),
    ("proportional_valve", {"flow_gain": np.array([1.0, 2.0]), "time_constant": np.array([0.0, 0.1])}),
    ("transfer_function", {"numerator": [np.array([1.0, 2.0]), 3.0], "denominator": [1.0, 2.0, np.array([0.0, 5.0])]}),
    ("zero_pole_gain", {"zeros": [np.array([-1.0, -2.0])], "poles": [-1.0, -3.0], "gain": np.array([1.0, 2.0])}),
    ("zero_pole_gain", {"poles": [[-1.0, np.array([1.0, 2.0])], [-1.0, np.array([-1.0, -2.0])]], "gain": 2.0}),
    ("state_space", {"A": [[np.array([-1.0, -2.0])]], "B": [[1.0]], "C": [[1.0]], "D": [[np.array([0.0, 1.0])]]}),
    ("linear_pneumatic_motor", {"mass": np.array([100.0, 300.0])}),
    ("pd2", {"kp": 1.0, "kd2": np.array([0.0, 0.01]), "filter_frequency": 100.0}),
]


def pick(value: Any, member: int) -> Any:
    if isinstance(value, list):
        return [pick(item, member) for item in value]
    return value[member].item() if isinstance(value, np.ndarray) else value


@pytest.mark.parametrize(("kind", "given"), BATCHED)
@pytest.mark.parametrize("member", [0, 1])
def test_a_batch_has_the_members_it_was_made_of(kind, given, member):
    stacked = realized(kind, **given)
    single = realized(kind, **{name: pick(value, member) for name, value in given.items()})
    taken: dict[str, Any] = {}
    for name in ("a", "b", "c", "d", "delays", "d12", "d21"):
        array = getattr(stacked, name)
        batched = array is not None and array.ndim > (1 if name == "delays" else 2)
        taken[name] = array[member] if batched else array
    for s in S:
        np.testing.assert_allclose(response(Realization(**taken), s), response(single, s), rtol=1e-13)


@pytest.mark.parametrize(("kind", "given"), BATCHED[:4])
def test_what_a_member_does_not_need_decays_unseen(kind, given):
    r = realized(kind, **given)
    assert r.a.ndim < 3 or np.all(np.linalg.eigvals(r.a[0]).real < 0)
    assert np.all(r.delays > 0)


@pytest.mark.parametrize(
    ("kind", "given", "at", "message"),
    [
        ("transfer_function", {"numerator": [1.0, 0.0, 0.0], "denominator": [1.0, 1.0]}, "numerator", "improper"),
        ("transfer_function", {"numerator": [1.0], "denominator": [0.0, 0.0]}, "denominator", "other than 0"),
        ("transfer_function", {"numerator": [1.0], "denominator": []}, "denominator", "other than 0"),
        ("transfer_function", {"numerator": [1.0], "denominator": [1e-30j, 1.0]}, "denominator", "derivative"),
        ("zero_pole_gain", {"zeros": [-1.0], "poles": []}, "zeros", "improper"),
        ("zero_pole_gain", {"poles": [[-1.0, 2.0]]}, "poles", "conjugate of -1\\+2j"),
        ("zero_pole_gain", {"poles": [[-1.0, 2.0], [-1.1, -2.0]]}, "poles", "conjugate"),
        (
            "pid",
            {"kp": 1.0, "ki": 1.0, "integral_time": 2.0, "filter_frequency": 9.0},
            "integral_time",
            "absent where ki",
        ),
        ("proportional_valve", {"flow_gain": 1.0}, "natural_frequency", "where there is no time_constant"),
        ("proportional_valve", {"flow_gain": 1.0, "natural_frequency": 1.0}, "damping_ratio", "must be given"),
        (
            "proportional_valve",
            {"flow_gain": 1.0, "damping_ratio": 1.0, "time_constant": 1.0},
            "time_constant",
            "absent",
        ),
        ("sum", {"signs": "+*"}, "signs", "characters \\+ or -"),
        ("sum", {"signs": ""}, "signs", "1 to 64"),
        ("state_space", {"A": [[1.0]], "B": [[1.0, 2.0]], "C": [[1.0]], "D": [[0.0]]}, "B", "1 x 1 .* got 1 x 2"),
        ("state_space", {"A": [[1.0]], "B": [[1.0]], "C": [[1.0]], "D": []}, "D", "got 0 x 0"),
    ],
)
def test_refuses(kind, given, at, message):
    with pytest.raises(DiagramError, match=message) as caught:
        realized(kind, **given)
    assert caught.value.at == (at,)


def test_state_space_ports():
    element = catalogue()["state_space"]
    ports = element.ports({"D": [[0.0, 0.0]]})
    assert (ports.inputs, ports.outputs) == (("in1", "in2"), ("out",))


def test_integrator_starts_at_its_initial_value():
    initial = realized("integrator", initial=2.5).initial
    assert initial is not None
    assert initial.tolist() == [2.5]
