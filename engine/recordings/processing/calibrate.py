"""A calibration that the recording does not have yet.

y = scale x + offset
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Record


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrate:
    """Turn a channel into another quantity: volts into the force that they command, say.

    Parameters
    ----------
    channel : str
    scale : float
        Not 0; in the new unit per old one.
    offset : float
        In the new unit.
    unit : str, optional
        The new unit; that of the channel by default.
    """

    channel: str
    scale: float
    offset: float = 0.0
    unit: str | None = None

    def __post_init__(self) -> None:
        if self.scale == 0 or not np.isfinite(self.scale):
            raise ProcessingError(f"scale must be finite and not 0, got {self.scale:g}", at=("scale",))

    def apply(self, record: Record) -> Record:
        """Return the record with the channel scaled."""
        given = record.values(self.channel)
        with np.errstate(over="ignore"):
            values = self.scale * given + self.offset
        if np.isinf(values[np.isfinite(given)]).any():  # which would count as missing samples
            msg = f"scale must leave the samples of channel {self.channel} within float64, got {self.scale:g}"
            raise ProcessingError(msg, at=("scale",))
        unit = record.unit(self.channel) if self.unit is None else self.unit
        return record.changed({self.channel: values}, {self.channel: unit})
