"""The nonlinear loop: many candidates with equal steps, what accuracy costs, and a new structure until its first curve."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from itertools import cycle
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from bench import nonlinear_loop as loop
from bench.clock import cpu_ms, side_by_side, wall_ms
from bench.table import Job, Row
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.march import Marcher, Pieces, by_input
from engine.batch.nonlinear.program import Compiled
from engine.signals import make

Real = npt.NDArray[np.float64]
Solution = Callable[[Real], Real]

THREADS = 2
REQUIRED = 1e-5
"""Largest error of the position over its size at which contenders are compared."""
CHECKED = 6
_LANES = 64
_BATCH = 256
"""Candidates of which one's share is measured."""
_TIGHT = 1e-6
"""Tolerance of the contenders that are only mentioned."""
_PEER = f"scipy {version('scipy')}"


class Ours:
    """The loop as a diagram of this engine, its candidates marched with equal steps."""

    def __init__(self, *, generate: bool) -> None:
        self._diagram = loop.diagram()
        self._compiled = Compiled(Equations.of(self._diagram, list(loop.PARAMETERS)), [0])
        self._marcher = Marcher(self._compiled, generate=generate).prepared()

    def march(self, candidates: Real, steps: int, *, threads: int = 1) -> Real:
        """Return the position (samples, candidates) at no more instants than the peer is asked for."""
        pieces = _pieces(self._diagram.inputs, steps)
        start, once, *_ = self._compiled.start(candidates)

        def part(first: int) -> Real:
            own = slice(first, first + _LANES)
            return self._marcher(start[:, own], once[:, own], pieces).values[0]

        parts = range(0, len(candidates), _LANES)
        if threads == 1:
            return np.concatenate([part(first) for first in parts], axis=1)
        with ThreadPoolExecutor(threads) as pool:
            return np.concatenate(list(pool.map(part, parts)), axis=1)


def jobs(*, runs: int, candidates: int) -> Iterator[Job]:
    """Measure all three."""
    ways = {
        "generated code": Ours(generate=True),
        "tapes, interpreted": Ours(generate=False),
    }
    yield _many(ways, runs, candidates)
    yield _at_accuracy(ways, runs)
    yield new_structure(runs=runs)


def _many(ways: dict[str, Ours], runs: int, candidates: int) -> Job:
    """Measure equal steps for all candidates, on two threads."""
    sample = loop.sample(candidates, seed=1)
    rows = []
    for who, ours in ways.items():
        ours.march(sample[:_LANES], 8, threads=THREADS)
        work = partial(ours.march, sample, loop.STEPS, threads=THREADS)
        remark = f"{THREADS} threads, {wall_ms(work, runs=runs):.0f} ms on the wall clock"
        rows.append(Row(who=f"this engine, {who}", milliseconds=cpu_ms(work, runs=runs), remark=remark))
    single = cpu_ms(lambda: integrated(sample[0], "LSODA", 1e-6), runs=runs)
    rows.append(Row(who=f"{_PEER}, LSODA", milliseconds=candidates * single, remark="candidates times the time of one"))
    title = f"nonlinear loop, {candidates:,} candidates x {loop.STEPS:,} steps of Runge and Kutta"
    return Job(title=title, rows=rows)


