"""Feed-forward that nearly cancels an error: its least peak, against a linear programme.

The error is affine in the gains, e = e_0 + kv e_v + ka e_a, so that its least peak over the instants of a fine grid is a linear
programme; at the optimum four extrema are equally high, six decades below the motion.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from engine.analysis.study import simulate
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.search.result import Status
from tests.reference.systems import block, system

MOVE = {"r": make("s_curve", {"distance": 1.0, "max_velocity": 1.0, "max_acceleration": 5.0, "max_jerk": 100.0})}


def positioning() -> Problem:
    """Return a PD loop around 1/(0.01 s² + 0.2 s) with feed-forward of velocity and acceleration."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "u": block("sum", signs="++"),
        "pd": block("pd", kp=100.0, kd=2.0, filter_frequency=2000.0),
        "ahead": block("feed_forward", kv="=kv", ka="=ka", filter_frequency=2000.0),
        "plant": block("transfer_function", numerator=[1.0], denominator=[0.01, 0.2, 0.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "plant -> e.in2", "e -> pd", "r -> ahead", "pd -> u.in1", "ahead -> u.in2", "u -> plant"]
    return Problem(
        diagram=system(blocks, wires, {"y": "plant", "e": "e"}, {"kv": 0.1, "ka": 0.005}),
        variables=(Variable(parameter="kv", lower=0.0, upper=0.5), Variable(parameter="ka", lower=0.0, upper=0.05)),
        experiments=(Experiment(name="move", signals=MOVE),),
        goals=(Goal(metric="peak", experiment="move", output="e", sense=Sense.MINIMIZE),),
    )


def least_peak(problem: Problem) -> float:
    """Return the least peak over a grid of 20,001 instants."""

    def error(kv: float, ka: float) -> np.ndarray:
        found = simulate(
            problem.diagram, signals=MOVE, outputs=["e"], overrides={"kv": kv, "ka": ka}, duration=2.0, samples=20_001, metrics=[],
        )  # fmt: skip
        return np.asarray(found.curves["e"])

    base, unit = error(0.2, 0.01), 1e-6
    slopes = np.column_stack([error(0.3, 0.01) - base, error(0.2, 0.02) - base]) * [1e-3, 1e-3] / unit
    ones = np.ones((len(base), 1))
    found = linprog(
        [0.0, 0.0, 1.0], A_ub=np.block([[slopes, -ones], [-slopes, -ones]]), b_ub=np.concatenate([-base, base]) / unit,
        bounds=[(None, None), (None, None), (0, None)], method="highs-ds",
    )  # fmt: skip
    assert found.status == 0
    return float(found.x[2]) * unit


def test_the_least_peak_of_an_error_that_is_nearly_cancelled_is_found() -> None:
    problem = positioning()
    expected = least_peak(problem)
    found = minimize("gradient", problem, {"starts": 1, "seed": 1, "max_evaluations": 80})
    assert found.objective == pytest.approx(expected, rel=5e-3)
    assert found.objective >= expected * (1 - 1e-6)
    assert found.status in {Status.BUDGET, Status.CONVERGED}
    assert found.certificate.valid
