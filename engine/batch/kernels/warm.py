"""Compile all kernels, or load what an earlier process compiled, before anybody waits for them.

``python -m engine.batch.kernels.warm`` does it for a machine: a minute the first time, about a second later on.
"""

from __future__ import annotations

from pathlib import Path

import numba
import numpy as np

from engine.analysis.measuring import MetricRequest
from engine.batch.kernels.batch import Batch
from engine.batch.linear.compiled import Mark
from engine.batch.nonlinear.batch import NonlinearBatch
from engine.diagram.diagram import Block, Connection, Diagram, System, compile_system
from engine.signals import make

MARK = Mark(Path(vars(numba.config)["CACHE_DIR"]))


def warm() -> None:
    """Evaluate one small loop, linear, with a limit and with play, which runs through every kernel."""
    requests = [
        MetricRequest(metric="rise_time", signals={"reference": make("step", {})}, output="position"),
        MetricRequest(metric="gain_margin", open_at="error"),
    ]
    Batch(_loop(Block(kind="gain", values={"gain": 1.0})), ["controller.gain"], requests).slopes(
        np.ones((1, 1)), np.ones((1, 1, 1))
    )
    for law in (Block(kind="saturation", values={}), Block(kind="backlash", values={"width": 0.1})):
        NonlinearBatch(_loop(law), ["controller.gain"], requests, generate=False)(np.array([[1.0]]))
    MARK.make()


def _loop(actuator: Block) -> Diagram:
    wires = (
        ("reference", "error.in1"), ("plant", "error.in2"), ("error", "controller"), ("controller", "actuator"),
        ("actuator", "plant"),
    )  # fmt: skip
    loop = System(
        name="loop",
        parameters={},
        blocks={
            "reference": Block(kind="input", values={}),
            "error": Block(kind="sum", values={"signs": "+-"}),
            "controller": Block(kind="gain", values={"gain": 2.0}),
            "actuator": actuator,
            "plant": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 3.0, 2.0, 0.0]}),
        },
        connections=tuple(Connection(source=source, target=target) for source, target in wires),
        outputs={"position": "plant"},
    )
    return compile_system(loop)


if __name__ == "__main__":
    warm()
