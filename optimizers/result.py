"""What an optimisation returns, and how it reports while it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from engine.verdicts import Measured
from optimizers.certificate import Certificate


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
    """

    before: Measured
    after: Measured
    scenario: int
    met: bool
    active: bool
    multiplier: float | None
    elasticities: Mapping[str, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class HistoryPoint:
    """The best point known after so many evaluations, and where it lies (for the path on a map)."""

    evaluation: int
    objective: float
    violation: float
    variables: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GridMap:
    """The whole grid: ``objective`` and ``violation`` with one axis for each variable, first variable slowest."""

    axes: Mapping[str, npt.NDArray[np.float64]]
    objective: npt.NDArray[np.float64]
    violation: npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """The best point with everything that a user needs to trust it; ``goals`` in the order of the problem."""

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


class Unwatched:
    """The monitor of a caller that does not watch."""

    def progress(self, fraction: float, message: str) -> None:
        """Ignore the progress."""

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Ignore the new best point."""

    def cancelled(self) -> bool:
        """Return False: nobody cancels."""
        return False
