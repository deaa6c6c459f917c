"""The job that the tests solve: a servo-hydraulic position loop with a valve lag and a transport delay, PID or PD2."""

from __future__ import annotations

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Scenario, Sense, Variable

SCENARIOS: tuple[Scenario, ...] = (
    {"lag": 0.0005, "delay": 0.0044, "velocity_gain": 49.0},
    {"lag": 0.0012, "delay": 0.0036, "velocity_gain": 51.0},
)
STEP = Experiment(name="step", signals={"reference": make("step", {})})


def loop(controller: Block, parameters: dict[str, Parameter], *, delay: float = 0.004) -> Diagram:
    plant = {
        "lag": Parameter(value=0.0008, unit="s"),
        "delay": Parameter(value=delay, unit="s"),
        "velocity_gain": Parameter(value=50.0),
    }
    return compile_system(
        System(
            name="position loop",
            parameters={**parameters, **plant},
            blocks={
                "reference": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "controller": controller,
                "valve": Block(
                    kind="transfer_function", values={"numerator": ["=velocity_gain"], "denominator": ["=lag", 1.0]}
                ),
                "cylinder": Block(kind="integrator"),
                "transport": Block(kind="delay", values={"time": "=delay"}),
            },
            connections=tuple(
                Connection(source=source, target=target)
                for source, target in (
                    ("reference", "error.in1"),
                    ("transport", "error.in2"),
                    ("error", "controller"),
                    ("controller", "valve"),
                    ("valve", "cylinder"),
                    ("cylinder", "transport"),
                )
            ),
            outputs={"position": "cylinder", "velocity": "valve", "control": "controller"},
        )
    )


def pid_loop(**keywords: float) -> Diagram:
    block = Block(kind="pid", values={"kp": "=kp", "ki": "=ki", "kd": "=kd", "filter_frequency": 2000.0})
    return loop(
        block,
        {
            "kp": Parameter(value=1.0, lower=0.2, upper=5.0, scale="log"),
            "ki": Parameter(value=40.0, lower=20.0, upper=200.0, scale="log"),
            "kd": Parameter(value=0.001, lower=1e-4, upper=0.01, scale="log"),
        },
        **keywords,
    )


def pd2_loop() -> Diagram:
    block = Block(kind="pd2", values={"kp": "=kp", "kd1": "=kd1", "kd2": "=kd2", "filter_frequency": "=filter"})
    return loop(
        block,
        {
            "kp": Parameter(value=1.0, lower=0.2, upper=5.0, scale="log"),
            "kd1": Parameter(value=1e-3, lower=1e-4, upper=0.03, scale="log"),
            "kd2": Parameter(value=1e-6, lower=1e-8, upper=1e-4, scale="log"),
            "filter": Parameter(value=1500.0, lower=300.0, upper=3000.0, scale="log"),
        },
    )


def fastest(diagram: Diagram, *names: str, scenarios: tuple[Scenario, ...] = SCENARIOS) -> Problem:
    """Minimal response time without overshoot, with a robust loop and five times the effort of the proportional law."""
    return Problem(
        diagram=diagram,
        variables=tuple(Variable(parameter=name) for name in names),
        experiments=(STEP,),
        goals=(
            Goal(metric="response_time", experiment="step", output="position", sense=Sense.MINIMIZE),
            Goal(metric="overshoot", experiment="step", output="position", upper=0.001),
            Goal(metric="sensitivity_peak", open_at="error", upper=1.6),
            Goal(metric="control_effort", experiment="step", output="control", upper=5.0),
        ),
        scenarios=scenarios,
    )
