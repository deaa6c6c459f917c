"""Measured frequency response functions."""

from __future__ import annotations

from typing import Any, NotRequired, TypedDict

from servotune.replies.values import Warned


class FrfOutput(TypedDict):
    """One response over the input: phases in rad, bounds that hold the truth line by line, None where nothing tells."""

    unit: str
    response_unit: str
    magnitude: list[float | None]
    phase: list[float | None]
    real: list[float | None]
    imag: list[float | None]
    coherence: list[float | None] | None
    magnitude_lower: list[float | None] | None
    magnitude_upper: list[float | None] | None
    phase_lower: list[float | None] | None
    phase_upper: list[float | None] | None
    doubts: list[dict[str, Any]]
    simulated: dict[str, Any] | None


class Frf(TypedDict):
    """Responses of one or several outputs on common lines (rad/s); `id` where it is kept."""

    id: NotRequired[str]
    dataset: str
    input: str
    input_unit: str
    estimator: str
    form: str | None
    frequency: list[float]
    resolution: float | None
    averages: int
    effective_averages: float
    confidence: float
    window: dict[str, Any] | None
    outputs: dict[str, FrfOutput]
    modes: dict[str, Any] | None
    system: dict[str, Any] | None
    warnings: list[Warned]
