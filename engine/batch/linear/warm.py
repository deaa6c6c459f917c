"""Compile what evaluates responses, or load what an earlier process compiled: ``python -m engine.batch.linear.warm``."""

from __future__ import annotations

import numpy as np

from engine.analysis.measuring import MetricRequest
from engine.batch.linear.compiled import HOME, Mark
from engine.batch.linear.responses import Responses
from engine.diagram.diagram import Block, Connection, System, compile_system
from engine.signals import make

MARK = Mark(HOME)


def warm() -> None:
    """Follow one lag, with numbers and with infinitesimals: that runs through everything that is compiled."""
    lag = compile_system(
        System(
            name="lag",
            parameters={},
            blocks={
                "reference": Block(kind="input", values={}),
                "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 1.0]}),
                "gain": Block(kind="gain", values={"gain": 2.0}),
            },
            connections=(Connection(source="reference", target="gain"), Connection(source="gain", target="lag")),
            outputs={"position": "lag"},
        )
    )
    request = MetricRequest(metric="iae", signals={"reference": make("step", {})}, output="position", duration=1.0)
    responses = Responses(lag, [request], ["gain.gain"], threads=1)
    for gain in (1.0, 1.0 + 1e-30j):
        responses({"gain.gain": np.array([gain])})
    MARK.make()


if __name__ == "__main__":
    warm()
