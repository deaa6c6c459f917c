"""How strongly parameters move metrics."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from api.schemas.replies.base import MetricReply, Number, Reply, StudyReply, VerdictWord


class ElasticityReply(Reply):
    """d ln(metric) / d ln(parameter)."""

    value: Number
    one_sided: bool
    verdict: VerdictWord
    method: Literal["exact", "differences"] = Field(
        default="exact", description="carried through the whole computation, or from differences that converge"
    )
    error: Number = Field(default=None, description="what a value from differences is estimated to miss")


class CoefficientReply(Reply):
    """Eq. (4) at a finite change."""

    value: Number
    change: Number
    initial: Number
    final: Number
    verdict: VerdictWord


class Strongest(Reply):
    """By |elasticity|."""

    by_parameter: dict[str, str | None]
    by_metric: dict[str, str | None]


class ChangeReply(Reply):
    """A parameter before and after, in SI."""

    initial: Number
    final: Number


class PredictedMetric(Reply):
    """A metric as its derivatives predict it: by the power law M Π (p'/p)^E, or on the straight line."""

    value: Number
    law: Literal["power", "straight"]
    straight: Number
    exact: MetricReply
    error: Number
    relative_error: Number
    verdict: VerdictWord


class PredictionReply(Reply):
    """One set of changes and what it does."""

    changes: dict[str, ChangeReply]
    metrics: dict[str, PredictedMetric]


class InfluenceReply(StudyReply):
    """Elasticities and influence coefficients; predictions where changes were named."""

    base: dict[str, MetricReply]
    elasticities: dict[str, dict[str, ElasticityReply]]
    coefficients: dict[str, dict[str, CoefficientReply]]
    strongest: Strongest
    predictions: list[PredictionReply] | None = None
