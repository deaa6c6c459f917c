"""What an optimisation found, and the proof of it."""

from __future__ import annotations

from typing import Any, NotRequired, TypedDict

from servotune.replies.values import Metric


class GoalResult(TypedDict):
    """A goal before and after an optimisation."""

    metric: str
    experiment: NotRequired[str | None]
    output: NotRequired[str | None]
    before: Metric
    after: Metric
    met: bool
    active: bool
    multiplier: float | None
    hard: NotRequired[bool]
    score: NotRequired[float | None]
    scenario: NotRequired[int]
    scenario_name: NotRequired[str]
    elasticities: NotRequired[dict[str, float | None]]


class CertifiedGoal(TypedDict):
    """A goal at the optimum, computed exactly."""

    goal: int
    value: float | None
    violation: float | None
    independent: NotRequired[float | None]
    independent_tolerance: NotRequired[float | None]
    scenario: int
    scenario_name: NotRequired[str]
    at: dict[str, float] | None


class Certificate(TypedDict):
    """The optimum, measured again by the exact engine and by a second way of its own; the worse of both counts."""

    valid: bool
    worst_violation: float | None
    goals: list[CertifiedGoal]


class Evaluated(TypedDict):
    """One point of the convergence history."""

    evaluation: int
    objective: float | None
    violation: float | None
    variables: NotRequired[dict[str, float]]
    seconds: NotRequired[float]


class Map(TypedDict):
    """Objective and violation over a grid, row-major with the first variable slowest."""

    axes: dict[str, list[float]]
    objective: list[float | None]
    violation: list[float | None]


class FrontPoint(TypedDict):
    """A point of a front: its variables, and every goal there."""

    parameters: dict[str, float]
    goals: list[Metric]


class CrossCheck(TypedDict):
    """What another method reached; `gap` is relative to the size of the objective, positive where it is worse."""

    method: str
    status: str
    objective: float | None
    violation: float | None
    gap: float | None
    best: dict[str, float]


class Share(TypedDict):
    """The share of draws that meet every goal, with its 95 % interval."""

    share: float
    lower95: float
    upper95: float
    samples: int
    unstable: int
    failures: list[dict[str, int]]


class Move(TypedDict):
    """A variable at a value a little away from the optimum, and what becomes of the goals there (in their order, SI)."""

    value: float
    objective: float | None
    violation: float | None
    goals: list[float | None]


class Alternative(TypedDict):
    """How the optimisation of one structure ended."""

    name: str
    status: str
    advice: str
    best: dict[str, float]
    objective: float | None
    goals: list[GoalResult]
    certificate: Certificate


# Made from a dictionary because one of its keys, yield, is a word of the language.
_Extras = TypedDict(
    "_Extras",
    {
        "objective": float | None,
        "bound": float | None,
        "stationarity": float | None,
        "conflict": list[dict[str, Any]],
        "front": list[FrontPoint],
        "hypervolume": float | None,
        "knee": int,
        "ideal": list[float | None],
        "nadir": list[float | None],
        "cross_check": list[CrossCheck],
        "robustness": dict[str, Any],
        "yield": Share,
        "alternatives": list[Alternative],
        "chosen": str,
    },
    total=False,
)


class Optimization(_Extras):
    """The result of an optimisation."""

    status: str
    advice: str
    best: dict[str, float]
    goals: list[GoalResult]
    certificate: Certificate
    curves: dict[str, Any]
    elasticities: dict[str, Any]
    sensitivity: NotRequired[dict[str, dict[str, Move | None]]]
    history: list[Evaluated]
    evaluations: int
    seconds: float
    effort: NotRequired[dict[str, dict[str, float]]]
    map: NotRequired[Map | None]
    system: dict[str, Any]
