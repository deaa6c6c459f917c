"""One search for each way in which inputs may go on between their samples, where nobody knows it; the best one counts.

The first search is the whole one. The others begin where it came to rest, since the ways are near each other: a few steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextvars import Context
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from engine.model.between_samples import BetweenSamples
from engine.model.between_samples import tried as every_way
from engine.model.interruption import interruptible
from optimizers.evaluation.spreading import Parcel, current, known
from optimizers.identification.answers import Samples
from optimizers.identification.search import CancelledError, Search
from optimizers.identification.starts import first_start, further_starts, promising_starts
from optimizers.identification.words import at_bounds
from optimizers.methods.least_squares import Minimum, Reached, minimize_squares
from optimizers.recorded.recording import Identification
from optimizers.search.limits import Limited
from optimizers.search.result import Keeper, Monitor, Status, Unwatched, kept_by

LEAST_GAIN: Final = 1e-7
"""A parameter that moves by its standard deviation changes the cost by 1/samples: far more than this."""
_KIND = "identification"
"""Of the states that a search keeps."""
_WEIGHINGS: Final = 3
"""Times that outputs are weighted by what is left of them: it changes little after the first."""
_DOUBTFUL: Final = 0.125
"""Costs above leave half of what was to be explained: a fit below 50 %,"""
_DOUBTFUL_AT_A_BOUND: Final = 0.005
"""and a tenth of it: a fit below 90 %."""
_SAMPLES_LOOKED_AT: Final = 6_000_000
"""Of all further evaluations together, slopes counted, where a search ended in a doubtful place,"""
_MOST_LOOKED_AT: Final = 60
"""and how many these may be."""
_FROM_REST: Final = 20
"""Evaluations of another way: a few steps from where the first came to rest, unless nothing is determined."""
_EACH: Final = 12
"""Evaluations after which it is plain which of several further starts leads on."""
_BETTER: Final = 1 - 1e-6
_SEED: Final = 0
_EXACT: Final = 1e-18
"""Costs below this are rounding: errors of 1e-9 of the output's spread."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tried:
    """How a search ended: ``found`` is None where the model has a response at no start; ``way`` where none was to be chosen."""

    way: BetweenSamples | None
    search: Search
    found: Minimum | None
    status: Status


def tried_ways(problem: Identification, monitor: Monitor, rng: np.random.Generator) -> list[Tried]:
    """Return the searches, the best first.

    Parameters
    ----------
    problem : Identification
    monitor : Monitor
    rng : numpy.random.Generator
        Chooses the starts after the first.
    """
    kept = dict(kept_by(monitor, _KIND) or {})
    done: list[dict[str, Any]] = list(kept.pop("done", []))
    evaluations = int(kept.pop("evaluations", 0))
    starts = np.array([first_start(problem), *further_starts(problem, rng)])
    tried: list[Tried] = []
    ways: tuple[BetweenSamples | None, ...] = every_way(problem.undecided) if problem.undecided else (None,)
    for number, way in enumerate(ways):
        search = Search(problem if way is None else _with(problem, way), monitor)
        search.evaluations = evaluations
        search.least_told = min((one.found.cost for one in tried if one.found is not None), default=np.inf)
        if number < len(done):
            tried.append(_again(way, search, done[number]))
            continue
        before = tried[0].found if tried else None
        own = _padded(search, starts) if before is None else before.x[None]
        reached = _reached(kept) if number == len(done) else None
        found, status = _searched(search, own, reached, done)
        tried.append(Tried(way=way, search=search, found=found, status=status))
        if status in {Status.CANCELLED, Status.BUDGET} and search.stopped:
            break
        evaluations = search.evaluations
        done.append({
            "x": None if found is None else found.x.tolist(), "converged": found is not None and found.converged,
        })  # fmt: skip
    stopped = tried[-1].status if tried[-1].search.stopped else None
    tried.sort(key=lambda one: np.inf if one.found is None else max(one.found.cost, _EXACT))  # of equals the first
    # the best may have come to rest before the time was over for the others
    return tried if stopped is None else [replace(tried[0], status=stopped), *tried[1:]]


def _with(problem: Identification, way: BetweenSamples) -> Identification:
    experiments = (replace(e, recording=e.recording.with_undecided(way)) for e in problem.experiments)
    frequency = (f.with_undecided(way) for f in problem.frequency)
    return replace(problem, experiments=tuple(experiments), frequency=tuple(frequency))


def _padded(search: Search, starts: Samples) -> Samples:
    """Return starts of the parameters with initial states at rest."""
    return np.pad(starts, (*((0, 0),) * (starts.ndim - 1), (0, search.coordinates - search.parameters)))


def _again(way: BetweenSamples | None, search: Search, done: Mapping[str, Any]) -> Tried:
    """Return what an earlier run of the search came to."""
    if done["x"] is None:
        return Tried(way=way, search=search, found=None, status=Status.STALLED)
    x, count = np.array(done["x"]), search.evaluations
    with search.workers():
        found = _at(search, x, converged=done["converged"])
    if search.weighs:
        search.weigh(found)
    search.evaluations = count
    return Tried(way=way, search=search, found=found, status=_ended(found))


def _bounds(search: Search) -> tuple[Samples, Samples]:
    """Return the bounds of all coordinates; initial states have none."""
    unknowns = search.problem.unknowns
    free = np.full(search.coordinates - search.parameters, np.inf)
    lower = np.append([u.coordinate(u.lower) for u in unknowns], -free)
    return lower, np.append([u.coordinate(u.upper) for u in unknowns], free)


def followed(problem: Parcel, start: Samples, most: int) -> tuple[Minimum | None, int] | None:
    """Return the minimum from a start and how many evaluations it took, in a worker; None where it does not know the problem."""
    with known(problem, lambda made: Search(made, Unwatched())) as search:
        return None if search is None else _followed(search, start, most)


