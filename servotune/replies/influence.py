"""How strongly parameters move metrics."""

from __future__ import annotations

from typing import NotRequired, TypedDict

from servotune.replies.values import Metric, Warned


class Elasticity(TypedDict):
    """Relative change of a metric per relative change of a parameter, in the limit."""

    value: float | None
    one_sided: bool
    verdict: str
    method: NotRequired[str]
    error: NotRequired[float | None]


class Coefficient(TypedDict):
    """Influence coefficient of eq. (4) at a finite relative change."""

    value: float | None
    change: float
    initial: float | None
    final: float | None
    verdict: str


class Strongest(TypedDict):
    """The largest elasticity of each row and column."""

    by_parameter: dict[str, str]
    by_metric: dict[str, str]


class Change(TypedDict):
    """A parameter before and after (SI)."""

    initial: float
    final: float


class PredictedMetric(TypedDict):
    """A metric as its derivatives predict it, by the power law M Π (p'/p)^E or on the straight line, and as it is."""

    value: float | None
    law: str
    straight: float | None
    exact: Metric
    error: float | None
    relative_error: float | None
    verdict: str


class Prediction(TypedDict):
    """One set of changes and what it does."""

    changes: dict[str, Change]
    metrics: dict[str, PredictedMetric]


class Influence(TypedDict):
    """How strongly parameters move metrics; `elasticities[metric][parameter]`."""

    base: dict[str, Metric]
    elasticities: dict[str, dict[str, Elasticity]]
    coefficients: dict[str, dict[str, Coefficient]]
    strongest: Strongest
    predictions: NotRequired[list[Prediction] | None]
    warnings: NotRequired[list[Warned]]
