"""Metrics of responses to any command for many candidates whose only laws are samplers, with limits or without."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.linear.commands import NotCoveredError
from engine.batch.linear.response_requests import ResponseRequests, plan_of
from engine.batch.linear.spans import in_spans
from engine.batch.linear.wanted import HELD, order_of, reaches, readings_of
from engine.batch.nonlinear.readings import SETTLED_ONLY
from engine.batch.sampled_data.cycle import Cycle
from engine.batch.sampled_data.evaluate import Ends, evaluate
from engine.batch.sampled_data.march import LEVELS, Beat
from engine.elements._limiting import Shape
from engine.metrics import catalogue
from engine.metrics._base import TimeMetric
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.analysis.measuring import MetricRequest
    from engine.batch.linear.evaluate import Watched
    from engine.batch.linear.readings import Wanted
    from engine.batch.screened import Screened
    from engine.diagram.diagram import Diagram
    from engine.exact.sampled_data.system import SampledSystem
    from engine.model.linear_system import Array

Whole = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

_MOST_STATES: Final = 64
_INSIDE: Final = 1e-12
"""Of where it rests: what rounding may leave of a rest that is just at a limit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """The requests of one command that is followed for ``duration`` s, None: until everything rests."""

    requests: ResponseRequests
    duration: float | None


def runs_of(diagram: Diagram, requests: Sequence[MetricRequest]) -> list[Run]:
    """Return what has to be followed for those requests that are read off responses."""
    found: dict[tuple[Any, ...], Run] = {}
    for column, request in enumerate(requests):
        order = order_of(diagram, request)
        if order is None or any(signal.impulse() for signal in request.signals.values()):
            continue
        key = (tuple((name, id(signal)) for name, signal in request.signals.items()), request.duration)
        run = found.get(key)
        if run is None:
            run = _run(diagram, request)
        if run is None or (request.metric in HELD and not reaches(request)):
            continue
        run.requests.add(column, request, order, diagram.outputs.index(str(request.output)))
        found[key] = run
    return list(found.values())


def _run(diagram: Diagram, request: MetricRequest) -> Run | None:
    """Return the run of a request; None for one that only the exact path knows how far to follow, or no states make."""
    response = ResponseRequests(
        inputs=[diagram.inputs.index(name) for name in request.signals], signals=list(request.signals.values())
    )
    try:
        response.command(request.duration or 1.0)
    except (NotCoveredError, UnresolvedError):
        return None
    return None if response.endless and request.duration is None else Run(requests=response, duration=request.duration)


def follow_run(
    run: Run, diagram: Diagram, system: SampledSystem, members: Array, found: Screened, threads: int
) -> None:  # fmt: skip
    """Enter the metrics of a run for the ``members`` of a batch that ``system`` consists of, and how they grow."""
    inputs, outputs = run.requests.inputs, sorted(set(run.requests.outputs))
    groups: dict[bytes, tuple[Array, list[int]]] = {}
    for output in outputs:
        kept = np.flatnonzero(system.lying_between(inputs, [output], limited=True))
        groups.setdefault(kept.tobytes(), (kept, []))[1].append(output)
    for states, own in groups.values():
        part = system.part(states).between(inputs, own)
        if not 0 < part.n <= _MOST_STATES or not part.samplings:
            continue
        cycle = Cycle.of(part, limited=True)
        if cycle is None:
            continue
        growth = cycle.growth
        requests = run.requests.of(own)
        if not part.limited:  # which may hold what runs away
            found.growth[members] = np.fmax(found.growth[members], growth)
            found.doubtful[np.ix_(members[growth >= 0], np.array(requests.columns))] = False
        followed = np.isfinite(growth) if part.limited and run.duration is not None else growth < 0
        stable = np.arange(len(growth))[followed]
        if stable.size:
            _follow(run, requests, diagram, cycle, members, stable, found, threads)


