"""Responses in time and over frequency."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from api.schemas.replies.base import Curve, MetricReply, Number, Pole, Reply, StudyReply, VerdictWord
from api.schemas.replies.cycles import LimitCycleReply, OperatingPointReply, PredictedCycleReply


class SimulationVariant(Reply):
    """One set of parameters."""

    parameters: dict[str, Any]
    time: Curve
    outputs: dict[str, Curve]
    metrics: dict[str, dict[str, MetricReply]]
    verdict: VerdictWord
    error_estimate: float | None = Field(
        default=None,
        description="of the curves of a nonlinear system, relative to their largest values; null: exact to rounding",
    )
    limit_cycle: LimitCycleReply | None = Field(
        default=None, description="where a nonlinear response to commands that settle does not"
    )


class SimulationReply(StudyReply):
    """Curves and metrics."""

    variants: list[SimulationVariant]


class Crossing(Reply):
    """A margin and where it is."""

    frequency: Number
    value: Number


class Margins(Reply):
    """Every crossing of the loop where its gain is ``smallest_loop_gain`` or more."""

    gain: list[Crossing]
    phase: list[Crossing]
    delay: list[Crossing]
    smallest_loop_gain: Number = None


class NyquistReply(Reply):
    """The Nyquist criterion: closed-loop unstable poles = open-loop unstable poles - encirclements of -1."""

    encirclements: int
    open_loop_unstable_poles: int
    closed_loop_unstable_poles: int


class UnboundedReply(Reply):
    """A frequency at which the response is null, since it meets a pole on the imaginary axis."""

    frequency: Number
    verdict: VerdictWord
    advice: str


class PathReply(Reply):
    """One of the further paths."""

    source: str = Field(alias="from")
    target: str = Field(alias="to")
    frequency: Curve
    magnitude: Curve
    phase: Curve
    real: Curve
    imag: Curve
    metrics: dict[str, MetricReply]
    zeros: list[Pole] | None
    unbounded: list[UnboundedReply] | None = None


class FrequencyVariant(Reply):
    """One set of parameters."""

    parameters: dict[str, Any]
    verdict: VerdictWord
    frequency: Curve
    magnitude: Curve
    phase: Curve
    real: Curve
    imag: Curve
    metrics: dict[str, MetricReply]
    margins: Margins | None = None
    nyquist: NyquistReply | None = None
    poles: list[Pole]
    zeros: list[Pole] | None = Field(
        default=None,
        description="of what is shown; null where delays beside each other, or in a circle, make them endless",
    )
    paths: list[PathReply] | None = Field(default=None, description="where `paths` are asked for, in their order")
    unbounded: list[UnboundedReply] | None = Field(default=None, description="of `frequencies` that have no response")
    operating_point: OperatingPointReply | None = Field(default=None, description="of a nonlinear system")
    limit_cycles: list[PredictedCycleReply] | None = Field(
        default=None, description="of a nonlinear system with `open_at`: what describing functions predict"
    )


class FrequencyReply(StudyReply):
    """Bode and Nyquist data, metrics and margins."""

    variants: list[FrequencyVariant]
