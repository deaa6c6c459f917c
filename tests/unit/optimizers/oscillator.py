"""The system of which every answer is known: a mass on a spring with a damper, moved by a force.

x / F = 1 / (m s² + c s + k),   ζ = c / (2 √(m k)),   overshoot = exp(-π ζ / √(1 - ζ²))
"""

from __future__ import annotations

import math
from typing import Any

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from optimizers.problem import Experiment, Goal, Problem, Sense, Variable

STEP = Experiment(name="step", signals={"force": make("step", {})})


def oscillator() -> Diagram:
    return compile_system(
        System(
            parameters={
                "m": Parameter(value=1.0, lower=0.01, upper=100.0),
                "c": Parameter(value=1.0, lower=0.01, upper=100.0),
                "k": Parameter(value=1.0, lower=0.01, upper=100.0),
                "idle": Parameter(value=1.0),
            },
            blocks={
                "force": Block(kind="input"),
                "body": Block(
                    kind="transfer_function", values={"numerator": ["=k"], "denominator": ["=m", "=c", "=k"]}
                ),
            },
            connections=(Connection(source="force", target="body"),),
            outputs={"x": "body"},
        )
    )


def damping_for(overshoot: float) -> float:
    """Return ζ of an overshoot."""
    size = math.log(overshoot) ** 2
    return math.sqrt(size / (math.pi**2 + size))


def problem(**changes: Any) -> Problem:
    """The least damper constant that keeps the overshoot below 4 %: a bandwidth as large as can be."""
    parts: dict[str, Any] = {
        "diagram": oscillator(),
        "variables": (Variable(parameter="c", lower=0.1, upper=10.0),),
        "experiments": (STEP,),
        "goals": (
            Goal(metric="bandwidth", source="force", target="x", sense=Sense.MAXIMIZE),
            Goal(metric="overshoot", experiment="step", output="x", upper=0.04),
        ),
    }
    return Problem(**{**parts, **changes})