def _followed(search: Search, start: Samples, most: int) -> tuple[Minimum | None, int]:
    before, (lower, upper) = search.evaluations, _bounds(search)
    found = minimize_squares(
        search.errors, start[None], lower=lower, upper=upper, max_evaluations=most, least_gain=LEAST_GAIN
    )
    return found, search.evaluations - before


def _followed_elsewhere(search: Search, most: int) -> Callable[[Samples], Iterator[Minimum | None] | None]:
    """Return what asks others for the minima from starts, once the first start has been followed here."""
    begun, before = time.perf_counter(), search.evaluations

    def here(start: Samples, most: int) -> tuple[Minimum | None, int]:
        return _followed(search, start, most)[0], 0  # which this search has counted

    def others(starts: Samples) -> Iterator[Minimum | None] | None:
        seconds, spread = time.perf_counter() - begun, current()
        if spread is None:
            return None
        tasks = [(start, most) for start in starts]
        longest = seconds / max(search.evaluations - before, 1) * most
        found = spread.each(search.problem, followed, tasks, here=here, seconds=seconds, longest=longest)
        return None if found is None else told(found)

    def told(found: Iterator[tuple[Minimum | None, int]]) -> Iterator[Minimum | None]:
        while True:
            # Whoever counts how long evaluations take is not to take the wait for one.
            with interruptible(lambda: Context().run(search.check)):
                minimum, evaluations = next(found, (None, -1))
            if evaluations < 0:
                return
            search.took(evaluations, minimum)
            yield minimum

    return others


def _searched(
    search: Search, starts: Samples, reached: Reached | None, done: list[dict[str, Any]]
) -> tuple[Minimum | None, Status]:
    """Return the best minimum and how the search ended."""
    monitor, (lower, upper) = search.monitor, _bounds(search)
    most = search.problem.max_evaluations if not done else min(search.problem.max_evaluations, _FROM_REST)
    keeper = monitor if isinstance(monitor, Keeper) else None

    def tell(now: Reached) -> None:
        if keeper is not None:
            keeper.keep({"kind": _KIND, "evaluations": search.evaluations, "done": done, **asdict(now)})

    try:
        with search.workers():
            found = minimize_squares(
                search.errors,
                starts,
                lower=lower,
                upper=upper,
                max_evaluations=most,
                least_gain=LEAST_GAIN,
                reached=reached,
                tell=tell,
                others=_followed_elsewhere(search, most),
            )
            # the other ways begin where this one came to rest
            if found is not None and not done and _is_doubtful(search, found):
                x = _looked_beside(search, found, lower, upper)
                if x is not None:
                    found = minimize_squares(
                        search.errors, x[None], lower=lower, upper=upper, max_evaluations=most, least_gain=LEAST_GAIN
                    )
            for _ in range(_WEIGHINGS if found is not None and search.weighs else 0):
                assert found is not None
                search.weigh(found)
                nearer = minimize_squares(
                    search.errors, found.x[None], lower=lower, upper=upper, max_evaluations=most, least_gain=LEAST_GAIN
                )
                if nearer is not None:
                    with search.alike():
                        found = _at(search, nearer.x, converged=found.converged and nearer.converged)
    except CancelledError:
        search.stopped = True
        over = isinstance(monitor, Limited) and monitor.over
        return search.best, Status.BUDGET if over else Status.CANCELLED
    return found, Status.STALLED if found is None else _ended(found)


def _is_doubtful(search: Search, found: Minimum) -> bool:
    """Tell whether a minimum may be a wrong one, and others can be looked for at little cost: linear models answer quickly."""
    if search.problem.diagram.nonlinear or search.problem.diagram.sampled:
        return False
    held = bool(at_bounds(search.problem.unknowns, found.x))
    return found.cost > (_DOUBTFUL_AT_A_BOUND if held else _DOUBTFUL)


def _looked_beside(search: Search, found: Minimum, lower: Samples, upper: Samples) -> Samples | None:
    """Return a point that is better than a minimum, on the way from another start; None where none is seen."""

    def cost(x: Samples) -> float:
        residuals = search.errors(_padded(search, x))[0]
        return float(residuals @ residuals) if np.isfinite(residuals).all() else np.inf

    budget = min(_SAMPLES_LOOKED_AT // (search.samples * (1 + search.coordinates)), _MOST_LOOKED_AT)
    starts = promising_starts(search.problem, cost, np.random.default_rng(_SEED), most=budget - budget // 3)
    starts = starts[: budget // 3 // _EACH]
    if not len(starts):
        return None
    again = minimize_squares(
        search.errors, _padded(search, starts), lower=lower, upper=upper, max_evaluations=_EACH, least_gain=LEAST_GAIN
    )
    return again.x if again is not None and again.cost < _BETTER * found.cost else None


def _at(search: Search, x: Samples, *, converged: bool) -> Minimum:
    """Return what was found as all outputs count alike, whatever they were weighted by."""
    residuals, jacobian = search.errors(x)
    return Minimum(x=x, residuals=residuals, jacobian=jacobian, converged=converged, evaluations=1)


def _ended(found: Minimum) -> Status:
    return Status.CONVERGED if found.converged else Status.BUDGET


def _reached(kept: Mapping[str, Any]) -> Reached | None:
    """Return how far an earlier run of the search got, None for the first one."""
    if not kept:
        return None
    here, best = kept["here"], kept["best"]
    return Reached(
        start=int(kept["start"]),
        here=None if here is None else tuple(here),
        spent=int(kept["spent"]),
        best=None if best is None else tuple(best),
        converged=bool(kept["converged"]),
    )
