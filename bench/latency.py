"""How long a user waits for one answer about a loop of 20 states: metrics, a new structure, exact derivatives."""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from bench import twenty_states as loop
from bench.clock import cpu_ms
from bench.table import Job, Row
from engine.diagram import Diagram, compile_system
from engine.measuring import measure
from engine.screening import Screening

Array = npt.NDArray[Any]

AT = np.array(list(loop.PARAMETERS.values()))
ONE = {name: np.array([value]) for name, value in loop.PARAMETERS.items()}
STEP = 1e-30
LANES = {
    name: value * (1 + 1j * STEP * (np.arange(len(AT)) == k)) for k, (name, value) in enumerate(loop.PARAMETERS.items())
}
"""Lane k carries the infinitesimal of parameter k."""


def jobs(*, runs: int) -> list[Job]:
    """Return the rows of all latencies."""
    diagram = loop.diagram()
    screening = Screening(diagram, loop.requests())
    exact = measure(diagram, loop.requests())
    values = np.array([measured.value for measured, _ in exact], dtype=float)
    slopes = _exact_slopes(diagram)

    def jacobian() -> Array:
        return np.asarray(screening(LANES).values.imag.T / STEP)

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
        Job(
            title="derivatives of 6 metrics in 8 parameters, 20 states",
            rows=[
                Row(
                    who="this engine, screening",
                    milliseconds=cpu_ms(jacobian, runs=10 * runs),
                    error=float(np.abs(jacobian() - slopes).max(axis=1).max() / np.abs(slopes).max()),
                    remark="against the exact path, of the largest",
                ),
                Row(who="this engine, exact path", milliseconds=cpu_ms(lambda: _exact_slopes(diagram), runs=runs)),
            ],
        ),
        Job(
            title="new structure to first metrics, warm process",
            clock="wall",
            rows=[Row(who="this engine, screening", milliseconds=_new_structures())],
        ),
    ]


def _exact_slopes(diagram: Diagram) -> Array:
    """Return d metric/d ln parameter of the exact path, (metrics, parameters)."""
    found = measure(diagram, loop.requests(), gradient=list(loop.PARAMETERS))
    slopes = [gradient.values for _, gradient in found if gradient is not None]
    return np.asarray(np.array(slopes) * AT)


def _new_structures() -> float:
    """Return the median milliseconds from a document to metrics, every document with a structure of its own."""
    times = []
    for sections in range(2, 8):
        begin = time.perf_counter()
        Screening(compile_system(loop.document(sections)), loop.requests())(ONE)
        times.append(time.perf_counter() - begin)
    return 1e3 * statistics.median(times)
