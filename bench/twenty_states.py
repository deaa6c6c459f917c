"""A position loop with 20 states and 8 parameters: what a latency is measured on.

PID with filter (2 states), amplifier lag (1), eight oscillating sections (16), integrating drive (1).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

from engine.analysis.measuring import MetricRequest
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make

PARAMETERS: Final = {
    "kp": 8.0,
    "ki": 2.0,
    "kd": 0.1,
    "lag": 0.002,
    "w1": 150.0,
    "w2": 220.0,
    "d1": 0.3,
    "d2": 0.4,
}
FREQUENCIES: Final = ("=w1", "=w2", 300.0, 380.0, 470.0, 560.0, 660.0, 770.0)
DAMPINGS: Final = ("=d1", "=d2", 0.4, 0.5, 0.5, 0.6, 0.6, 0.7)


def document(sections: int = len(FREQUENCIES)) -> System:
    """Return the loop with two to eight oscillating sections: 4 + 2 ``sections`` states."""
    blocks = {
        "reference": Block(kind="input"),
        "error": Block(kind="sum", values={"signs": "+-"}),
        "controller": Block(kind="pid", values={"kp": "=kp", "ki": "=ki", "kd": "=kd", "filter_frequency": 2000.0}),
        "amplifier": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": ["=lag", 1.0]}),
        "drive": Block(kind="integrator"),
    }
    chain = ["error", "controller", "amplifier"]
    for number in range(sections):
        w, d = (str(value).lstrip("=") for value in (FREQUENCIES[number], DAMPINGS[number]))
        values = {"numerator": [f"={w}**2"], "denominator": [1.0, f"=2*{d}*{w}", f"={w}**2"]}
        blocks[f"section{number + 1}"] = Block(kind="transfer_function", values=values)
        chain.append(f"section{number + 1}")
    chain.append("drive")
    wires = [("reference", "error.in1"), ("drive", "error.in2"), *pairwise(chain)]
    return System(
        name=f"position loop with {4 + 2 * sections} states",
        parameters={name: Parameter(value=value) for name, value in PARAMETERS.items()},
        blocks=blocks,
        connections=tuple(Connection(source=source, target=target) for source, target in wires),
        outputs={"position": "drive"},
    )


def diagram() -> Diagram:
    """Return the checked loop with all its states."""
    return compile_system(document())


def requests() -> list[MetricRequest]:
    """Return six metrics: of a unit step, of the loop cut at the error, and of the closed path."""
    step = {"reference": make("step", {})}
    return [
        *(
            MetricRequest(metric=m, signals=step, output="position")
            for m in ("rise_time", "settling_time", "overshoot")
        ),
        *(MetricRequest(metric=metric, open_at="error") for metric in ("gain_margin", "phase_margin")),
        MetricRequest(metric="bandwidth", source="reference", target="position"),
    ]
