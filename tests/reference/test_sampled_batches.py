"""Batches of loops with samplers, held against difference equations by hand, against the exact path, and against themselves.

x' = A x + b u,  u held:   x(t + h) = e^{A h} x + ∫ e^{A s} b ds u;   L(z) = P(z) C(z) with P of one period
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screened import Screened
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system
from engine.metrics import catalogue
from engine.model.metric_options import Options
from engine.model.verdicts import Verdict
from engine.signals import Signal, make
from optimizers.problem import Goal, Sense, Variable
from optimizers.solving.solve import solve
from tests.reference.test_sampled_searches import largest_sensitivity, problem, squared_error
from tests.unit.engine.diagrams import block, document

PERIOD, DELAY, FILTER = 0.01, 0.004, 200.0
STEP: Mapping[str, Signal] = {"r": make("step", {"amplitude": 1.0})}
LATER: Mapping[str, Signal] = {
    "r": make("step", {"amplitude": 1.0, "start": 0.0137}),
    "d": make("step", {"amplitude": 0.3, "start": 0.3}),
}
MOVE: Mapping[str, Signal] = {
    "r": make("s_curve", {"distance": 1.0, "max_velocity": 3.0, "max_acceleration": 20.0, "max_jerk": 300.0})
}
GAINS: Mapping[str, tuple[float, ...]] = {
    "pid.kp": (9.0, 20.0, 4.0),
    "pid.ki": (2.0, 6.0, 8.0),
    "pid.kd": (0.3, 0.6, 0.0),
}
LOOPS = (
    "sensitivity_peak",
    "complementary_peak",
    "disk_margin",
    "gain_margin",
    "gain_margin_up",
    "gain_margin_down",
    "phase_margin",
)
POLES = ("damping_ratio", "critical_frequency", "spectral_abscissa")
RESPONSES = (
    "overshoot", "undershoot", "rise_time", "settling_time", "response_time", "peak", "peak_time", "iae", "ise", "itae", "ie",
    "steady_state_error", "residual_vibration", "max_velocity", "control_effort_rms",
)  # fmt: skip


def loop(
    between: Mapping[str, Any] | None = None, denominator: tuple[float, ...] = (0.05, 1.0, 0.0), **given: Any
) -> Diagram:
    """Return an axis under a sampled PID; ``between`` are blocks behind the controller, from first to last."""
    timing = {"sample_time": PERIOD, "delay": DELAY, **given}
    blocks = {
        "r": block("input"), "d": block("input"), "e": block("sum", signs="+-"), "load": block("sum", signs="++"),
        "pid": block("sampled_pid", **{"kp": 9.0, "ki": 2.0, "kd": 0.3, "filter_frequency": FILTER, **timing}),
        "plant": block("transfer_function", numerator=[1.0], denominator=list(denominator)), **(between or {}),
    }  # fmt: skip
    way = ["pid", *(between or {}), "load.in1"]
    wires = ["r -> e.in1", "plant -> e.in2", "e -> pid", "d -> load.in2", "load -> plant"]
    wires += [f"{one} -> {other}" for one, other in pairwise(way)]
    return compile_system(document(blocks, wires, {"y": "plant", "u": "pid"}))


STRUCTURES: Mapping[str, Diagram] = {
    "plain": loop(delay=0.0),
    "computing": loop(),
    "a whole period": loop(delay=PERIOD),
    "later": loop(offset=0.0025),
    "tustin": loop(derivative_rule="tustin"),
    "weighted": loop(denominator=(1e-4, 2e-2, 1.0, 0.0), kp=5.0),
    "fast and slow": loop(denominator=(1e-5, 2.2e-3, 0.06, 1.0, 0.0)),
    "notch": loop(
        {"n": block("discrete_transfer_function", numerator=[0.5, 0.2], denominator=[1.0, -0.3], sample_time=PERIOD)}
    ),
    "slower hold": loop({"h": block("zero_order_hold", sample_time=2 * PERIOD)}),
    "faster hold": loop({"h": block("zero_order_hold", sample_time=PERIOD / 4)}),
    "pure delay": loop({"z": block("delay", time=1.3 * PERIOD)}),
    "stiff": loop({"lag": block("transfer_function", numerator=[1.0], denominator=[2e-5, 1.0])}),
}


def requests(
    signals: Mapping[str, Signal], output: str, duration: float | None, *, unsettled: bool = True
) -> list[MetricRequest]:
    return [
        MetricRequest(
            metric=metric, signals=signals, output=output, duration=duration, options=Options(derivative=0), unsettled=unsettled
        )
        for metric in RESPONSES
        if duration is not None or metric != "control_effort_rms"
    ]  # fmt: skip


def screened(diagram: Diagram, asked: list[MetricRequest], gains: Mapping[str, tuple[float, ...]] = GAINS) -> Screened:
    return Screening(diagram, asked, threads=1)({name: np.array(values) for name, values in gains.items()})


def assert_exact(diagram: Diagram, asked: list[MetricRequest], *, doubted: float) -> None:
    found, doubts = screened(diagram, asked), []
    for row in range(3):
        at = {name: values[row] for name, values in GAINS.items()}
        exact = measure(diagram, asked, overrides=at)
        for column, (request, (measured, _)) in enumerate(zip(asked, exact, strict=True)):
            doubts.append(bool(found.doubtful[row, column]))
            if found.doubtful[row, column]:
                continue
            value = found.values[row, column]
            if found.growth[row] >= 0 or not np.isfinite(value):
                unstable = {Verdict.UNSTABLE, Verdict.MARGINAL, Verdict.NOT_SETTLED, Verdict.DIVERGES}
                assert measured.value is None or measured.verdict in unstable, (request.metric, measured)
                continue
            assert measured.value is not None, (request.metric, value, measured)
            rel = 1e-6 if request.metric == "peak_time" else 1e-9  # of a flat top the instant has half the digits
            assert value == pytest.approx(measured.value, rel=rel, abs=1e-11), (request.metric, row)
    assert np.mean(doubts) <= doubted


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize(
    ("signals", "output"),
    [(STEP, "y"), (LATER, "y"), (MOVE, "y"), (STEP, "u")],
    ids=["step", "later", "move", "effort"],
)
def test_responses(name: str, signals: Mapping[str, Signal], output: str) -> None:
    # What is measured at the jumps of the controller's output has no rate there, and whether it has settled is seldom clear.
    assert_exact(STRUCTURES[name], requests(signals, output, 0.7), doubted=0.1 if output == "y" else 0.5)


@pytest.mark.parametrize("name", STRUCTURES)
@pytest.mark.parametrize("place", ["e", "pid", "plant"])
def test_loops(name: str, place: str) -> None:
    asked = [MetricRequest(metric=metric, open_at=place) for metric in LOOPS]
    # Where the cut carries several values in a period, margins are no frequency response: the exact path has them.
    several = name in {"slower hold", "faster hold"}
    assert_exact(STRUCTURES[name], asked, doubted=1.0 if several else 0.0)


@pytest.mark.parametrize("name", ["plain", "computing", "a whole period", "later", "tustin", "weighted", "stiff"])
def test_poles(name: str) -> None:
    assert_exact(STRUCTURES[name], [MetricRequest(metric=metric) for metric in POLES], doubted=0.0)


@pytest.mark.parametrize("unsettled", [True, False])
def test_runs_that_end_before_they_have_settled(unsettled: bool) -> None:
    for duration in (0.05, 0.4):
        assert_exact(STRUCTURES["computing"], requests(STEP, "y", duration, unsettled=unsettled), doubted=0.1)


def test_runs_of_their_own_length() -> None:
    asked = [
        MetricRequest(metric=metric, signals=STEP, output="y")
        for metric in ("overshoot", "settling_time", "iae", "peak")
    ]
    gains = {"pid.kp": (9.0,), "pid.ki": (20.0,), "pid.kd": (0.3,)}
    found = screened(STRUCTURES["computing"], asked, gains)
    exact = measure(STRUCTURES["computing"], asked, overrides={name: values[0] for name, values in gains.items()})
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[0], [measured.value for measured, _ in exact], rtol=1e-8)


def held(width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what the plant does in a time (s) under a held input."""
    whole = expm(np.array([[0, 1, 0], [0, -20.0, 20.0], [0, 0, 0]]) * width)
    return whole[:2, :2], whole[:2, 2]


