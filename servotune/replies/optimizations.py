"""What an optimisation found, and the proof of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from servotune import plots, tables
from servotune.replies.base import Reply
from servotune.replies.values import Metric

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class GoalResult(Reply):
    """A goal before and after an optimisation."""

    metric: str
    experiment: str | None
    output: str | None
    before: Metric
    after: Metric
    met: bool
    active: bool
    multiplier: float | None
    hard: bool | None
    score: float | None
    scenario: int | None
    scenario_name: str | None
    elasticities: dict[str, float | None] | None


class CertifiedGoal(Reply):
    """A goal at the optimum, computed exactly."""

    goal: int
    value: float | None
    violation: float | None
    independent: float | None
    independent_tolerance: float | None
    scenario: int
    scenario_name: str | None
    at: dict[str, float] | None


class Certificate(Reply):
    """The optimum, measured again by the exact engine and by a second way of its own; the worse of both counts."""

    valid: bool
    worst_violation: float | None
    goals: list[CertifiedGoal]


class Evaluated(Reply):
    """One point of the convergence history."""

    evaluation: int
    objective: float | None
    violation: float | None
    variables: dict[str, float] | None
    seconds: float | None


class Map(Reply):
    """Objective and violation over a grid, row-major with the first variable slowest."""

    axes: dict[str, list[float]]
    objective: list[float | None]
    violation: list[float | None]


class FrontPoint(Reply):
    """A point of a front: its variables, and every goal there."""

    parameters: dict[str, float]
    goals: list[Metric]


class CrossCheck(Reply):
    """What another method reached; `gap` is relative to the size of the objective, positive where it is worse."""

    method: str
    status: str
    objective: float | None
    violation: float | None
    gap: float | None
    best: dict[str, float]


class Share(Reply):
    """The share of draws that meet every goal, with its 95 % interval."""

    share: float
    lower95: float
    upper95: float
    samples: int
    unstable: int
    failures: list[dict[str, int]]


class Move(Reply):
    """A variable at a value a little away from the optimum, and what becomes of the goals there (in their order, SI)."""

    value: float
    objective: float | None
    violation: float | None
    goals: list[float | None]


class Alternative(Reply):
    """How the optimisation of one structure ended."""

    name: str
    status: str
    advice: str
    best: dict[str, float]
    objective: float | None
    goals: list[GoalResult]
    certificate: Certificate


class _Extras(Reply):
    """What an optimisation has where it was asked for, or where its method gives it."""

    objective: float | None
    bound: float | None
    stationarity: float | None
    conflict: list[dict[str, Any]] | None
    front: list[FrontPoint] | None
    hypervolume: float | None
    knee: int | None
    ideal: list[float | None] | None
    nadir: list[float | None] | None
    cross_check: list[CrossCheck] | None
    robustness: dict[str, Any] | None
    yield_: Share | None
    alternatives: list[Alternative] | None
    chosen: str | None


class Optimization(_Extras):
    """The result of an optimisation."""

    status: str
    advice: str
    best: dict[str, float]
    goals: list[GoalResult]
    certificate: Certificate
    curves: dict[str, Any]
    elasticities: dict[str, Any]
    sensitivity: dict[str, dict[str, Move | None]] | None
    history: list[Evaluated]
    evaluations: int
    seconds: float
    effort: dict[str, dict[str, float]] | None
    map: Map | None
    system: dict[str, Any] | None

    def to_pandas(self) -> pd.DataFrame:
        """Return the goals: metric, value before and after, unit, whether it is met."""
        return tables.goals(self.goals)

    def history_to_pandas(self) -> pd.DataFrame:
        """Return the best so far at each evaluation that improved it."""
        return tables.records("evaluation", self.history)

    def plot(self, kind: str = "responses", axes: list[Axes] | None = None) -> list[Axes]:
        """Draw the responses before and after, or with ``kind="history"`` the best objective over the evaluations."""
        drawn = {"responses": plots.before_and_after, "history": plots.history}
        if kind not in drawn:
            raise ValueError(f"kind must be one of {', '.join(drawn)}, got {kind!r}")
        return drawn[kind](self, axes)

    def summary(self) -> str:
        """Return what is told of it in a line."""
        met = sum(goal.met for goal in self.goals)
        best = ", ".join(f"{name} = {value:.6g}" for name, value in self.best.items())
        return f"{self.status}, {met} of {len(self.goals)} goals met, {best}"
