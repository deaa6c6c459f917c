"""Means and straight lines taken away.

y = x - mean x       or       y = x - (a + b t), with a and b of the least squares
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Real, Record


@dataclass(frozen=True, slots=True, kw_only=True)
class Detrend:
    """Take away the mean or the trend of channels.

    Parameters
    ----------
    trend : {"mean", "linear"}
    channels : tuple of str, optional
        All by default.
    """

    trend: Literal["mean", "linear"] = "mean"
    channels: tuple[str, ...] | None = None

    def apply(self, record: Record) -> Record:
        """Return the record with the channels around 0."""
        names = record.chosen(self.channels)
        return record.changed({name: detrended(record.values(name, complete=True), self.trend) for name in names})


def detrended(values: Real, trend: Literal["mean", "linear"]) -> Real:
    """Return samples without their mean, or without their straight line.

    Raises
    ------
    ProcessingError
        For a line through fewer than two samples.
    """
    if trend == "mean":
        return np.asarray(values - values.mean())
    if values.size < 2:
        raise ProcessingError(f"the recording must be >= 2 samples to have a trend, got {values.size}")
    # around the middle the two columns of the least squares are orthogonal
    position = np.arange(values.size) - (values.size - 1) / 2
    slope = (position @ values) / (position @ position)
    return np.asarray(values - values.mean() - slope * position)
