"""Optima on ridges, where several functions are equally large: they are reached, proven, or called what they are."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.optimize import differential_evolution, minimize_scalar
from scipy.optimize import minimize as scipy_minimize

from engine.signals import make
from optimizers import methods
from optimizers.evaluation.evaluate import Evaluator
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.search.proving import polish
from optimizers.search.report import conclude
from optimizers.search.result import Result, Status, Unwatched
from optimizers.search.search import STATIONARY, Tracker
from tests.reference.systems import block, system

RESONANCES = (85.0, 100.0, 117.0)
GAIN, DEPTH = 4.0, 0.02
RANGES = {"nf": (60.0, 160.0), "nw": (0.05, 3.0)}
OMEGA = np.geomspace(1.0, 1e3, 2000)


def notch() -> Problem:
    """Return the least sensitivity peak of a drive whose resonance lies at three frequencies: where and how wide is its notch?"""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "kp": block("gain", gain=GAIN),
        "notch": block("transfer_function", numerator=[1.0, f"={DEPTH}*nw*nf", "=nf**2"], denominator=[1.0, "=nw*nf", "=nf**2"]),
        "plant": block("transfer_function", numerator=["=w**2"], denominator=[1.0, "=0.04*w", "=w**2", 0.0]),
    }  # fmt: skip
    return Problem(
        diagram=system(
            blocks, ["r -> e.in1", "plant -> e.in2", "e -> kp", "kp -> notch", "notch -> plant"], {"y": "plant"},
            {"w": 100.0, "nf": 100.0, "nw": 0.5},
        ),
        variables=tuple(Variable(parameter=name, lower=low, upper=high) for name, (low, high) in RANGES.items()),
        experiments=(),
        goals=(Goal(metric="sensitivity_peak", open_at="e", sense=Sense.MINIMIZE),),
        scenarios=tuple({"w": w} for w in RESONANCES),
    )  # fmt: skip


def sensitivity(nf: float, nw: float) -> float:
    """Return the largest sensitivity peak of the three as python-control has it; infinite where one is unstable."""
    worst = 0.0
    for w in RESONANCES:
        loop = control.tf([1.0, DEPTH * nw * nf, nf**2], [1.0, nw * nf, nf**2]) * control.tf(
            [GAIN * w**2], [1.0, 0.04 * w, w**2, 0.0]
        )
        if np.roots(np.polyadd(loop.den[0][0], loop.num[0][0])).real.max() >= 0:
            return np.inf
        shape = np.abs(1 / (1 + loop(1j * OMEGA)))
        for top in 1 + np.flatnonzero(
            (shape[1:-1] >= shape[:-2]) & (shape[1:-1] >= shape[2:]) & (shape[1:-1] > 0.98 * worst)
        ):
            found = minimize_scalar(
                lambda x, loop=loop: -abs(1 / (1 + loop(1j * x))), bounds=(OMEGA[top - 1], OMEGA[top + 1]),
                method="bounded", options={"xatol": 1e-9},
            )  # fmt: skip
            worst = max(worst, -float(found.fun))
    return worst


def test_the_notch_of_three_resonances_is_as_good_as_that_of_an_independent_search() -> None:
    found = methods.minimize("gradient", notch(), {"starts": 1})
    reached = sensitivity(**found.best)
    coarse = differential_evolution(
        lambda x: min(sensitivity(*x), 1e3), list(RANGES.values()), seed=1, popsize=8, maxiter=8, polish=False
    )
    fine = scipy_minimize(
        lambda x: sensitivity(*x), coarse.x, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9, "maxfev": 200}
    )
    assert reached == pytest.approx(found.objective, rel=1e-6)
    assert reached <= fine.fun * (1 + 1e-5)
    assert found.status is Status.CONVERGED
    assert found.stationarity is not None
    assert found.stationarity <= STATIONARY


def bent(slope: float) -> Problem:
    """Return f = 1 + (x - 0.8)² + slope |y - x²| as the worst of two scenarios: a ridge along y = x², whose lowest point is (0.8, 0.64)."""
    blocks = {
        "u": block("input"), "lag": block("transfer_function", numerator=[1.0], denominator=[1.0, 1.0]),
        "f": block("gain", gain=f"=1 + (x - 0.8)**2 + {slope}*s*(y - x*x)"),
    }  # fmt: skip
    return Problem(
        diagram=system(blocks, ["u -> lag", "lag -> f"], {"f": "f"}, {"x": 0.3, "y": 0.09, "s": 1.0}),
        variables=tuple(Variable(parameter=name, lower=-0.2, upper=1.0) for name in ("x", "y")),
        experiments=(Experiment(name="step", signals={"u": make("step", {})}),),
        goals=(Goal(metric="peak", experiment="step", output="f", sense=Sense.MINIMIZE),),
        scenarios=({"s": 1.0}, {"s": -1.0}),
    )


def polished(slope: float, begin: float, evaluations: int) -> Result:
    """Return what the polish makes of a point on the ridge."""
    tracker = Tracker(Evaluator(bent(slope)), Unwatched(), 10**6)
    tracker.local((np.array([begin, begin * begin]) + 0.2) / 1.2)
    polish(tracker, np.zeros(1), evaluations=evaluations)
    assert tracker.best is not None
    return conclude(tracker, tracker.best, Status.CONVERGED, "")


@pytest.mark.parametrize("slope", [0.3, 3.0, 10.0])
@pytest.mark.parametrize("begin", [-0.1, 0.3])
def test_a_search_that_begins_on_a_ridge_moves_along_it(slope: float, begin: float) -> None:
    found = polished(slope, begin, 40)
    assert found.status is Status.CONVERGED
    assert found.objective == pytest.approx(1.0, abs=1e-6)


def test_a_point_on_a_ridge_that_has_not_been_left_is_no_optimum() -> None:
    # along the ridge f' = 2 (x - 0.8) = -1 at x = 0.3, over a range of 1.2: 1 % of it promises 0.012 of 1.25
    found = polished(10.0, 0.3, 1)
    assert found.status is Status.STALLED
    assert found.stationarity is not None
    assert 0.5 * 0.012 / 1.25 < found.stationarity < 1.1 * 0.012 / 1.25
    assert "1 %" in found.advice
