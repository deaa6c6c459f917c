"""Minimax over scenarios: a robust notch for a drive whose resonance lies at three frequencies."""

from __future__ import annotations

from engine.diagram.diagram import Block, Connection, Parameter, System, compile_system
from engine.signals import make
from optimizers.methods import minimize
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable


def robust_notch() -> Problem:
    """Gain, frequency, depth and width of a notch before w²/(s (s² + 0.04 w s + w²)), w of 85, 100 and 117 rad/s."""
    diagram = compile_system(
        System(
            parameters={
                "w": Parameter(value=100.0, lower=50.0, upper=200.0, scale="log"),
                "kp": Parameter(value=5.0, lower=0.5, upper=60.0, scale="log"),
                "nf": Parameter(value=100.0, lower=60.0, upper=160.0, scale="log"),
                "nd": Parameter(value=0.2, lower=0.01, upper=1.0, scale="log"),
                "nw": Parameter(value=0.5, lower=0.05, upper=3.0, scale="log"),
            },
            blocks={
                "reference": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "notch": Block(
                    kind="transfer_function",
                    values={"numerator": [1.0, "=nw*nd*nf", "=nf**2"], "denominator": [1.0, "=nw*nf", "=nf**2"]},
                ),
                "control": Block(kind="gain", values={"gain": "=kp"}),
                "plant": Block(
                    kind="transfer_function",
                    values={"numerator": ["=w**2"], "denominator": [1.0, "=0.04*w", "=w**2", 0.0]},
                ),
            },
            connections=(
                Connection(source="reference", target="error.in1"),
                Connection(source="error", target="control"),
                Connection(source="control", target="notch"),
                Connection(source="notch", target="plant"),
                Connection(source="plant", target="error.in2"),
            ),
            outputs={"y": "plant"},
        )
    )
    return Problem(
        diagram=diagram,
        variables=tuple(Variable(parameter=name) for name in ("kp", "nf", "nd", "nw")),
        experiments=(Experiment(name="s", signals={"reference": make("step")}),),
        goals=(
            Goal(metric="settling_time", experiment="s", output="y", sense=Sense.MINIMIZE),
            Goal(metric="sensitivity_peak", open_at="error", upper=1.6),
            Goal(metric="overshoot", experiment="s", output="y", upper=0.05),
        ),
        scenarios=({"w": 85.0}, {"w": 100.0}, {"w": 117.0}),
    )


def test_the_best_point_beside_an_edge_in_several_scenarios_is_reached() -> None:
    found = minimize("gradient", robust_notch(), {"seed": 0})
    # pycma with 12,000 evaluations around the best of several runs, penalties for what is broken: 0.167566 s, where the
    # overshoots of two scenarios are just the band of 2 %
    assert found.certificate.valid
    assert found.objective <= 0.167566 * 1.001
