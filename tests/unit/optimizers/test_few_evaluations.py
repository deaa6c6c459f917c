"""Searches on plants with limits: where a candidate takes long, few are evaluated, and the optimum is the same."""

from __future__ import annotations

import pytest
from scipy.optimize import minimize_scalar

from engine.diagram.diagram import Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from optimizers.evaluation import measuring
from optimizers.evaluation.evaluate import Cost, Evaluator
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable
from tests.unit.engine.diagrams import block

STEP = Experiment(name="step", signals={"r": make("step", {"amplitude": 2.0})})


def drive() -> Diagram:
    """A speed loop: PI law, an amplifier that ends at ±3, a drive and a sensor."""
    wires = [("r", "error.in1"), ("error", "law"), ("law", "amplifier"), ("amplifier", "drive"), ("drive", "sensor")]
    return compile_system(
        System(
            parameters={
                "kp": Parameter(value=2.0, lower=0.2, upper=20.0, scale="log"),
                "ki": Parameter(value=5.0, lower=0.5, upper=50.0, scale="log"),
            },
            blocks={
                "r": block("input"), "error": block("sum", signs="+-"), "law": block("pi", kp="=kp", ki="=ki"),
                "amplifier": block("saturation", lower=-3.0, upper=3.0),
                "drive": block("transfer_function", numerator=[1.0], denominator=[0.2, 1.0]),
                "sensor": block("low_pass", frequency=60.0, order=1),
            },
            connections=tuple(Connection(source=a, target=b) for a, b in [*wires, ("sensor", "error.in2")]),
            outputs={"speed": "drive", "voltage": "amplifier"},
        )
    )  # fmt: skip


def problem(*names: str) -> Problem:
    return Problem(
        diagram=drive(), variables=tuple(Variable(parameter=name, scale="log") for name in names), experiments=(STEP,),
        goals=(
            Goal(metric="itae", experiment="step", output="speed", sense=Sense.MINIMIZE),
            Goal(metric="overshoot", experiment="step", output="speed", upper=0.05),
            Goal(metric="phase_margin", open_at="error", lower=0.9),
        ),
    )  # fmt: skip


def test_a_line_takes_some_dozen_evaluations() -> None:
    made = problem("kp")
    found = minimize("gradient", made)
    assert found.certificate.valid
    assert found.evaluations <= 60

    # Beside a search of scipy's on the same metrics, which leaves the line where a bound is broken.
    def exactly(position: float) -> float:
        measured = [one.value for one, _ in measuring.measured(made, made.values([position]), {})]
        itae, overshoot, margin = (float("nan") if value is None else value for value in measured)
        return itae if overshoot <= 0.05 and margin >= 0.9 else 10.0

    least = min(
        minimize_scalar(exactly, bounds=(low, low + 0.25), method="bounded", options={"xatol": 1e-4}).fun
        for low in (0.0, 0.25, 0.5, 0.75)
    )
    assert found.objective == pytest.approx(least, rel=1e-3)
    assert found.objective <= least * (1 + 1e-6)


def test_batches_make_the_way_in_a_plane(monkeypatch: pytest.MonkeyPatch) -> None:
    made = problem("kp", "ki")
    assert Evaluator(made).cost is Cost.BATCHES
    exact, counted = measuring.measure, []
    monkeypatch.setattr(measuring, "measure", lambda *given, **named: counted.append(1) or exact(*given, **named))
    found = minimize("gradient", made)
    assert found.certificate.valid
    # Of more than a thousand candidates; beside each optimum, its proof and what batches cannot vouch for.
    assert found.evaluations > 1000
    assert len(counted) < 200
    # Nowhere on a grid is there anything better.
    grid = minimize("grid", made, {"points": {"kp": 16, "ki": 16}, "refine": 0})
    assert found.objective <= grid.objective * (1 + 1e-6)
