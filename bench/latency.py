"""How long a user waits for one answer about a loop of 8 or 20 states: metrics, a new structure, exact derivatives."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from bench import inner_velocity_loop as inner
from bench import twenty_states as loop
from bench.clock import cpu_ms
from bench.table import Job, Row
from engine.analysis.measuring import MetricRequest, measure
from engine.batch.screening import Screening
from engine.diagram.diagram import Diagram, compile_system

Array = npt.NDArray[Any]

AT = np.array(list(loop.PARAMETERS.values()))
ONE = {name: np.array([value]) for name, value in loop.PARAMETERS.items()}


def jobs(*, runs: int) -> list[Job]:
    """Return the rows of all latencies."""
    diagram = loop.diagram()
    screening = Screening(diagram, loop.requests())
    exact = measure(diagram, loop.requests())
    values = np.array([measured.value for measured, _ in exact], dtype=float)
    return [
        Job(
            title="one candidate, 20 states, 6 metrics",
            rows=[
                Row(
                    who="this engine, screening",
                    milliseconds=cpu_ms(lambda: screening(ONE), runs=10 * runs),
                    error=float(np.abs(screening(ONE).values[0] / values - 1).max()),
                    remark="against the exact path",
                ),
                Row(
                    who="this engine, exact path",
                    milliseconds=cpu_ms(
                        lambda: measure(diagram, loop.requests(), overrides=loop.PARAMETERS), runs=runs
                    ),
                ),
            ],
        ),
        _derivatives(
            "derivatives of 9 metrics in 8 parameters, 8 states",
            inner.with_eight_parameters(),
            inner.requests(),
            inner.EIGHT,
            runs,
        ),
        _derivatives(
            "derivatives of 6 metrics in 8 parameters, 20 states", diagram, loop.requests(), loop.PARAMETERS, runs
        ),
        Job(
            title="new structure to first metrics, warm process",
            clock="wall",
            rows=[Row(who="this engine, screening", milliseconds=_new_structures())],
        ),
    ]


def _derivatives(title: str, diagram: Diagram, requests: list[MetricRequest], names: Iterable[str], runs: int) -> Job:
    """Return the rows of all derivatives of one loop by the logarithms of its parameters."""
    at = {name: diagram.parameters[name].value for name in names}
    overrides = {name: np.array([value]) for name, value in at.items()}
    eye = np.eye(len(at))
    directions = {name: (value * eye[k])[None] for k, (name, value) in enumerate(at.items())}
    screening = Screening(diagram, requests)

    def exactly() -> Array:
        found = measure(diagram, requests, gradient=list(at))
        rows = [np.zeros(len(at)) if gradient is None else gradient.values for _, gradient in found]
        return np.asarray(np.array(rows) * list(at.values()))

    def compiled() -> Array:
        found = screening.slopes(overrides, directions)
        assert found is not None, "the kernels cover this loop"
        return found.slopes[0]

    expected = exactly()
    # what does not depend on a parameter has rounding for a slope: of a command of size one
    scale = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1e-3)
    return Job(
        title=title,
        rows=[
            Row(
                who="this engine, compiled",
                milliseconds=cpu_ms(compiled, runs=10 * runs),
                error=float((np.abs(compiled() - expected) / scale).max()),
                remark="against the exact path, of the largest of each metric",
            ),
            Row(who="this engine, exact path", milliseconds=cpu_ms(exactly, runs=runs)),
        ],
    )


def _new_structures() -> float:
    """Return the median milliseconds from a document to metrics, every document with a structure of its own.

    Expressions that it shares with a document before it are not read again, as on a warm server.
    """
    times = []
    for sections in range(2, 8):
        begin = time.perf_counter()
        Screening(compile_system(loop.document(sections)), loop.requests())(ONE)
        times.append(time.perf_counter() - begin)
    return 1e3 * statistics.median(times)