def _at_accuracy(ways: dict[str, Ours], runs: int) -> Job:
    """Measure one candidate's share at an error of at most 1e-5, everybody at the cheapest setting that reaches it."""
    sample = loop.sample(_BATCH, seed=1)
    truth = [solution(candidate, "DOP853", 1e-12) for candidate in sample[:CHECKED]]
    steps, error = _enough(next(iter(ways.values())), sample, truth)
    tolerance, theirs = _loosest("LSODA", sample, truth)
    turns = cycle(sample[:CHECKED])
    peer, works = f"{_PEER}, LSODA", {who: partial(ours.march, sample, steps) for who, ours in ways.items()}
    times = side_by_side({peer: lambda: integrated(next(turns), "LSODA", tolerance), **works}, rounds=runs)
    rows = []
    for who in ways:
        shares = [t / _BATCH for t in times[who]]
        ratios = sorted(t / share for t, share in zip(times[peer], shares, strict=True))
        remark = (
            f"{steps:,} steps; LSODA takes {median(ratios):.0f}x, {ratios[0]:.0f} to {ratios[-1]:.0f} in {runs} rounds"
        )
        rows.append(Row(who=f"this engine, {who}", milliseconds=median(shares), error=error, remark=remark))
    remark = f"rtol {tolerance:.1g}, equations by hand"
    rows.append(Row(who=peer, milliseconds=median(times[peer]), error=theirs, remark=remark))
    for method in ("Radau", "RK45"):
        found = np.stack([integrated(candidate, method, _TIGHT) for candidate in sample[:CHECKED]], axis=1)
        milliseconds = cpu_ms(lambda m=method: integrated(sample[0], m, _TIGHT), runs=max(1, runs // 5))
        remark = f"rtol {_TIGHT:g}, equations by hand"
        rows.append(Row(who=f"{_PEER}, {method}", milliseconds=milliseconds, error=_error(found, truth), remark=remark))
    return Job(title=f"nonlinear loop, one candidate at an error <= {REQUIRED:g}", rows=rows)


def _loosest(method: str, sample: Real, truth: Sequence[Solution]) -> tuple[float, float]:
    """Return the tolerance with which a peer is accurate enough on the candidates checked, in quarters of a decade, and its error."""
    for quarters in range(18, 32):
        tolerance = 10.0 ** (-quarters / 4)
        found = np.stack([integrated(candidate, method, tolerance) for candidate in sample[:CHECKED]], axis=1)
        error = _error(found, truth)
        if error <= REQUIRED:
            return tolerance, error
    raise RuntimeError(f"error must be <= {REQUIRED:g} with the tightest tolerance, got {error:g}")


def new_structure(*, runs: int) -> Job:
    """Measure a document that has never been seen until its first curve."""

    def first_curve() -> Real:
        diagram = loop.diagram()
        compiled = Compiled(Equations.of(diagram, ()), [0])
        start, once, *_ = compiled.start(np.zeros((1, 0)))
        marcher = Marcher(compiled, generate=False)
        return marcher(start, once, _pieces(diagram.inputs, loop.STEPS)).values

    remark = f"{wall_ms(first_curve, runs=runs):.0f} ms on the wall clock"
    row = Row(who="this engine, tapes, interpreted", milliseconds=cpu_ms(first_curve, runs=runs), remark=remark)
    return Job(title="nonlinear loop, new structure to first curve", rows=[row])


def _pieces(inputs: tuple[str, ...], steps: int) -> Pieces:
    step = make("step", {"amplitude": loop.STEP})
    fewest = max(k for k in range(1, loop.STEPS + 1) if steps % k == 0 and (steps // k).bit_count() == 1)
    return Pieces.of(
        by_input(inputs, {"reference": step}),
        loop.DURATION,
        fewest,
        (steps // fewest).bit_length() - 1,
        most=loop.STEPS,
    )


def _enough(ours: Ours, sample: Real, truth: Sequence[Solution]) -> tuple[int, float]:
    """Return how many steps are enough for the candidates checked, in eighths of powers of two, and their error."""
    for steps in (125 * eighths << power for power in range(1, 10) for eighths in range(8, 16)):
        error = _error(ours.march(sample[:CHECKED], steps), truth)
        if error <= REQUIRED:
            return steps, error
    raise RuntimeError(f"error must be <= {REQUIRED:g} with the most steps, got {error:g}")


def _error(found: Real, truth: Sequence[Solution]) -> float:
    """Return the largest error at the instants of (samples, candidates), relative to the step."""
    times = np.linspace(0.0, loop.DURATION, len(found))
    exact = np.stack([solution(times)[loop.POSITION] for solution in truth], axis=1)
    return float(np.abs(found - exact).max()) / loop.STEP


def integrated(candidate: Real, method: str, tolerance: float) -> Real:
    """Return the position (STEPS + 1,) by scipy."""
    times = np.linspace(0.0, loop.DURATION, loop.STEPS + 1)
    return np.asarray(_solved(candidate, method, tolerance, t_eval=times).y[loop.POSITION])


def solution(candidate: Real, method: str, tolerance: float) -> Solution:
    """Return all states as a function of time, by scipy."""
    found: Solution = _solved(candidate, method, tolerance, dense_output=True).sol
    return found


def _solved(candidate: Real, method: str, tolerance: float, **options: Any) -> Any:
    call: Callable[..., Any] = solve_ivp
    return call(
        loop.rates, (0.0, loop.DURATION), np.zeros(10), method=method, args=tuple(candidate.tolist()), rtol=tolerance,
        atol=tolerance * 1e-3, **options,
    )  # fmt: skip
