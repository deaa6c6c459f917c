"""A semi-active law that switches at once: its influence, and searches that come to it, from a smooth transition."""

from __future__ import annotations

import numpy as np
import pytest

from engine.analysis.influence import influence
from engine.analysis.measuring import MetricRequest
from engine.diagram.diagram import compile_system
from engine.model.verdicts import Verdict
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from tests.reference.event_driven._loop import Command
from tests.reference.event_driven._semi_active import SemiActive
from tests.unit.engine.diagrams import block, document

CAR = {
    "m": 250.0, "k": 16000.0, "kp": 2500.0, "d": 0.7, "damping": [200.0, 2000.0], "dry": [20.0, 300.0], "damper": "bingham", "vt": 0.01,
    "rho": 1000.0, "law": "skyhook", "off": 0.0, "on": 1.0, "transition": 0.0, "duration": 0.8,
}  # fmt: skip
ROAD = Command(kind="sine", size=0.02, frequency=9.0)


def car():
    """Return the loop, compiled, and what is asked of it."""
    loop = SemiActive(CAR, ROAD)
    blocks, wires, outputs = loop.document()
    made = compile_system(document({"r": block("input"), **blocks}, wires, outputs))
    return loop, made, {"r": ROAD.signal()}


def squared(loop: SemiActive) -> float:
    """Return ∫ (r - x)² dt of the equations by hand."""
    course = loop.course()
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for dense, low, high in zip(course.dense, course.edges[:-1], course.edges[1:], strict=True):
        times = 0.5 * (low + high) + 0.5 * (high - low) * nodes
        total += 0.5 * (high - low) * float(weights @ np.array([(ROAD.at(t) - dense(t)[0]) ** 2 for t in times]))
    return total


def test_influence_at_no_transition_is_had_from_differences():
    loop, made, signals = car()
    request = MetricRequest(metric="ise", signals=signals, output="x", duration=CAR["duration"])
    found = influence(made, {"ise": request}, ["law.transition", "law.on"])
    assert found.base["ise"].value == pytest.approx(squared(loop), rel=1e-6)
    assert found.elasticities["ise"]["law.transition"].one_sided
    high, low = (squared(SemiActive({**CAR, "on": 1.0 + h}, ROAD)) for h in (1e-4, -1e-4))
    slope = (high - low) / 2e-4 / found.base["ise"].value
    assert found.elasticities["ise"]["law.on"].value == pytest.approx(slope, rel=1e-4)


def test_a_search_down_to_no_transition():
    """Every candidate has a value, that without a transition, too."""
    _, made, signals = car()
    problem = Problem(
        diagram=made, variables=(Variable(parameter="law.transition", lower=0.0, upper=0.02),),
        experiments=(Experiment(name="road", signals=signals, duration=CAR["duration"]),),
        goals=(Goal(metric="ise", experiment="road", output="x", sense=Sense.MINIMIZE),),
    )  # fmt: skip
    found = minimize("grid", problem, {"points": 5})
    (goal,) = found.goals
    assert goal.after.verdict is Verdict.OK
    assert found.certificate.valid
