"""Compile what follows loops with samplers, or load what an earlier process compiled: ``python -m engine.batch.sampled_data.warm``."""

from __future__ import annotations

import numpy as np

from engine.analysis.measuring import MetricRequest
from engine.batch.linear.compiled import Mark
from engine.batch.sampled_data.batch import SampledBatch
from engine.batch.sampled_data.compiled import HOME
from engine.diagram.diagram import Block, Connection, System, compile_system
from engine.signals import make

MARK = Mark(HOME)


def warm() -> None:
    """Follow one lag behind a hold, with numbers and with infinitesimals: that runs through everything that is compiled."""
    lag = compile_system(
        System(
            name="lag",
            parameters={},
            blocks={
                "reference": Block(kind="input", values={}),
                "hold": Block(kind="zero_order_hold", values={"sample_time": 0.1}),
                "lag": Block(kind="transfer_function", values={"numerator": [1.0], "denominator": [1.0, 1.0]}),
                "gain": Block(kind="gain", values={"gain": 2.0}),
            },
            connections=tuple(
                Connection(source=source, target=target)
                for source, target in (("reference", "gain"), ("gain", "hold"), ("hold", "lag"))
            ),
            outputs={"position": "lag"},
        )
    )
    request = MetricRequest(metric="iae", signals={"reference": make("step", {})}, output="position", duration=1.0)
    batch = SampledBatch(lag, [request], threads=1)
    for gain in (1.0, 1.0 + 1e-30j):
        batch({"gain.gain": np.array([gain])})
    MARK.make()


if __name__ == "__main__":
    warm()