@pytest.mark.parametrize("row", range(3))
def test_a_response_by_difference_equations(row: int) -> None:
    kp, ki, kd = (GAINS[f"pid.{name}"][row] for name in ("kp", "ki", "kd"))
    parts, duration = 500, 1.0
    steps = (round(DELAY / PERIOD * parts), parts)
    phi, gamma = held(PERIOD / parts)
    x, u, wanted, integral, last, derived, curve = np.zeros(2), 0.0, 0.0, 0.0, 0.0, 0.0, []
    for _ in range(round(duration / PERIOD)):
        error = 1.0 - x[0]
        integral += ki * PERIOD * error
        derived = (derived + FILTER * kd * (error - last)) / (1 + FILTER * PERIOD)
        last, wanted = error, kp * error + integral + derived
        for part in range(parts):
            u = wanted if part == steps[0] else u
            curve.append(x[0])
            x = phi @ x + gamma * u
    asked = [
        MetricRequest(metric=metric, signals=STEP, output="y", duration=duration) for metric in ("peak", "ise", "iae")
    ]
    found = screened(STRUCTURES["computing"], asked)
    errors = 1.0 - np.array([*curve, x[0]])
    width = PERIOD / parts
    expected = [max(curve), np.trapezoid(errors**2, dx=width), np.trapezoid(np.abs(errors), dx=width)]
    np.testing.assert_allclose(found.values[row], expected, rtol=2e-7)


