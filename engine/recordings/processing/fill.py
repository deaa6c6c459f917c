"""Missing samples put on the line between their neighbours.

y_n = x_a + (x_b - x_a) (n - a) / (b - a),   a < n < b the nearest samples that are there
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Real, Record


@dataclass(frozen=True, slots=True, kw_only=True)
class Fill:
    """Fill short gaps of channels.

    Parameters
    ----------
    longest : float
        s: a longer gap is refused, nobody knows what happened in it.
    channels : tuple of str, optional
        All by default.
    """

    longest: float
    channels: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if not self.longest > 0:
            raise ProcessingError(f"longest must be > 0 s, got {self.longest:g}", at=("longest",))

    def apply(self, record: Record) -> Record:
        """Return the record without gaps in the channels."""
        return record.changed({name: self._filled(record, name) for name in record.chosen(self.channels)})

    def _filled(self, record: Record, name: str) -> Real:
        values = record.values(name)
        there = np.flatnonzero(np.isfinite(values))
        if there.size in (0, values.size):
            if there.size == 0:
                raise ProcessingError(f"channel {name} must have samples to be filled, got none", at=("channels",))
            return values
        if there[0] > 0 or there[-1] < values.size - 1:
            msg = f"channel {name} must begin and end with samples to be filled: cut it first"
            raise ProcessingError(msg, at=("channels",))
        gap = float((np.diff(there).max() - 1) / record.rate)
        if gap > self.longest:
            raise ProcessingError(f"gaps of channel {name} must be <= {self.longest:g} s, got {gap:g}", at=("longest",))
        return np.interp(np.arange(values.size), there, values[there])
