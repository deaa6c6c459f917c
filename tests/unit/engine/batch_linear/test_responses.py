"""Responses to any command in batches: against the exact path by discovery, against scipy, and the same to the bit whoever is beside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from bench import coverage
from engine.analysis.measuring import MetricRequest, measure
from engine.batch.linear.responses import Responses
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram
from engine.metrics import catalogue
from engine.metrics._base import SystemMetric
from engine.model.metric_options import Options
from engine.signals import catalogue as commands
from engine.signals import make
from tests.reference.systems import block, system, transfer_function

Curve = Callable[[float], float]
VARIED = list(coverage.GAINS)
LEFT_TO_OTHERS = {"band_energy"}
HELD_TO_LINES = {"tracking_error", "envelope"}
MAY_VANISH = {"overshoot", "undershoot", "steady_state_error", "ie"}
MOVE = {"kind": "trapezoid", "distance": 1.0, "max_velocity": 1.0, "max_acceleration": 5.0}


@cache
def loop() -> Diagram:
    return coverage.diagram()


def asked(command: str) -> list[MetricRequest]:
    """Return all requests under one command, which is one object."""
    made = [request for name, request in coverage.requests() if name == command]
    return [replace(request, signals=made[0].signals) for request in made]


def agree(metric: str, value: float, expected: float | None) -> bool:
    if expected is None:
        return not np.isfinite(value)
    return bool(abs(value - expected) <= 1e-9 * max(abs(expected), 1e-3 if metric in MAY_VANISH else 0.0))


@pytest.mark.parametrize("command", sorted(commands()))
def test_every_metric_under_every_command_is_that_of_the_exact_path(command: str) -> None:
    requests, points = asked(command), coverage.candidates(2)
    responses = Responses(loop(), requests, VARIED)
    endless = next(iter(requests[0].signals.values())).final() is None
    for request, mine in zip(requests, responses.measured, strict=True):
        without_end = endless and request.duration is None and request.metric in HELD_TO_LINES
        assert mine == (request.metric not in LEFT_TO_OTHERS and not without_end), request
    if not any(responses.measured):
        return
    found, many = responses(points), 0
    for row in range(2):
        exact = measure(loop(), requests, overrides={name: float(column[row]) for name, column in points.items()})
        for column, (request, (measured, _)) in enumerate(zip(requests, exact, strict=True)):
            if not responses.measured[column]:
                continue
            if command == "noise" and found.doubtful[row].all():
                many += 1  # its 20 rad/s for the lifetime of a slow loop are more pieces than there is room for
                continue
            if found.doubtful[row, column]:  # a remainder of what grows for ever
                assert (command, request.duration) == ("ramp", None), request
                assert request.metric in {"iae", "ise", "itae", "ie"}
                continue
            value = float(found.values[row, column])
            assert agree(request.metric, value, measured.value), (request, value, measured)
    assert many <= len(requests)  # the other one is followed


def test_poles_are_those_of_the_exact_path() -> None:
    kinds = [kind for kind, metric in catalogue().items() if issubclass(metric, SystemMetric)]
    requests, points = [MetricRequest(metric=kind) for kind in kinds], coverage.candidates(20)
    responses = Responses(loop(), requests, VARIED)
    found = responses(points)
    assert all(responses.measured)
    assert not found.doubtful.any()
    for row in range(20):
        exact = measure(loop(), requests, overrides={name: float(column[row]) for name, column in points.items()})
        expected = [np.nan if measured.value is None else measured.value for measured, _ in exact]
        np.testing.assert_allclose(found.values[row], expected, rtol=1e-10)


@pytest.mark.parametrize("command", ["step", "trapezoid", "sine"])
def test_slopes_are_those_of_the_exact_path(command: str) -> None:
    requests = [*asked(command), *(MetricRequest(metric=kind) for kind in ("damping_ratio", "critical_frequency"))]
    values = {name: float(column[0]) for name, column in coverage.candidates(1).items()}
    points = {name: np.full(3, value, dtype=complex) for name, value in values.items()}
    for lane, name in enumerate(VARIED):
        points[name][lane] += 1e-30j
    responses = Responses(loop(), requests, VARIED)
    found = responses(points)
    compared = 0
    for column, (request, (measured, gradient)) in enumerate(
        zip(requests, measure(loop(), requests, overrides=values, gradient=VARIED), strict=True)
    ):
        if not responses.measured[column] or gradient is None or request.metric in {"ie", "steady_state_error"}:
            continue
        expected = gradient.values
        np.testing.assert_allclose(
            found.values[:, column].imag / 1e-30, expected, atol=1e-8 * np.abs(expected).max(), err_msg=str(request)
        )
        assert measured.value == pytest.approx(found.values[0, column].real, rel=1e-9, abs=1e-12)
        compared += 1
    assert compared >= 10


def exact_curve(diagram: Diagram, corners: list[tuple[float, list[float]]]) -> tuple[Curve, Curve]:
    """Return y(t) by scipy's matrix exponential of loop and command together; corners are (time, [u, u', u''])."""
    real = diagram.realize()
    n = real.a.shape[0]
    m = np.zeros((n + 3, n + 3))
    m[:n, :n], m[:n, n] = real.a, real.b1[:, 0]
    m[n, n + 1] = m[n + 1, n + 2] = 1.0
    row = np.concatenate([real.c1[0], [real.d11[0, 0], 0.0, 0.0]])
    starts, z = [], np.zeros(n + 3)
    for k, (time, command) in enumerate(corners):
        if k:
            z = expm(m * (time - corners[k - 1][0])) @ z
        z[n:] = command
        starts.append((time, z.copy()))

    def state(t: float) -> np.ndarray:
        time, begun = next((time, begun) for time, begun in reversed(starts) if time <= t)
        return expm(m * (t - time)) @ begun

    return (lambda t: float(row @ state(t))), (lambda t: float(state(t)[n]))


def test_a_movement_agrees_with_scipys_exponential() -> None:
    """A trapezoid of 1 m: 0.2 s up, 0.8 s straight on, 0.2 s down."""
    diagram, until = loop(), 2.5
    y, u = exact_curve(
        diagram, [(0.0, [0.0, 0.0, 5.0]), (0.2, [0.1, 1.0, 0.0]), (1.0, [0.9, 1.0, -5.0]), (1.2, [1.0, 0.0, 0.0])]
    )
    grid = np.linspace(0.0, until, 501)
    errors = np.array([u(t) - y(t) for t in grid])
    zeros = [
        brentq(lambda t: u(t) - y(t), a, b, xtol=1e-14)
        for a, b, p, q in zip(grid[:-1], grid[1:], errors[:-1], errors[1:], strict=True)
        if p * q < 0
    ]
    edges = sorted({0.0, 0.2, 1.0, 1.2, until, *zeros})
    whole = {
        name: sum(quad(f, a, b, epsabs=1e-13, epsrel=1e-12)[0] for a, b in pairwise(edges))
        for name, f in {
            "iae": lambda t: abs(u(t) - y(t)), "itae": lambda t: t * abs(u(t) - y(t)), "ise": lambda t: (u(t) - y(t)) ** 2,
        }.items()
    }  # fmt: skip
    top = max(grid, key=y)
    best = minimize_scalar(lambda t: -y(t), bounds=(top - 0.01, top + 0.01), method="bounded", options={"xatol": 1e-9})
    whole["peak"] = -best.fun
    signals = {"reference": make("trapezoid", {key: value for key, value in MOVE.items() if key != "kind"})}
    requests = [MetricRequest(metric=name, signals=signals, output="position", duration=until) for name in whole]
    found = Responses(diagram, requests, ["pid.kp"])({"pid.kp": np.array([diagram.parameters["pid.kp"].value])})
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[0], list(whole.values()), rtol=1e-9)


def test_a_lag_has_the_values_of_the_textbook() -> None:
    lag = transfer_function(["=k"], [1.0, 1.0], k=1.0)
    step, ramp, sine = {"u": make("step", {})}, {"u": make("ramp", {})}, {"u": make("sine", {"frequency": 3.0})}
    expected = [
        (MetricRequest(metric="iae", signals=step, output="y"), 1.0),
        (MetricRequest(metric="itae", signals=step, output="y"), 1.0),
        (MetricRequest(metric="ise", signals=step, output="y"), 0.5),
        (MetricRequest(metric="iae", signals=step, output="y", duration=3.0), 1 - np.exp(-3.0)),
        (MetricRequest(metric="rise_time", signals=step, output="y"), np.log(9.0)),
        (MetricRequest(metric="settling_time", signals=step, output="y"), np.log(50.0)),
        (MetricRequest(metric="steady_state_error", signals=ramp, output="y"), 1.0),
        (
            MetricRequest(metric="max_velocity", signals=step, output="y", options=Options(derivative=1)),
            1.0,
        ),
        (MetricRequest(metric="spectral_abscissa"), -1.0),
        # y = sin(3 t - atan 3) / √10 + 0.3 e^-t
        (
            MetricRequest(metric="control_effort_rms", signals=sine, output="y", duration=2.0, options=Options(derivative=0)),
            np.sqrt(
                quad(lambda t: (np.sin(3 * t - np.arctan(3)) / np.sqrt(10) + 0.3 * np.exp(-t)) ** 2, 0, 2, epsabs=1e-14)[0] / 2
            ),
        ),
    ]  # fmt: skip
    requests = [request for request, _ in expected]
    found = Responses(lag, requests, ["k"])({"k": np.array([1.0])})
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[0], [value for _, value in expected], rtol=1e-11)


def test_a_number_is_the_same_to_the_bit_whoever_is_beside_whatever_came_before() -> None:
    requests = [*asked("trapezoid"), *asked("square"), MetricRequest(metric="damping_ratio")]
    points = coverage.candidates(70)
    screening = Screening(loop(), requests, threads=2)
    whole = screening(points).values
    for pick in (np.arange(70)[::-1], np.array([5]), np.array([69, 3, 3, 17])):
        part = screening({name: column[pick] for name, column in points.items()}).values
        np.testing.assert_array_equal(part, whole[pick])
    np.testing.assert_array_equal(Screening(loop(), requests, threads=1)(points).values, whole)


def test_unstable_candidates_have_no_values_and_a_growth() -> None:
    requests = asked("trapezoid")
    found = Responses(loop(), requests, VARIED)(
        {"pid.kp": np.array([8.0, 8.0]), "pid.ki": np.array([2.0, 5000.0]), "pid.kd": np.array([0.4, 0.4])}
    )
    poles = np.linalg.eigvals(loop().realize({"pid.kp": 8.0, "pid.ki": 5000.0, "pid.kd": 0.4}).a)
    assert found.growth[0] < 0
    assert found.growth[1] == pytest.approx(poles.real.max(), rel=1e-9)
    assert found.growth[1] > 0
    assert np.isnan(found.values[1]).all()


def test_a_goal_does_not_change_another_ones_value() -> None:
    step, move = {"reference": make("step", {})}, {"reference": make("s_curve", dict(commands()["s_curve"].example))}
    fast = [MetricRequest(metric=name, signals=step, output="position") for name in ("overshoot", "rise_time")]
    slow = [MetricRequest(metric=name, signals=move, output="position") for name in ("iae", "residual_vibration")]
    points = coverage.candidates(9)
    together = Screening(loop(), [*fast, *slow])
    assert together.compiled(VARIED)
    found = together(points)
    np.testing.assert_array_equal(found.values[:, :2], Screening(loop(), fast)(points).values)
    np.testing.assert_array_equal(found.values[:, 2:], Screening(loop(), slow)(points).values)
    moved = together.slopes(points, {name: np.tile(np.eye(3)[k], (9, 1)) for k, name in enumerate(VARIED)})
    assert moved is not None
    np.testing.assert_allclose(moved.values, found.values, rtol=1e-11)


def test_a_peak_at_the_instant_at_which_a_delay_comes_back_moves_with_it() -> None:
    """The controller sees an error of 1 up to tau, so that it gives 1 + t, and less from there on: its peak is 1 + tau."""
    delayed = system(
        {"u": block("input"), "e": block("sum", signs="+-"), "pi": block("pi", kp=1.0, ki=1.0), "wait": block("delay", time="=tau"),
         "plant": block("integrator", gain=3.0)},
        ["u -> e.in1", "e -> pi", "pi -> wait", "wait -> plant", "plant -> e.in2"], {"control": "pi"}, {"tau": 0.1},
    )  # fmt: skip
    request = MetricRequest(metric="peak", signals={"u": make("step", {})}, output="control")
    tau = np.array([0.08, 0.1])
    found = Responses(delayed, [request], ["tau"])({"tau": tau * (1.0 + 1e-30j)})
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[:, 0].real, 1.0 + tau, rtol=1e-13)
    np.testing.assert_allclose(found.values[:, 0].imag / 1e-30, tau, rtol=1e-12)


def test_a_delay_that_comes_in_is_followed() -> None:
    """y = 1 - e^-(t - tau) behind the delay, so that the integral of |1 - y| within 1 s is tau + 1 - e^-(1 - tau)."""
    delayed = system(
        {"u": block("input"), "wait": block("delay", time="=tau"), "lag": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0])},
        ["u -> wait", "wait -> lag"], {"y": "lag"}, {"tau": 0.0},
    )  # fmt: skip
    request = MetricRequest(metric="iae", signals={"u": make("step", {})}, output="y", duration=1.0)
    assert Responses(delayed, [request]).measured == (True,)
    batch = Responses(delayed, [request], ["tau"])
    assert batch.measured == (True,)
    tau = np.array([0.3, 0.7])
    found = batch({"tau": tau * (1.0 + 1e-30j)})
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[:, 0].real, tau + 1.0 - np.exp(tau - 1.0), rtol=1e-13)
    np.testing.assert_allclose(found.values[:, 0].imag / 1e-30, tau * (1.0 - np.exp(tau - 1.0)), rtol=1e-12)
