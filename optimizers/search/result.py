"""What an optimisation returns, and how it reports while it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from engine.model.verdicts import Measured
from optimizers.evaluation.certificate import Certificate


class Status(StrEnum):
    """How an optimisation ended."""

    CONVERGED = "converged"
    INFEASIBLE = "infeasible"
    STALLED = "stalled"
    BUDGET = "budget"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalReport:
    """A goal before and after, each measured exactly in the scenario that serves it worst.

    ``multiplier`` is the sensitivity of the optimal objective to the goal's active bound, per unit of relative
    violation (None when the goal is no active constraint). ``elasticities`` are those of the metric after, d ln m/d ln p.
    ``score`` tells how the metric after stands to its bounds on the scale of all goals, met at 1 (None without a bound).
    """

    before: Measured
    after: Measured
    scenario: int
    met: bool
    active: bool
    multiplier: float | None
    elasticities: Mapping[str, float | None]
    score: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryPoint:
    """The best point known after so many evaluations and ``seconds`` of the search, and where it lies (for the path on a map)."""

    evaluation: int
    objective: float
    violation: float
    variables: Mapping[str, float] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridMap:
    """The whole grid: ``objective`` and ``violation`` with one axis for each variable, first variable slowest."""

    axes: Mapping[str, npt.NDArray[np.float64]]
    objective: npt.NDArray[np.float64]
    violation: npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontPoint:
    """A point of a front: no other is better in every objective; ``values`` of all goals, exact, worst scenario each."""

    variables: Mapping[str, float]
    values: tuple[Measured, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """What can be had of several objectives at once.

    ``hypervolume`` is the share of the box between ``ideal`` and ``nadir`` (best and worst value of each objective on the
    front, in the order of the problem's objectives) that the front dominates; ``knee`` is the index of the point where giving
    up one objective begins to cost most of another.
    """

    points: tuple[FrontPoint, ...]
    hypervolume: float
    knee: int
    ideal: tuple[float, ...]
    nadir: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """What another method reached: its objective less that of the result, relative to the latter's size."""

    method: str
    status: Status
    objective: float
    violation: float
    gap: float
    best: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Robustness:
    """How ranges of uncertain parameters were served.

    ``scenarios`` are all that the variables were chosen for: corners, and what an adversary found besides. ``worst`` is the
    least favourable point of the ranges at the end, with its violation and objective; ``evaluations`` those of the adversary.
    """

    scenarios: tuple[Mapping[str, float], ...]
    worst: Mapping[str, float]
    violation: float
    objective: float
    rounds: int
    evaluations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Yield:
    """Share of samples of the uncertain parameters that meet every hard goal, with its 95 % interval (Wilson).

    ``failures`` counts for each hard goal, by index, the samples that break it; ``unstable`` those without a stable system.
    """

    share: float
    lower95: float
    upper95: float
    samples: int
    failures: Mapping[int, int]
    unstable: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """One variable at another ``value``, all others at the optimum.

    ``values`` are those of the goals, each in the scenario that serves it worst there (None without a value, infinite where
    never crossed); ``objective`` (NaN where a goal has no value) and ``violation`` are those of the problem.
    """

    value: float
    values: tuple[float | None, ...]
    objective: float
    violation: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """The best point with everything that a user needs to trust it; ``goals`` in the order of the problem.

    ``objective`` is its exact value at the best point, NaN where a metric has none. ``conflict`` names by index the goals that
    fight each other at the point that breaks them least, each with its share in the fight. ``bound`` is an objective that no
    choice can beat, where a method knows one. ``stationarity`` is the gain that the slopes of all active functions promise for moves
    of 1 % of the ranges, relative to the objective, None where no descent has looked. ``scenario_names`` are those of the problem, none where it has none.
    ``moves`` tell for each variable what becomes of the goals a little ``down`` and ``up``, None where a bound is in the way.
    ``seconds`` is the wall time of everything that led to it; ``effort`` tells it by stage, with the processor time.
    """

    status: Status
    advice: str
    best: Mapping[str, float]
    goals: tuple[GoalReport, ...]
    certificate: Certificate
    history: tuple[HistoryPoint, ...]
    evaluations: int
    seconds: float
    map: GridMap | None = None
    warnings: tuple[str, ...] = ()
    objective: float = float("nan")
    conflict: Mapping[int, float] = field(default_factory=dict)
    bound: float | None = None
    stationarity: float | None = None
    front: Front | None = None
    gaps: tuple[Gap, ...] = ()
    robustness: Robustness | None = None
    expected: Yield | None = None
    scenario_names: tuple[str | None, ...] = ()
    moves: Mapping[str, Mapping[str, Move | None]] = field(default_factory=dict)
    effort: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


class Monitor(Protocol):
    """The caller's side of a running optimisation."""

    def progress(self, fraction: float, message: str) -> None:
        """Take note of the finished share (0…1) and what is being done."""
        ...

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Take note of a new best point."""
        ...

    def cancelled(self) -> bool:
        """Return whether to stop; asked at least every 0.2 s."""
        ...


@runtime_checkable
class Keeper(Protocol):
    """A monitor that keeps the state of a search, so that a job that was killed goes on where it was.

    A state is a document of plain numbers with the ``kind`` of the method that made it and alone understands it.
    """

    def keep(self, state: Mapping[str, Any]) -> None:
        """Remember this state instead of the last one."""
        ...

    def kept(self) -> Mapping[str, Any] | None:
        """Return the last state, of this run or of an earlier one of the same search; None where there is none."""
        ...


def kept_by(monitor: Monitor, kind: str) -> Mapping[str, Any] | None:
    """Return the state that a method of this kind has left with a monitor, None where it goes on from nothing."""
    state = monitor.kept() if isinstance(monitor, Keeper) else None
    return state if state is not None and state.get("kind") == kind else None


class Unwatched:
    """The monitor of a caller that does not watch."""

    def progress(self, fraction: float, message: str) -> None:
        """Ignore the progress."""

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Ignore the new best point."""

    def cancelled(self) -> bool:
        """Return False: nobody cancels."""
        return False


class Quiet:
    """The monitor of a search inside another one: only a cancel goes through."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor = monitor

    def progress(self, fraction: float, message: str) -> None:
        """Leave the progress to the search outside."""

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Leave the best point to the search outside: what is best here may be none of its problem."""

    def cancelled(self) -> bool:
        """Return whether to stop."""
        return self._monitor.cancelled()


class Share:
    """A monitor that sees a part of the work as a share of the whole: from ``first``, ``size`` wide.

    The state of a search is kept among those of the other shares, by where its share begins.
    """

    def __init__(self, monitor: Monitor, first: float, size: float) -> None:
        self._monitor, self._first, self._size = monitor, first, size
        self._name = f"{first:.9g}"

    def progress(self, fraction: float, message: str) -> None:
        """Pass the progress on, as a share."""
        self._monitor.progress(self._first + self._size * fraction, message)

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Pass the new best point on."""
        self._monitor.best(evaluation, objective, violation, variables)

    def cancelled(self) -> bool:
        """Return whether to stop."""
        return self._monitor.cancelled()

    def keep(self, state: Mapping[str, Any]) -> None:
        """Remember the state of this share."""
        if isinstance(self._monitor, Keeper):
            self._monitor.keep({**(self._monitor.kept() or {}), self._name: state})

    def kept(self) -> Mapping[str, Any] | None:
        """Return the last state of this share."""
        states = self._monitor.kept() if isinstance(self._monitor, Keeper) else None
        state: Mapping[str, Any] | None = (states or {}).get(self._name)
        return state
