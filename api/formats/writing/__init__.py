"""How recordings leave as files: one module for each format, calibrated samples in, pieces of bytes out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from api.formats import Values

PIECE = 1 << 17
"""Numbers that are in memory at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Column:
    """A channel of the file."""

    name: str
    unit: str = ""
    quantity: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outgoing:
    """A stretch of a recording.

    Parameters
    ----------
    name : str
        Of the recording.
    columns : sequence of Column
    sample_rate : float, optional
        Samples per second, None where the instants are uneven.
    instants : callable
        Gives those of the samples start <= i < stop (start, stop), s from the beginning of the recording.
    start_time : str
        When the recording began, RFC 3339, "" where that is not known.
    count : int
        Samples of each channel.
    read : callable
        Gives the samples start <= i < stop of a channel (channel, start, stop).
    """

    name: str
    columns: Sequence[Column]
    sample_rate: float | None
    instants: Callable[[int, int], Values]
    start_time: str
    count: int
    read: Callable[[int, int, int], Values]

    def rows(self) -> Iterator[tuple[int, int]]:
        """Yield start and stop of stretches of which all channels fit into memory."""
        step = max(PIECE // max(len(self.columns), 1), 1024)
        for start in range(0, self.count, step):
            yield start, min(start + step, self.count)

    def labels(self) -> list[str]:
        """Return "name [unit]" of each channel."""
        return [f"{column.name} [{column.unit}]" if column.unit else column.name for column in self.columns]
