"""The integral of a channel by the trapezoidal rule, with a zero-phase high pass after it where one is stated.

    y_n = y_{n-1} + (x_n + x_{n-1}) / (2 rate),   y_0 = 0

The smallest offset of a sensor grows into a ramp: an acceleration is integrated with a high pass, or with its mean removed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.recordings.processing.record import Real, Record
from engine.recordings.processing.unit_names import times_second
from engine.recordings.processing.zero_phase import ZeroPhaseFilter, filtered


@dataclass(frozen=True, slots=True, kw_only=True)
class Integrate:
    """Make the integral of a channel a channel.

    Parameters
    ----------
    channel : str
    name : str, optional
        Of the integral; it takes the place of the channel by default.
    high_pass : float, optional
        rad/s: edge of the Butterworth high pass that runs forward and backward after the integration; none by default.
    order : int
        Of one pass of it.
    """

    channel: str
    name: str | None = None
    high_pass: float | None = None
    order: int = 2

    def apply(self, record: Record) -> Record:
        """Return the record with the integral."""
        values = integrated(record.values(self.channel, complete=True), record.rate)
        if self.high_pass is not None:
            design = ZeroPhaseFilter(band="high_pass", frequency=self.high_pass, order=self.order, called="high_pass")
            values = filtered(values, record.rate, design)
        name = self.name or self.channel
        return record.changed({name: values}, {name: times_second(record.unit(self.channel))})


def integrated(values: Real, rate: float) -> Real:
    """Return the integral from the first sample by the trapezoidal rule.

    Parameters
    ----------
    values : ndarray, shape (samples,)
    rate : float
        Samples per second.
    """
    return np.concatenate([[0.0], np.cumsum(values[1:] + values[:-1]) / (2 * rate)])