@pytest.mark.parametrize("row", range(3))
def test_margins_by_the_z_transform(row: int) -> None:
    """Of the loop without computing time, on a fine grid of the unit circle."""
    kp, ki, kd = (GAINS[f"pid.{name}"][row] for name in ("kp", "ki", "kd"))
    phi, gamma = held(PERIOD)

    def opened(angle: np.ndarray) -> np.ndarray:
        z = np.exp(1j * angle)
        plant = np.linalg.solve(z[:, None, None] * np.eye(2) - phi, np.broadcast_to(gamma[:, None], (len(z), 2, 1)))[
            :, 0, 0
        ]
        law = kp + ki * PERIOD / (1 - 1 / z) + FILTER * kd * (1 - 1 / z) / ((1 + FILTER * PERIOD) - 1 / z)
        return plant * law

    angle = np.geomspace(1e-4, np.pi, 400_001)
    response = opened(angle)
    asked = [
        MetricRequest(metric=metric, open_at="e") for metric in ("sensitivity_peak", "phase_margin", "gain_margin_up")
    ]
    found = screened(STRUCTURES["plain"], asked)
    crossing = np.flatnonzero(np.diff(np.sign(np.abs(response) - 1)))
    share = (np.log(np.abs(response[crossing]))) / np.log(np.abs(response[crossing] / response[crossing + 1]))
    phases = np.angle(-opened(angle[crossing] ** (1 - share) * angle[crossing + 1] ** share))
    turning = np.flatnonzero((np.diff(np.sign(response.imag)) != 0) & (response.real[:-1] < 0))
    at = turning, response.imag[turning] / (response.imag[turning] - response.imag[turning + 1])
    gains = [-1 / (response.real[k] + s * (response.real[k + 1] - response.real[k])) for k, s in zip(*at, strict=True)]
    gains.append(-1 / response[-1].real if response[-1].real < 0 else np.inf)
    expected = [np.max(1 / np.abs(1 + response)), min(phases, key=abs), min(gain for gain in gains if gain > 1)]
    np.testing.assert_allclose(found.values[row], expected, rtol=1e-8)


def test_a_pole_at_the_nyquist_frequency_is_left_to_the_exact_path() -> None:
    law = block("discrete_transfer_function", numerator=[0.2, 0.5], denominator=[1.0, 1.0], sample_time=PERIOD)
    diagram = loop({"n": law}, delay=0.0)
    asked = [MetricRequest(metric=metric, open_at="e") for metric in LOOPS]
    gains = {"pid.kp": (0.4, 0.2), "pid.ki": (0.0, 0.0), "pid.kd": (0.0, 0.0)}
    found = screened(diagram, asked, gains)
    for row, kp in enumerate(gains["pid.kp"]):
        exact = measure(diagram, asked, overrides={"pid.kp": kp, "pid.ki": 0.0, "pid.kd": 0.0})
        for column, (measured, _) in enumerate(exact):
            if not found.doubtful[row, column]:
                assert found.values[row, column] == pytest.approx(measured.value, rel=1e-9)
    assert not found.doubtful.all()


def test_a_second_peak_is_not_hidden_by_a_plateau() -> None:
    """Of |T|, which is 1 as far as the loop follows and 1.002 where it rings: no sample of the scan is above 1."""
    between = {
        "n": block("discrete_transfer_function", numerator=[0.5, 0.2], denominator=[1.0, -0.3], sample_time=0.04)
    }
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), **between,
        "pid": block("sampled_pid", kp=0.68, ki=0.25, kd=0.0215, filter_frequency=25.0, sample_time=0.04, delay=0.012),
        "plant": block("transfer_function", numerator=[24.9], denominator=[1.0, 2.994, 24.9]),
    }  # fmt: skip
    wires = ("r -> e.in1", "plant -> e.in2", "e -> pid", "pid -> n", "n -> plant")
    diagram = compile_system(document(blocks, wires, {"y": "plant"}))
    gains = np.linspace(0.7, 1.0, 61)
    asked = [MetricRequest(metric="complementary_peak", open_at="e")]
    found = Screening(diagram, asked)({"pid.kp": gains})
    for kp, value in zip(gains[::6], found.values[::6, 0], strict=True):
        ((exact, _),) = measure(diagram, asked, overrides={"pid.kp": float(kp)})
        assert value == pytest.approx(exact.value, rel=1e-9)


