"""Metrics of many parameter sets of a nonlinear diagram: marched with steps of one length, halved until nothing changes.

    doubtful unless  |y_h - y_2h| <= 1e-5 max|y|  at all samples  and  |m_h - m_2h| <= 1e-4 |m|  for every metric m

A limit that is reached makes the method one of second order, a law that switches by the instant alone one of first order; the difference of
two marches shows the error of the finer one in all these cases. What stays doubtful belongs to the exact path.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.analysis.evaluation import Evaluation
from engine.batch.nonlinear.curves import Curves, middle_of
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.look import Look, coarse, floor
from engine.batch.nonlinear.march import Marched, Marcher, Pieces, by_input
from engine.batch.nonlinear.program import Compiled
from engine.batch.nonlinear.readings import INTEGRALS, METRICS, read
from engine.batch.nonlinear.rest import Moving, Rest, reaching
from engine.batch.screened import Screened
from engine.model.traced import UnsuitableError

if TYPE_CHECKING:
    from engine.analysis.measuring import MetricRequest
    from engine.diagram.diagram import Diagram
    from engine.signals import Signal

Real = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

FEWEST: Final = 256
"""Steps of the coarsest march,"""
MOST_DOUBLINGS: Final = 10
"""which are halved so often in the finest;"""
_FOUND: Final = 6
"""where modes end between samples, so often from the first on: what has not agreed by then will not."""
_EXTENSIONS: Final = 6
"""A response of free length that has not settled is followed twice as long, so many times: not beyond the exact path."""
_LIFETIME: Final = 0.4
"""Part of the lifetime of the linearised system, in which e^-36 is left, that a response is followed for at first."""
_STABLE: Final = 1.5
"""Steps times the largest pole at first, delays left out; the method is stable up to 2.8."""
MARCHED: Final = 64
_WORDS: Final = 1 << 21
"""Numbers that a record may have at most."""
_KEPT: Final = 1 << 13
"""Steps of pieces that are kept,"""
_MOST_KEPT: Final = 32
"""and how many of them."""
_NEAR_SINGULAR: Final = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """Commands, a limit of time, and the requests (by number) that are read off the same curves."""

    signals: Mapping[str, Signal]
    duration: float | None
    requests: tuple[int, ...]

    @property
    def last(self) -> float:
        """When the commands change for the last time, s."""
        return max((t for s in self.signals.values() for t in (*s.breakpoints(), s.end() or 0.0)), default=0.0)

    @property
    def begin(self) -> float:
        """When the first of them begins, s."""
        return min((t for s in self.signals.values() for t in s.breakpoints()), default=0.0)

    @property
    def constant(self) -> bool:
        """Whether they all settle."""
        return all(signal.final() is not None for signal in self.signals.values())


class NonlinearBatch:
    """The evaluator of some metrics of a nonlinear diagram.

    Parameters
    ----------
    diagram : Diagram
    varied : sequence of str
        Parameter paths, in the order of the columns of `__call__`.
    requests : sequence of MetricRequest
    generate : bool
        Whether code is generated beside the work; otherwise the tapes are interpreted for ever.

    Attributes
    ----------
    measured : tuple of bool
        Which requests it answers; the others stay NaN and doubtful.

    Raises
    ------
    UnsuitableError
        If the diagram has delays that vary or no states, or a law that cannot be written as formulas; or if it answers none of the requests.
    """

    def __init__(
        self, diagram: Diagram, varied: Sequence[str], requests: Sequence[MetricRequest], *, generate: bool = True
    ) -> None:
        self.requests = tuple(requests)
        self._diagram = diagram
        self._experiments = _experiments(diagram, requests)
        asked = {number for experiment in self._experiments for number in experiment.requests}
        self.measured = tuple(number in asked for number in range(len(self.requests)))
        if not asked:
            raise UnsuitableError("no metric of a response in time")
        self._outputs = list(dict.fromkeys(diagram.outputs.index(str(self.requests[k].output)) for k in sorted(asked)))
        self._equations = Equations.of(diagram, varied)
        if not self._equations.states:
            raise UnsuitableError("no states")
        self._reaching = {output: reaching(self._equations, output) for output in self._outputs}
        self._compiled = Compiled(self._equations, self._outputs)
        self.marcher = Marcher(self._compiled, generate=generate)
        linear = Evaluation(diagram)
        # what comes back through a delay does so a step later at the soonest, and says nothing about steps
        own = np.linalg.eigvals(linear.system.a[0].real)
        self._fastest = float(np.abs(own).max(initial=0.0))
        lifetime = linear.pace.lifetime
        self._pace = _LIFETIME * lifetime if 0 < lifetime < np.inf else 1.0
        self._moving = Moving(self._equations)
        self._writing = threading.Lock()
        self._searched: Rest | None = None
        self._kept: dict[tuple[int, float, int], Pieces] = {}

    def __call__(self, points: Real, *, threads: int | None = None) -> Screened:
        """Return the metrics of candidates.

        Parameters
        ----------
        points : ndarray, shape (B, varied)
            Parameter values, SI.
        threads : int, optional
            As many as the machine has processors for this process by default.
        """
        points = np.ascontiguousarray(points, dtype=float)
        total = len(points)
        start, once, bounded, pivots = self._compiled.start(points)
        valid = np.asarray(np.isfinite(start).all(axis=0) & np.isfinite(bounded).all(axis=0))
        for (param, _), value in zip(self._equations.bounds, bounded, strict=True):
            valid = np.asarray(valid & param.admits(value))
        nominal = np.array([abs(float(pivot.real)) for pivot in self._equations.pivots])
        posed = (np.abs(pivots) > _NEAR_SINGULAR * nominal[:, None]).all(axis=0)
        values = np.full((total, len(self.requests)), np.nan)
        doubtful = np.ones((total, len(self.requests)), dtype=bool)
        found = _Found(values=values, doubtful=doubtful)
        # minus infinity is the guard of a mode that never ends
        rows = np.flatnonzero(valid & posed & (np.isfinite(once) | np.isneginf(once)).all(axis=0))
        given = _Given(points=points, start=start, once=once)
        # By their places among all, so that a candidate has the same neighbours however many do not exist.
        blocks = np.split(rows, np.flatnonzero(np.diff(rows // MARCHED)) + 1) if rows.size else []
        jobs = [(experiment, block) for experiment in range(len(self._experiments)) for block in blocks]
        workers = min(threads or len(os.sched_getaffinity(0)), len(jobs))
        if workers <= 1:
            for job in jobs:
                self._follow(*job, given, found)
        else:
            with ThreadPoolExecutor(workers) as pool:
                pending = [pool.submit(self._follow, *job, given, found) for job in jobs]
                for done in pending:
                    done.result()
        doubtful[~valid] = False
        values[doubtful] = np.nan
        return Screened(values=values, doubtful=doubtful, growth=np.full(total, np.nan), valid=valid)

    def _before(self, given: _Given) -> Real:
        """Return the watched outputs of the initial states with all inputs 0, (watched, B)."""
        moment = Pieces.moment(len(self._diagram.inputs), len(self._equations.delays))
        return self.marcher(given.start, given.once, moment).values[:, 0]

    def _follow(self, number: int, rows: Any, given: _Given, found: _Found) -> None:
        """March some candidates until every metric is known, or cannot be."""
        experiment = self._experiments[number]
        last = experiment.last
        length = experiment.duration if experiment.duration is not None else last + max(self._pace, 1e-9)
        for extension in range(1 if experiment.duration is not None else _EXTENSIONS + 1):
            end = length if experiment.duration is not None else last + (length - last) * 2**extension
            extendable = experiment.duration is None and extension < _EXTENSIONS
            rows = self._halve(number, end, given, rows, found, extendable=extendable)
            if not rows.size:
                break

    def _halve(self, number: int, end: float, given: _Given, rows: Any, found: _Found, *, extendable: bool) -> Any:
        """March with ever smaller steps, at first always the same, so that a number depends on no candidates before; return who has to be followed for longer."""
        experiment = self._experiments[number]
        columns = list(experiment.requests)
        delays, doublings, unsettled = self._equations.delays, self._first(end), []
        if end > min(delays, default=np.inf) * (FEWEST << doublings):
            return rows[:0]
        before: Look | None = None
        most = min(MOST_DOUBLINGS, doublings + _FOUND) if self._equations.changes.modes else MOST_DOUBLINGS
        while rows.size and doublings <= most:
            pieces = self._pieces(number, end, doublings)
            looks = []
            words = pieces.words * (2 * len(self._outputs) + 1) + 2 * pieces.slots * len(delays)
            widest = max(16, _WORDS // words)
            for first in range(0, len(rows), widest):
                part = given.of(rows[first : first + widest])
                marched = self.marcher(part.start, part.once, pieces)
                looks.append(self._look(experiment, pieces, marched, part))
            look = Look.joined(looks)
            if extendable:  # what goes on moving is marched for longer anyway
                moving = ~look.settled & np.isfinite(look.curves[:, -1]).all(axis=0)
                # the exact path takes what moves steadily after a lifetime for an integrator: it has to decide
                late = end - experiment.last >= (1 - 1e-9) * 2 * self._pace
                unsettled.append(rows[moving & ~(look.steady & late)])
                rows, look = rows[~moving], look.take(~moving)
                before = None if before is None else before.take(~moving)
            if before is not None and rows.size:
                agreed = look.agrees(before)
                done = rows[agreed]
                found.values[np.ix_(done, columns)] = look.values[agreed]
                found.doubtful[np.ix_(done, columns)] = look.doubtful[agreed]
                left = ~agreed & (look.covered | before.covered)  # who is lost twice will not be found
                rows, look = rows[left], look.take(left)
            before, doublings = look, doublings + 1
        return np.concatenate(unsettled) if unsettled else rows[:0]

    def _pieces(self, number: int, end: float, doublings: int) -> Pieces:
        """Return the steps of an experiment, kept for the next candidates where they are few."""
        key = number, end, doublings
        found = self._kept.get(key)
        if found is None:
            signals = by_input(self._diagram.inputs, self._experiments[number].signals)
            found = Pieces.of(signals, end, FEWEST, doublings, delays=self._equations.delays, graded=True)
            if found.slots <= _KEPT and len(self._kept) < _MOST_KEPT:
                self._kept[key] = found
        return found

    def _first(self, end: float) -> int:
        """Return how often the steps of the first march are halved."""
        wanted = end * max(self._fastest / _STABLE, 1 / min(self._equations.delays, default=np.inf)) / FEWEST
        return int(np.clip(np.ceil(np.log2(max(wanted, 1.0))), 0, MOST_DOUBLINGS - 2))

    def _look(self, experiment: Experiment, pieces: Pieces, marched: Marched, given: _Given) -> Look:
        """Read the metrics of an experiment off the curves."""
        batch, initial = len(marched.covered), self._before(given)
        values, doubtful = (
            np.full((batch, len(experiment.requests)), np.nan),
            np.ones((batch, len(experiment.requests)), bool),
        )
        floors = np.zeros_like(values)
        settled, steady = np.ones(batch, dtype=bool), np.zeros(batch, dtype=bool)
        with np.errstate(all="ignore"):
            curves = {
                output: self._curves(experiment, pieces, marched, k, initial[k])
                for k, output in enumerate(self._outputs)
            }
            curves = self._rested(experiment, marched, given, curves)
            for column, number in enumerate(experiment.requests):
                request = self.requests[number]
                own = curves[self._diagram.outputs.index(str(request.output))]
                values[:, column], doubtful[:, column] = read(
                    request.metric, own, request.options.settling_band, unsettled=request.unsettled
                )
                floors[:, column] = floor(request.metric, own)
                integral = request.metric in INTEGRALS and experiment.duration is None
                settled &= own.still & own.dies_away if integral else own.settled
                steady |= own.steady
        doubtful[~marched.covered] = True
        return Look(
            curves=marched.values, coarse=coarse(pieces), values=values, doubtful=doubtful, settled=settled, steady=steady, covered=marched.covered,
            floors=floors, finest=pieces.stride > 1,
        )  # fmt: skip

    def _rest(self) -> Rest:
        """Return the search for rest, written into the graph when it is needed for the first time."""
        with self._writing:
            if self._searched is None:
                self._searched = Rest(self._equations, self._outputs)
        return self._searched

    def _rested(
        self, experiment: Experiment, marched: Marched, given: _Given, curves: dict[int, Curves]
    ) -> dict[int, Curves]:
        """Return the curves with the rest of those that may have come near to it."""
        finals = [
            0.0 if signal is None else signal.final() for signal in by_input(self._diagram.inputs, experiment.signals)
        ]
        constants = [float(final) for final in finals if final is not None]
        if len(constants) < len(finals):
            return curves
        ends = np.concatenate([marched.states, marched.heard])
        moves = self._moving(given.points, ends, marched.modes, constants, float(marched.times[-1]))
        curves = {
            output: replace(own, moving=np.asarray(moves[self._reaching[output]].any(axis=0)))
            for output, own in curves.items()
        }
        unclear = np.any([~own.still & ~own.restless for own in curves.values()], axis=0)
        unclear &= marched.covered & np.all([own.slow for own in curves.values()], axis=0)
        rows = np.flatnonzero(unclear)
        if not rows.size:
            return curves
        found = self._rest()(given.points[rows], ends[:, rows], marched.modes[:, rows], constants)
        single = np.zeros(len(unclear), dtype=bool)
        single[rows] = found.single
        rests = np.full((len(curves), len(unclear)), np.nan)
        rests[:, rows] = found.outputs
        return {output: replace(own, rest=rests[k], single=single) for k, (output, own) in enumerate(curves.items())}

    def _curves(self, experiment: Experiment, pieces: Pieces, marched: Marched, k: int, initial: Real) -> Curves:
        reference = self._diagram.references.input_of(experiment.signals, self._diagram.outputs[self._outputs[k]])
        y = marched.values[k]
        curves = Curves(
            times=marched.times, values=y, slopes=marched.slopes[k], errors=np.empty((0, 2, 0)), start=experiment.begin,
            last=experiment.last, initial=initial, constant=experiment.constant,
            target=None if reference is None else experiment.signals[reference].final(), duration=experiment.duration,
            corners=None if marched.corners is None else marched.corners.of(k), echoes=sum(self._equations.delays),
        )  # fmt: skip
        if not any(self.requests[number].metric in INTEGRALS for number in experiment.requests):
            return curves
        command = np.zeros((len(y), 2))
        if reference is not None:
            command = pieces.commands[:, :, self._diagram.inputs.index(reference)]
        return replace(curves, errors=command[:, :, None] - np.stack([y, middle_of(curves)], axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """Where the metrics and doubts of all candidates come, (B, R)."""

    values: Real
    doubtful: Flags


@dataclass(frozen=True, kw_only=True, eq=False)
class _Given:
    """What the candidates begin with, the last axis being theirs."""

    points: Real
    start: Real
    once: Real

    def of(self, rows: Any) -> _Given:
        return _Given(points=self.points[rows], start=self.start[:, rows], once=self.once[:, rows])


def _experiments(diagram: Diagram, requests: Sequence[MetricRequest]) -> list[Experiment]:
    """Return the experiments of the requests that can be read off curves."""
    found: dict[tuple[Any, ...], tuple[MetricRequest, list[int]]] = {}
    for number, request in enumerate(requests):
        if not request.as_told(diagram):
            continue
        if request.metric not in METRICS or not request.signals or request.output is None:
            continue
        if any(signal.impulse() for signal in request.signals.values()):
            continue
        endless = any(signal.final() is None for signal in request.signals.values())
        if endless and request.duration is None:
            continue
        key = (tuple((name, id(signal)) for name, signal in request.signals.items()), request.duration)
        found.setdefault(key, (request, []))[1].append(number)
    return [
        Experiment(signals=request.signals, duration=request.duration, requests=tuple(numbers))
        for request, numbers in found.values()
    ]
