"""Compile what evaluates responses, or load what an earlier process compiled: ``python -m engine.batch.linear.warm``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import llvmlite.binding
import numba
import numpy as np

from engine.analysis.measuring import MetricRequest
from engine.batch.linear.compiled import HOME
from engine.batch.linear.responses import Responses
from engine.diagram.diagram import Block, Connection, System, compile_system
from engine.signals import make


def compiled_before() -> bool:
    """Return whether a process of this machine has compiled all of it as it is now, so that `warm` takes about a second."""
    return _mark().is_file()


def _mark() -> Path:
    """Return the file that says so, in the folder of the sources' content: for a version of the compiler and a processor."""
    return HOME / f"compiled-{numba.__version__}-{llvmlite.binding.get_host_cpu_name()}"


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
    with suppress(OSError):  # nothing can be kept there: every process compiles its own
        _mark().touch()


if __name__ == "__main__":
    warm()