def test_slopes() -> None:
    """Held against those of the exact path, which have references of their own; gains of 0 included."""
    diagram = STRUCTURES["computing"]
    asked = requests(STEP, "y", 1.0)[:10] + [MetricRequest(metric=metric, open_at="e") for metric in LOOPS]
    asked.append(MetricRequest(metric="damping_ratio"))
    for at in ({"pid.kp": 9.0, "pid.ki": 2.0, "pid.kd": 0.3}, {"pid.kp": 12.0, "pid.ki": 4.0, "pid.kd": 0.0}):
        step = 1e-30
        lanes = {name: np.array([value + 1j * step * (name == other) for other in at]) for name, value in at.items()}
        found = Screening(diagram, asked, threads=1)(lanes)
        gradient = measure(diagram, asked, overrides=at, gradient=list(at))
        for lane in range(len(at)):
            exact = [np.nan if slopes is None else slopes.values[lane] for _, slopes in gradient]
            told = ~found.doubtful[lane] & np.isfinite(exact)
            assert told.mean() > 0.8
            np.testing.assert_allclose(
                found.values[lane, told].imag / step, np.array(exact)[told], rtol=1e-6, atol=1e-9
            )


def test_numbers_do_not_depend_on_who_stands_beside() -> None:
    diagram = STRUCTURES["computing"]
    asked = requests(STEP, "y", 1.0)
    random = np.random.default_rng(3)
    candidates = {
        "pid.kp": random.uniform(2, 60, 70),
        "pid.ki": random.choice([0.0, 3.0], 70),
        "pid.kd": random.choice([0.0, 0.3], 70),
    }
    screening = Screening(diagram, asked, threads=2)
    whole = screening(candidates)
    for k in (0, 31, 32, 69):
        alone = screening({name: values[k : k + 1] for name, values in candidates.items()})
        np.testing.assert_array_equal(alone.values[0], whole.values[k])
        np.testing.assert_array_equal(alone.doubtful[0], whole.doubtful[k])


def test_sample_times_may_vary() -> None:
    diagram, asked = loop(delay=0.0), requests(STEP, "y", 1.0)[:9]
    periods = np.array([0.005, 0.01, 0.02, 0.01])
    found = Screening(diagram, asked)({"pid.sample_time": periods, "pid.kp": np.array([9.0, 9.0, 9.0, 12.0])})
    for row, (period, kp) in enumerate(zip(periods, (9.0, 9.0, 9.0, 12.0), strict=True)):
        exact = measure(diagram, asked, overrides={"pid.sample_time": float(period), "pid.kp": kp})
        for column, (measured, _) in enumerate(exact):
            if not found.doubtful[row, column]:
                assert found.values[row, column] == pytest.approx(measured.value, rel=1e-6, abs=1e-11)
    assert found.doubtful.mean() < 0.1


def test_values_out_of_bounds_are_none() -> None:
    asked = requests(STEP, "y", 1.0)[:2]
    found = Screening(loop(), asked)({"pid.filter_frequency": np.array([200.0, -1.0])})
    assert found.valid.tolist() == [True, False]


def test_a_global_search_ends_at_the_optimum() -> None:
    goals = (
        Goal(metric="ise", experiment="step", output="y", sense=Sense.MINIMIZE),
        Goal(metric="sensitivity_peak", open_at="e", upper=1.7),
    )
    asked = problem(
        Variable(parameter="pid.kp", lower=0.5, upper=60.0), Variable(parameter="pid.kd", lower=0.01, upper=2.0),
        goals=goals, kp=6.0, kd=0.3,
    )  # fmt: skip
    found = solve("global", asked, {"max_evaluations": 4000})
    kp, kd = found.best["pid.kp"], found.best["pid.kd"]
    assert largest_sensitivity(kp, kd) <= 1.7 + 2e-3
    assert squared_error(kp, kd) == pytest.approx(0.02172, rel=2e-3)


def test_every_metric_of_a_response_says_what_the_exact_path_says_or_doubts() -> None:
    """Also those that are not read off pieces, by discovery."""
    diagram = STRUCTURES["computing"]
    for kind, metric in catalogue().items():
        if metric.domain != "time" or metric.mask or metric.options:
            continue
        asked = [MetricRequest(metric=kind, signals=STEP, output="y", duration=1.0, options=Options(derivative=0))]
        found = screened(diagram, asked)
        for row in range(3):
            ((exact, _),) = measure(diagram, asked, overrides={name: values[row] for name, values in GAINS.items()})
            if not found.doubtful[row, 0] and np.isfinite(found.values[row, 0]):
                assert found.values[row, 0] == pytest.approx(exact.value, rel=1e-6, abs=1e-11)
