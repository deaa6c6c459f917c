"""Measured against simulated."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from api.schemas.replies.base import Curve, Number, Reply, StudyReply


class FitReply(Reply):
    """Fit measures in percent; null where one does not exist."""

    fit_percent: Number
    relative_error_percent: Number
    vaf_percent: Number
    nrmse_percent: Number


class ValidationCurves(Reply):
    """Measured and simulated, SI."""

    time: Curve
    measured: Curve
    simulated: Curve


class ValidatedOutput(FitReply):
    """One output."""

    worst_interval: Annotated[Curve, Field(min_length=2, max_length=2)]
    baselines: dict[str, FitReply]
    offset: Number
    unit: str
    curves: ValidationCurves


class ValidationReply(StudyReply):
    """Measured against simulated."""

    outputs: dict[str, ValidatedOutput]
    verdict: Literal["pass", "fail"]
    limit_percent: float
    dataset: str