def _follow(
    run: Run, requests: ResponseRequests, diagram: Diagram, cycle: Cycle, members: Array, stable: Array, found: Screened,
    threads: int,
) -> None:  # fmt: skip
    until = np.inf if run.duration is None else run.duration
    try:
        command = requests.command(until if run.duration is not None else 0.0)
    except (NotCoveredError, UnresolvedError):
        return
    plan, drive = plan_of(requests, command)
    watched, wanted = readings_of(diagram, requests, command, outputs_too=True)
    final = plan.states[plan.last] if plan.last >= 0 else np.zeros(drive.flow.shape[0])
    rests = np.full((len(cycle.flow), cycle.flow.shape[1]), np.nan, dtype=np.result_type(cycle.flow, cycle.jumps))
    rests[stable] = cycle.rest(stable, drive.drive @ final)
    limits, bounded = _limits(cycle)
    there = _within(rests.real, limits, bounded)
    rests[~(_begins(limits, bounded) & (there | (run.duration is not None)))] = np.nan
    kind = np.result_type(
        cycle.flow, cycle.jumps, cycle.driven, cycle.entering, cycle.read, cycle.direct, limits, found.values
    )
    arrays = [
        np.ascontiguousarray(part[stable], dtype=kind)
        for part in (cycle.flow, cycle.driven, cycle.read, cycle.direct, cycle.jumps, cycle.entering, rests, limits)
    ]
    known = there[stable]
    ends = _ends(requests, watched, wanted, command.last, endless=plan.last < 0)
    timing = _timing(cycle, bounded, kind)
    values = np.full((len(stable), len(requests.columns)), np.nan, dtype=kind)
    doubtful = np.ones(values.shape, dtype=bool)

    def work(span: slice) -> None:
        flow, driven, read, direct, jumps, entering, rest, limits = (part[span] for part in arrays)
        evaluate(
            flow, driven, read, direct, jumps, entering, rest, known[span], limits, timing, plan, drive, watched, wanted, ends, until,
            cycle.moved, values[span], doubtful[span],
        )  # fmt: skip

    in_spans(members[stable], work, threads)
    values[doubtful] = np.nan
    at = np.ix_(members[stable], np.array(requests.columns))
    found.values[at], found.doubtful[at] = values if np.iscomplexobj(found.values) else values.real, doubtful


def _ends(requests: ResponseRequests, watched: Watched, wanted: Wanted, last: float, *, endless: bool) -> Ends:
    """Return what a run that ends after a time tells of each metric."""
    as_it_is = {
        int(output): row
        for row, output in enumerate(watched.outputs)
        if not watched.errors[row] and not watched.orders[row]
    }
    plain = [as_it_is[int(watched.outputs[row])] for row in wanted.row]
    relative, refused = np.zeros((2, len(plain)), dtype=np.int64)
    for k, request in enumerate(requests.requests if not endless else []):
        metric = catalogue()[request.metric]
        relative[k] = issubclass(metric, TimeMetric) and metric.of_the_end
        refused[k] = (relative[k] or request.metric in SETTLED_ONLY) and not request.unsettled
    return Ends(np.array(plain, np.int64), relative, refused, last)


def _limits(cycle: Cycle) -> tuple[Array, Whole]:
    """Return the limits of a cycle in their order, (B, L, 4), with the rows that they act on, (L, 4), as `Beat` has them."""
    own = [limit for limit in cycle.limits if limit is not None]
    bounds = [np.stack([each.lower, each.upper, each.reach, each.share], axis=1) for each in own]
    rows = [
        [each.computed, *(-1 if row is None else row for row in (each.output, each.integral)), each.shape]
        for each in own
    ]
    limits = np.stack(bounds, axis=1) if own else np.zeros((len(cycle.flow), 0, 4))
    return limits, np.array(rows, dtype=np.int64).reshape(-1, 4)


def _begins(limits: Array, bounded: Whole) -> Flags:
    """Return who begins with outputs of 0."""
    found = np.ones(len(limits), dtype=bool)
    for own, (*_, shape) in zip(limits.real.swapaxes(0, 1), bounded, strict=True):
        if shape != Shape.LEVELS:
            found &= (own[:, 0] <= 0) & (own[:, 1] >= 0)
    return found


def _within(rests: Array, limits: Array, bounded: Whole) -> Flags:
    """Return who rests (B, n) where no limit changes anything; with levels or a dead zone there are many places to rest."""
    found = np.ones(len(rests), dtype=bool)
    for own, (computed, *_, shape) in zip(limits.real.swapaxes(0, 1), bounded, strict=True):
        value, reach = rests[:, computed], _INSIDE * np.abs(rests[:, computed])
        found &= (shape < Shape.BEYOND) & (own[:, 0] <= value + reach) & (value - reach <= own[:, 1])
    return found


def _timing(cycle: Cycle, bounded: Whole, kind: npt.DTypeLike) -> Beat:
    """Return the timing of all members of a cycle."""
    g, n = cycle.jumps.shape[1:3]
    rows = np.full((g, n + 1), -1, dtype=np.int64)
    for instant in range(g):
        acts = (cycle.jumps[:, instant] != np.eye(n)).any(axis=(0, 2)) | (cycle.entering[:, instant] != 0).any(
            axis=(0, 2)
        )
        own = np.flatnonzero(acts)
        rows[instant, : len(own)] = own
    nothing = np.zeros((g, n, 0), dtype=kind)
    widths, present = len(cycle.widths), np.array([limit is not None for limit in cycle.limits])
    return Beat(
        cycle.instants, cycle.widths, cycle.kinds, cycle.length, cycle.flowing, np.zeros((g, n, n), dtype=kind), nothing, rows,
        np.zeros(widths, dtype=np.int64), np.zeros(widths, dtype=np.int64), np.zeros((widths, LEVELS), dtype=np.int64),
        np.where(present, np.cumsum(present) - 1, -1), bounded, np.zeros((len(bounded), 4), dtype=kind),
    )  # fmt: skip
