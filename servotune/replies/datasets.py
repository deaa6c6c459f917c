"""Recordings and their samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from servotune import plots, tables
from servotune.replies.base import Reply

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class Dataset(Reply):
    """A recording."""

    id: str
    status: str
    name: str | None
    format: str | None
    channels: list[dict[str, Any]] | None
    sample_rate: float | None
    sample_count: int | None
    uneven: bool | None


class ChannelData(Reply):
    """Samples of a channel; with fewer `points` than samples, the smallest and largest value of each piece instead."""

    unit: str
    time: list[float]
    values_: list[float] | None
    min: list[float] | None
    max: list[float] | None

    def to_pandas(self) -> pd.DataFrame:
        """Return the values over time (s); of thinned samples the smallest and the largest of each piece."""
        curves = {"value": self.values_} if self.values_ is not None else {"min": self.min or [], "max": self.max or []}
        return tables.frame("time", "s", self.time, curves)

    def plot(self, axes: list[Axes] | None = None) -> list[Axes]:
        """Draw the values over time."""
        return plots.channel(self, axes)
