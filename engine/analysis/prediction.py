"""What a metric will be after a change of parameters, told from its elasticities alone, and how far that is from the truth.

    power law    M' = M Π (p'/p)^E,   E = (∂M/∂p) (p / M)
    straight     M' = M + Σ (∂M/∂p) (p' - p)

Both are right to first order. The power law is what a constant elasticity means: it is exact where M is a product of
powers (a time constant m/b, a gain margin in the gain), two changes that undo each other undo its prediction, and it keeps
the sign of M. It is the prediction wherever M and every ratio p'/p are positive; elsewhere the straight line is. The
error is the predicted value less the exact one, which is computed anew at the changed parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from engine.analysis.measuring import MetricRequest, measure
from engine.model.errors import IllPosedError
from engine.model.verdicts import Measured, Verdict

if TYPE_CHECKING:
    from engine.analysis.measuring import Gradient
    from engine.diagram.diagram import Diagram


class Law(StrEnum):
    """How a prediction follows from the derivatives."""

    POWER = "power"
    STRAIGHT = "straight"


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One parameter before and after, SI."""

    initial: float
    final: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedMetric:
    """One metric after the change.

    Parameters
    ----------
    base, exact : Measured
        The exact values before and after the change.
    value : float or None
        The prediction, by ``law``; None with its ``verdict`` where the metric or its derivative does not exist.
    straight : float or None
        The prediction on the straight line, whatever ``law`` is.
    error : float or None
        Predicted less exact value.
    verdict : Verdict
        ``discontinuous`` where the metric jumps at the base, so that the prediction holds on one side of it.
    """

    base: Measured
    exact: Measured
    law: Law
    value: float | None
    straight: float | None
    error: float | None
    verdict: Verdict

    @property
    def relative_error(self) -> float | None:
        """The error relative to the exact value."""
        if self.error is None or not self.exact.value:
            return None
        return self.error / self.exact.value


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Every metric after one set of changes, made together."""

    changes: Mapping[str, Change]
    metrics: Mapping[str, PredictedMetric]


def predict(
    diagram: Diagram,
    requests: Mapping[str, MetricRequest],
    changes: Mapping[str, float],
    *,
    overrides: Mapping[str, float] | None = None,
) -> Prediction:
    """Return each metric as its elasticities predict it after the changes, with its exact value and the error between.

    Parameters
    ----------
    diagram : Diagram
    requests : mapping of str to MetricRequest
        Metrics by name.
    changes : mapping of str to float
        New values (SI) by parameter path, all made at once.
    overrides : mapping, optional
        Parameter values (SI) before the changes.

    Raises
    ------
    DiagramError
        When a request or a parameter is unknown, or a new value is out of its bounds.
    """
    found = measure(diagram, list(requests.values()), overrides=overrides, gradient=list(changes))
    before = {p: float((overrides or {}).get(p, diagram.parameters[p].value)) for p in changes}
    try:
        after = [m for m, _ in measure(diagram, list(requests.values()), overrides={**(overrides or {}), **changes})]
    except IllPosedError as error:
        after = [
            Measured(value=None, unit=base.unit, verdict=Verdict.ILL_POSED, advice=error.message) for base, _ in found
        ]
    made = {p: Change(initial=before[p], final=float(changes[p])) for p in changes}
    metrics = {
        name: _predicted(base, gradient, exact, made)
        for name, (base, gradient), exact in zip(requests, found, after, strict=True)
    }
    return Prediction(changes=made, metrics=metrics)


def _predicted(
    base: Measured, gradient: Gradient | None, exact: Measured, changes: Mapping[str, Change]
) -> PredictedMetric:
    if base.value is None or gradient is None or not np.isfinite(gradient.values).all():
        verdict = base.verdict if base.value is None else Verdict.DISCONTINUOUS
        return PredictedMetric(
            base=base, exact=exact, law=Law.STRAIGHT, value=None, straight=None, error=None, verdict=verdict
        )
    slopes = gradient.values
    initial = np.array([change.initial for change in changes.values()])
    final = np.array([change.final for change in changes.values()])
    straight = base.value + float(slopes @ (final - initial))
    law = Law.POWER if base.value > 0 and np.all(final * initial > 0) else Law.STRAIGHT
    value = straight
    if law is Law.POWER:
        elasticities = slopes * initial / base.value
        value = base.value * float(np.exp(elasticities @ np.log(final / initial)))
    return PredictedMetric(
        base=base,
        exact=exact,
        law=law,
        value=value,
        straight=straight,
        error=None if exact.value is None else value - exact.value,
        verdict=Verdict.DISCONTINUOUS if gradient.one_sided else Verdict.OK,
    )
