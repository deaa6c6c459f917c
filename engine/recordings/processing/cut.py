"""A part of a recording.

y_n = x_{n+k},   k the first sample with t >= start, the last one with t <= end
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Record

_ROUNDING = 1e-6
"""Of a sample: 0.3 s at 10 samples/s is sample 3, although 0.3 * 10 is not 3."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """Keep the samples between two times, both ends included.

    Parameters
    ----------
    start, end : float, optional
        s from the first sample; the ends of the recording by default.
    """

    start: float | None = None
    end: float | None = None

    def __post_init__(self) -> None:
        start, end = self.start or 0.0, np.inf if self.end is None else self.end
        if not 0 <= start < end:
            raise ProcessingError(f"start and end must be 0 <= start < end s, got {start:g} and {end:g}", at=("start",))

    def span(self, samples: int, rate: float) -> tuple[int, int]:
        """Return the first sample that stays, and the first one after it that does not.

        Raises
        ------
        ProcessingError
            If nothing stays.
        """
        first = 0 if self.start is None else int(np.ceil(min(self.start * rate, samples) - _ROUNDING))
        stop = samples if self.end is None else int(np.floor(min(self.end * rate, samples) + _ROUNDING)) + 1
        stop = min(stop, samples)
        if first >= stop:
            msg = (
                f"start ... end must hold at least one of the samples 0 ... {(samples - 1) / rate:g} s, "
                f"got none from {self.start or 0:g} s"
            )
            raise ProcessingError(msg, at=("start",))
        return first, stop

    def apply(self, record: Record) -> Record:
        """Return the part."""
        first, stop = self.span(record.samples, record.rate)
        return replace(
            record,
            channels={name: values[first:stop].copy() for name, values in record.channels.items()},
            begin=record.begin + first / record.rate,
        )
