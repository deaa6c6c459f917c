"""A candidate whose run ends before its time is never taken.

x' = a + x² ends at π/(2 √a), before 3 s for a > (π/6)². Beside it runs a lag whose ∫|e| is 1 - e^-T: the shorter the run, the less.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.verdicts import Verdict
from engine.signals import make
from optimizers.evaluation.evaluate import Assessment, Evaluator
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from optimizers.search.result import Status, Unwatched
from optimizers.search.search import Tracker

LONGEST = (math.pi / 6) ** 2
WHOLE = 1 - math.exp(-3)
ERROR = Goal(metric="iae", experiment="step", output="y", sense=Sense.MINIMIZE)


def escaping() -> Diagram:
    """x' = a r + x², and a lag of 1 s."""
    blocks = {
        "r": Block(kind="input"), "a": Block(kind="gain", values={"gain": "=a"}),
        "n": Block(kind="sum", values={"signs": "++"}), "p": Block(kind="multiplication"),
        "x": Block(kind="integrator"),
        "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 1.0]}),
    }  # fmt: skip
    wires = [("r", "a"), ("a", "n.in1"), ("p", "n.in2"), ("n", "x"), ("x", "p.in1"), ("x", "p.in2"), ("r", "lag")]
    return compile_system(
        System(
            name="escaping", parameters={"a": Parameter(value=1.0)}, blocks=blocks, outputs={"y": "lag", "x": "x"},
            connections=tuple(Connection(source=source, target=target) for source, target in wires),
        )
    )  # fmt: skip


def problem(lower: float, upper: float, *goals: Goal) -> Problem:
    return Problem(
        diagram=escaping(),
        variables=(Variable(parameter="a", lower=lower, upper=upper, scale="log"),),
        experiments=(Experiment(name="step", signals={"r": make("step", {})}, duration=3.0),),
        goals=goals or (ERROR,),
    )


METHODS = {"grid": {}, "gradient": {"max_evaluations": 60}, "global": {"max_evaluations": 60}}


@pytest.mark.parametrize("kind", METHODS)
def test_the_best_run_is_a_whole_one(kind):
    found = minimize(kind, problem(0.05, 0.5), METHODS[kind])
    assert found.best["a"] < LONGEST
    assert found.objective == pytest.approx(WHOLE, rel=1e-9)
    assert found.certificate.valid
    before = found.goals[0].before
    assert (before.value, before.verdict) == (None, Verdict.UNSTABLE)
    assert "of 3 s" in before.advice


def test_where_no_run_is_whole_there_is_no_optimum():
    found = minimize("grid", problem(0.5, 2.0), {"points": 5})
    assert found.status is Status.INFEASIBLE
    assert not found.certificate.valid
    assert math.isnan(found.objective)
    assert found.advice
    after = found.goals[0].after
    assert (after.value, after.verdict) == (None, Verdict.UNSTABLE)
    assert "of 3 s" in after.advice


@pytest.mark.parametrize("goal", [ERROR, Goal(metric="iae", experiment="step", output="y", upper=10.0, hard=False)])
def test_such_a_candidate_ranks_behind_every_whole_one(goal):
    found = Evaluator(problem(0.05, 2.0, goal)).assess(np.array([[0.0], [0.5], [1.0]]))
    assert found.violation[0] == 0.0
    assert (found.violation[1:] >= 900).all()
    assert found.order()[0] == 0


def test_what_the_fast_evaluation_takes_for_the_best_must_have_a_whole_run(monkeypatch):
    """Here it finds every candidate good, the better the larger a is; the runs of the three largest end before their time."""
    positions = np.linspace(0.0, 1.0, 6)[:, None]

    def deceived(_evaluator: Evaluator, points: np.ndarray, *, roughly: bool = False) -> Assessment:
        good = np.zeros(len(points))
        return Assessment(
            objective=1 - points[:, 0], violation=good.copy(), values=np.ones((len(points), 1, 1)), doubtful=good > 0
        )

    monkeypatch.setattr(Evaluator, "assess", deceived)
    tried = problem(0.05, 2.0)
    tracker = Tracker(Evaluator(tried), Unwatched(), 100)
    found = tracker.assess(positions)
    whole = np.array([tried.values(position)["a"] < LONGEST for position in positions])
    assert 0 < whole.sum() < 6
    assert tracker.best == positions[whole][-1]
    assert tracker.rank == (0.0, 1 - tracker.best[0])
    # who would have become the best on the way is known to be broken, who comes after it is not asked
    assert (found.violation[~whole] >= 900).all()
