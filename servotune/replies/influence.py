"""How strongly parameters move metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servotune import plots, tables
from servotune.replies.base import Reply
from servotune.replies.values import Metric, Warned

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class Elasticity(Reply):
    """Relative change of a metric per relative change of a parameter, in the limit."""

    value: float | None
    one_sided: bool
    verdict: str
    method: str | None
    error: float | None


class Coefficient(Reply):
    """Influence coefficient of eq. (4) at a finite relative change."""

    value: float | None
    change: float
    initial: float | None
    final: float | None
    verdict: str


class Strongest(Reply):
    """The largest elasticity of each row and column."""

    by_parameter: dict[str, str]
    by_metric: dict[str, str]


class Change(Reply):
    """A parameter before and after (SI)."""

    initial: float
    final: float


class PredictedMetric(Reply):
    """A metric as its derivatives predict it, by the power law M Π (p'/p)^E or on the straight line, and as it is."""

    value: float | None
    law: str
    straight: float | None
    exact: Metric
    error: float | None
    relative_error: float | None
    verdict: str


class Prediction(Reply):
    """One set of changes and what it does."""

    changes: dict[str, Change]
    metrics: dict[str, PredictedMetric]


class Influence(Reply):
    """How strongly parameters move metrics; `elasticities[metric][parameter]`."""

    id: str | None
    base: dict[str, Metric]
    elasticities: dict[str, dict[str, Elasticity]]
    coefficients: dict[str, dict[str, Coefficient]]
    strongest: Strongest
    predictions: list[Prediction] | None
    warnings: list[Warned] | None

    def to_pandas(self) -> pd.DataFrame:
        """Return the elasticities, a metric to a row and a parameter to a column."""
        return tables.matrix(
            "metric", {m: {p: e.value for p, e in own.items()} for m, own in self.elasticities.items()}
        )

    def plot(self, axes: list[Axes] | None = None) -> list[Axes]:
        """Draw the elasticities of each metric as bars."""
        return plots.influence(self, axes)

    def summary(self) -> str:
        """Return what is told of it in a line."""
        return ", ".join(f"{metric}: most by {name}" for metric, name in self.strongest.by_metric.items())
