"""The inner velocity loop: one candidate, and a batch of them.

`python -m bench.batch --candidates 4096` prints how long batched numpy and this engine take, round by round, as one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from statistics import median

import numpy as np
import numpy.typing as npt

from bench import batched_numpy
from bench import inner_velocity_loop as inner
from bench.accuracy import worst
from bench.clock import cpu_ms, in_rounds, side_by_side
from bench.peers.python_control import Interconnected
from bench.table import Job, Row
from engine.analysis.measuring import measure
from engine.batch.screening import Screening

Candidates = Mapping[str, npt.NDArray[np.float64]]
Results = dict[str, npt.NDArray[np.float64]]

CHECKED = 20
GRID = "by hand; grids of 1000 samples and 200 frequencies"
ONE_BY_ONE = "candidates times the median of one"
OURS, NUMPY = "this engine, screening", "batched numpy"
KEPT = "MALLOC_"
"""Variables by which `make bench` lets the C library keep memory between calls: what batched numpy gains by most."""


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
    works = contenders(ours, sample)
    one = {} if control is None else {control.name: partial(control.metrics, ours.nominal)}
    times = side_by_side({**works, **one}, rounds=max(1, runs // 3))
    rows = []
    for who, remark in ((OURS, "against our exact path"), (NUMPY, f"{GRID}; {in_rounds(times[NUMPY], times[OURS])}")):
        found = works[who]()
        error = max(
            worst({name: float(column[k]) for name, column in found.items()}, exact) for k, exact in truth.items()
        )
        rows.append(Row(who=who, milliseconds=median(times[who]), error=error, remark=remark))
    plain = without_kept_memory(candidates, max(1, runs // 3))
    remark = f"where memory goes back to the system between calls, as it does unasked; {in_rounds(plain[NUMPY], plain[OURS])}"
    rows.append(Row(who=NUMPY, milliseconds=median(plain[NUMPY]), remark=remark))
    for name in one:
        remark = f"{ONE_BY_ONE}; {in_rounds(times[name], times[OURS], calls=candidates)}"
        rows.append(Row(who=name, milliseconds=candidates * median(times[name]), remark=remark))
    return Job(title=f"inner velocity loop, {candidates:,} candidates, 10 results", rows=rows)


def contenders(ours: Ours, sample: Candidates) -> dict[str, Callable[[], Results]]:
    """Return the two ways of the batch, ready to be called."""
    return {OURS: partial(ours.screen, sample), NUMPY: partial(batched_numpy.evaluate, sample)}


def without_kept_memory(candidates: int, rounds: int) -> dict[str, list[float]]:
    """Return the CPU milliseconds of both ways in a process whose C library handles memory as it does unasked."""
    command = [sys.executable, "-m", "bench.batch", "--candidates", str(candidates), "--rounds", str(rounds)]
    plain = {name: value for name, value in os.environ.items() if not name.startswith(KEPT)}
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=plain)  # noqa: S603  our own module
    return dict(json.loads(done.stdout))


def _first(found: Results) -> dict[str, float]:
    return {name: float(values[0]) for name, values in found.items()}


def main() -> None:
    """Measure both ways side by side and print what each round took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--candidates", type=int, default=4096)
    parser.add_argument("--rounds", type=int, default=15)
    options = parser.parse_args()
    print(json.dumps(side_by_side(contenders(Ours(), inner.sample(options.candidates, seed=3)), rounds=options.rounds)))


if __name__ == "__main__":
    main()
