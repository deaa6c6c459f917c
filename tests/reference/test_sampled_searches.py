"""Searches over loops with a sampled controller: held against the z-domain by hand, at every value and at gains of 0.

x+ = Φ x + Γ u,  y = x_1,  P(z) = c (z 1 - Φ)⁻¹ Γ;   D(z) = w kd (1 - 1/z)/((1 + w T) - 1/z);   L = P (kp + D)
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from engine import metrics
from engine.analysis.study import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system
from engine.metrics._base import LoopMetric, PathMetric, TimeMetric
from engine.signals import make
from optimizers.evaluation.evaluate import Evaluator
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.solving.solve import solve
from tests.unit.engine.diagrams import block, document

PERIOD, FILTER, DURATION = 0.02, 200.0, 4.0
STEP = make("step", {"amplitude": 1.0})


def loop(**gains: float) -> Diagram:
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"),
        "pid": block("sampled_pid", filter_frequency=FILTER, sample_time=PERIOD, **gains),
        "plant": block("transfer_function", numerator=[1.0], denominator=[0.05, 1.0, 0.0]),
    }  # fmt: skip
    wires = ("r -> e.in1", "plant -> e.in2", "e -> pid", "pid -> plant")
    return compile_system(document(blocks, wires, {"y": "plant"}))


def held(width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return Φ and Γ of the plant over a time (s)."""
    whole = expm(np.array([[0, 1, 0], [0, -20.0, 20.0], [0, 0, 0]]) * width)
    return whole[:2, :2], whole[:2, 2]


def largest_sensitivity(kp: float, kd: float) -> float:
    z = np.exp(1j * np.linspace(1e-4, np.pi, 20_001))
    phi, gamma = held(PERIOD)
    whole = z[:, None, None] * np.eye(2) - phi
    plant = np.linalg.solve(whole, np.broadcast_to(gamma[:, None], (len(z), 2, 1)))[:, 0, 0]
    derivative = FILTER * kd * (1 - 1 / z) / ((1 + FILTER * PERIOD) - 1 / z)
    return float(np.max(1 / np.abs(1 + plant * (kp + derivative))))


def squared_error(kp: float, kd: float) -> float:
    parts = 20
    phi, gamma = held(PERIOD / parts)
    x, last, derived, errors = np.zeros(2), 0.0, 0.0, []
    for _ in range(round(DURATION / PERIOD)):
        error = 1.0 - x[0]
        derived = (derived + FILTER * kd * (error - last)) / (1 + FILTER * PERIOD)
        last, u = error, kp * error + derived
        for _ in range(parts):
            errors.append(1.0 - x[0])
            x = phi @ x + gamma * u
    return float(np.trapezoid(np.square([*errors, 1.0 - x[0]]), dx=PERIOD / parts))


def problem(*variables: Variable, goals: tuple[Goal, ...], **gains: float) -> Problem:
    experiment = Experiment(name="step", signals={"r": STEP}, duration=DURATION)
    return Problem(diagram=loop(**gains), variables=variables, experiments=(experiment,), goals=goals)


SQUARED = Goal(metric="ise", experiment="step", output="y", sense=Sense.MINIMIZE)
ROBUST = Goal(metric="sensitivity_peak", open_at="e", upper=1.7)


def requests() -> list[MetricRequest]:
    found = []
    for kind, metric in metrics.catalogue().items():
        if metric.mask or issubclass(metric, TimeMetric):
            continue
        if issubclass(metric, LoopMetric):
            found.append(MetricRequest(metric=kind, open_at="e"))
        elif issubclass(metric, PathMetric):
            found.append(MetricRequest(metric=kind, source="r", target="y"))
        else:
            found.append(MetricRequest(metric=kind))
    return found


@pytest.mark.parametrize("request_", requests(), ids=lambda one: one.metric)
def test_what_a_batch_says_of_a_sampled_loop_is_what_is_so(request_) -> None:
    made = loop(kp=9.0, ki=2.0, kd=0.3)
    found = Screening(made, [request_])({"pid.kp": np.array([9.0, 20.0]), "pid.kd": np.array([0.3, 1.0])})
    for k, gains in enumerate(((9.0, 0.3), (20.0, 1.0))):
        if np.isnan(found.values[k, 0]) or found.doubtful[k, 0]:
            continue
        ((exact, _),) = measure(made, [request_], overrides=dict(zip(("pid.kp", "pid.kd"), gains, strict=True)))
        assert exact.value is not None
        assert found.values[k, 0] == pytest.approx(exact.value, rel=1e-6)


