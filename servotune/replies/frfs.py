"""Measured frequency response functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from servotune import tables
from servotune.replies.base import Reply
from servotune.replies.values import Warned

if TYPE_CHECKING:
    import pandas as pd


class FrfOutput(Reply):
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


class Frf(Reply):
    """Responses of one or several outputs on common lines (rad/s); `id` where it is kept."""

    id: str | None
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

    def to_pandas(self) -> pd.DataFrame:
        """Return magnitude, phase (rad) and coherence over the frequency (rad/s), with the output as the first level of the columns."""
        names = ("magnitude", "phase", "real", "imag", "coherence")
        columns = {
            (name, part): output[part] for name, output in self.outputs.items() for part in names if output[part]
        }
        return tables.frame("frequency", "rad/s", self.frequency, columns)
