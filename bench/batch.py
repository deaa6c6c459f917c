"""The inner velocity loop: one candidate, and a batch of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np
import numpy.typing as npt

from bench import batched_numpy
from bench import inner_velocity_loop as inner
from bench.accuracy import worst
from bench.clock import cpu_ms
from bench.peers.python_control import Interconnected
from bench.table import Job, Row
from engine.measuring import measure
from engine.screening import Screening

Candidates = Mapping[str, npt.NDArray[np.float64]]
Results = dict[str, npt.NDArray[np.float64]]

CHECKED = 20
GRID = "by hand; grids of 1000 samples and 200 frequencies"
ONE_BY_ONE = "candidates times the median of one"


class Ours:
    """The loop as a diagram of this engine: the screening for many, the exact path for one."""

    def __init__(self) -> None:
        self._diagram = inner.diagram()
        self._requests = inner.requests()
        self._names = [request.metric for request in self._requests]
        self._screening = Screening(self._diagram, self._requests)
        self.nominal = {name: self._diagram.parameters[name].value for name in inner.PARAMETERS}

    def screen(self, candidates: Candidates) -> Results:
        """Return the ten results of many candidates."""
        found = self._screening(candidates)
        return {**dict(zip(self._names, found.values.T, strict=True)), "stable": np.asarray(found.growth < 0, float)}

    def exact(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the nine metrics of a stable candidate."""
        found = measure(self._diagram, self._requests, overrides=values)
        return {name: float(m.value) for name, (m, _) in zip(self._names, found, strict=True) if m.value is not None}


def jobs(*, runs: int, candidates: int) -> Iterator[Job]:
    """Measure one candidate, and ``candidates`` at once."""
    ours = Ours()
    try:
        control: Interconnected | None = Interconnected()
    except ModuleNotFoundError:
        control = None
    yield _one(ours, control, runs)
    yield _many(ours, control, runs, candidates)


def _one(ours: Ours, control: Interconnected | None, runs: int) -> Job:
    nominal = {name: np.array([value]) for name, value in ours.nominal.items()}
    ways: list[tuple[str, Callable[[], Mapping[str, float]], str]] = [
        ("this engine, screening", lambda: _first(ours.screen(nominal)), ""),
        ("this engine, exact path", lambda: ours.exact(ours.nominal), ""),
        ("batched numpy", lambda: _first(batched_numpy.evaluate(nominal)), GRID),
    ]
    if control is not None:
        peer = control
        ways.append((peer.name, lambda: peer.metrics(ours.nominal), peer.remark))
    rows = [
        Row(who=who, milliseconds=cpu_ms(work, runs=runs), error=worst(work(), inner.EXACT), remark=remark)
        for who, work, remark in ways
    ]
    return Job(title="inner velocity loop, one candidate, 10 results", rows=rows)


def _many(ours: Ours, control: Interconnected | None, runs: int, candidates: int) -> Job:
    sample = inner.sample(candidates, seed=3)
    checked = range(0, candidates, max(1, candidates // CHECKED))
    truth = {k: ours.exact({name: float(column[k]) for name, column in sample.items()}) for k in checked}
    rows = []
    for who, work, remark in (
        ("this engine, screening", ours.screen, "against our exact path"),
        ("batched numpy", batched_numpy.evaluate, GRID),
    ):
        milliseconds = cpu_ms(partial(work, sample), runs=max(1, runs // 3))
        found = work(sample)
        error = max(
            worst({name: float(column[k]) for name, column in found.items()}, exact) for k, exact in truth.items()
        )
        rows.append(Row(who=who, milliseconds=milliseconds, error=error, remark=remark))
    if control is not None:
        single = cpu_ms(lambda: control.metrics(ours.nominal), runs=runs)
        rows.append(Row(who=control.name, milliseconds=candidates * single, remark=ONE_BY_ONE))
    return Job(title=f"inner velocity loop, {candidates:,} candidates, 10 results", rows=rows)


def _first(found: Results) -> dict[str, float]:
    return {name: float(values[0]) for name, values in found.items()}