def test_a_search_finds_the_optimum_of_the_sampled_loop() -> None:
    asked = problem(
        Variable(parameter="pid.kp", lower=0.5, upper=60.0), Variable(parameter="pid.kd", lower=0.01, upper=2.0),
        goals=(SQUARED, ROBUST), kp=6.0, kd=0.3,
    )  # fmt: skip
    found = solve("gradient", asked, {"starts": 1})
    kp, kd = found.best["pid.kp"], found.best["pid.kd"]
    assert largest_sensitivity(kp, kd) == pytest.approx(1.7, abs=2e-3)
    assert found.goals[0].after.value == pytest.approx(squared_error(kp, kd), rel=1e-3)
    grid = [(p, d) for p in np.linspace(10, 34, 13) for d in np.linspace(0.5, 2, 11)]
    best = min(squared_error(*gains) for gains in grid if largest_sensitivity(*gains) <= 1.7)
    assert found.goals[0].after.value <= best * (1 + 1e-6)


MARGINS = ("phase_margin", "gain_margin", "delay_margin", "disk_margin", "sensitivity_peak")


@pytest.mark.parametrize("at", [{"ki": 0.0, "kd": 0.1}, {"ki": 1.0, "kd": 0.0}, {"ki": 0.0, "kd": 0.0}])
def test_slopes_at_gains_of_zero(at) -> None:
    names = ("ki", "kd")
    variables = [Variable(parameter=f"pid.{name}", lower=-1.0, upper=1.0) for name in names]
    margins = [Goal(metric=metric, open_at="e", lower=0.1) for metric in MARGINS]
    asked = problem(*variables, goals=(SQUARED, *margins), kp=8.0, **at)
    position = np.array([(at[name] + 1.0) / 2.0 for name in names])
    local = Evaluator(asked).local(position)
    assert local is not None
    step = 1e-4

    def values(name: str, moved: float) -> np.ndarray:
        here = {f"pid.{key}": value for key, value in {**at, name: at[name] + moved}.items()}
        return np.array([found.value for found, _ in measure(asked.diagram, asked.requests, overrides=here)])

    for k, name in enumerate(names):
        ahead = [values(name, factor * step) for factor in (0, 1, 2, 3)]
        slope = (-11 * ahead[0] + 18 * ahead[1] - 9 * ahead[2] + 2 * ahead[3]) / (6 * step)
        # Beside 0 an integral part never comes to rest: peaks have no slope there.
        told = slice(4) if name == "ki" and at["ki"] == 0.0 else slice(6)
        np.testing.assert_allclose(local.slopes[0, told, k] / 2.0, slope[told], rtol=1e-4, atol=1e-8)


def test_a_search_begins_at_an_integral_gain_of_zero() -> None:
    asked = problem(
        Variable(parameter="pid.kp", lower=0.5, upper=60.0), Variable(parameter="pid.ki", lower=0.0, upper=60.0),
        goals=(SQUARED, ROBUST), kp=6.0, kd=0.3,
    )  # fmt: skip
    found = solve("gradient", asked, {"starts": 1})
    assert found.certificate.valid
    assert found.goals[0].after.value < found.goals[0].before.value


@pytest.mark.parametrize("periods", [(0.01,), (0.01, 0.01), (0.01, 0.005), (0.01, 0.002)])
def test_a_mode_that_changes_its_sign_at_each_sample_oscillates_behind_two_holds(periods) -> None:
    """z = 1 - k T = -0.7:  s = (ln 0.7 + j π) / T."""
    holds = {f"h{k}": block("zero_order_hold", sample_time=period) for k, period in enumerate(periods)}
    blocks = {
        "r": block("input"),
        "e": block("sum", signs="+-"),
        "g": block("gain", gain=170.0),
        **holds,
        "p": block("integrator"),
    }
    chain = ["e", "g", *holds, "p"]
    wires = ["r -> e.in1", "p -> e.in2", *(f"{a} -> {b}" for a, b in pairwise(chain))]
    made = compile_system(document(blocks, wires, {"y": "p"}))
    pole = complex(np.log(0.7), np.pi) / 0.01
    asked = [MetricRequest(metric=metric) for metric in ("damping_ratio", "critical_frequency", "spectral_abscissa")]
    expected = (-pole.real / abs(pole), abs(pole), pole.real)
    for (found, _), value in zip(measure(made, asked), expected, strict=True):
        assert found.value == pytest.approx(value, rel=1e-9)
