"""When the samples of a recording were taken: n / rate, or the instants that its first channel holds."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from api.convert.recordings import Values
from api.problems.documents import invalid
from storage.models import Dataset, DatasetStatus
from storage.repositories import DatasetRepository

_READ_TOGETHER = 4_000_000
"""Instants that are read to find some of them."""


def uneven(row: Dataset) -> bool:
    """Say whether the samples of a recording are at uneven instants, which are its first channel."""
    return row.status == DatasetStatus.READY and row.sample_rate is None and bool(row.channels)


def even_rate(row: Dataset, *place: str | int, what: str = "dataset") -> float:
    """Return the samples per second of a recording that must have a rate.

    Raises
    ------
    Problem
        422 with the place, and the remedy, where its instants are uneven.
    """
    if row.sample_rate is None:
        remedy = 'a processing whose first step is {"kind": "resample", "rate": ...} makes an even one of it'
        raise invalid(f"{what} must have a sample_rate, {row.id!r} has uneven instants: {remedy}", *place)
    return row.sample_rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Instants:
    """The instants of a recording that is ready, s from the first sample."""

    repository: DatasetRepository
    row: Dataset

    def at(self, first: int, stop: int) -> Values:
        """Return those of the samples first <= i < stop."""
        if self.row.sample_rate is not None:
            return np.arange(first, stop) / self.row.sample_rate
        return self.repository.read_channel(self.row.id, str(self.row.channels[0]["name"]), first, stop)

    def of(self, samples: npt.NDArray[np.int64]) -> Values:
        """Return those of some samples (n,) by their numbers, which rise."""
        if self.row.sample_rate is not None:
            return np.asarray(samples / self.row.sample_rate, dtype=np.float64)
        if not samples.size:
            return np.empty(0)
        first, last = int(samples[0]), int(samples[-1])
        if last - first < _READ_TOGETHER:
            return self.at(first, last + 1)[samples - first]
        return np.array([self._of_one(int(sample)) for sample in samples])

    def stretch(self, start: float | None, end: float | None) -> tuple[int, int]:
        """Return the samples first <= i < stop whose times lie in start ... end (s).

        Raises
        ------
        Problem
            422 where there are none.
        """
        count, rate = self.row.sample_count, self.row.sample_rate
        assert count is not None
        if rate is not None:
            first = 0 if start is None else int(np.ceil(min(max(start * rate, 0.0), count) - 1e-9))
            stop = count if end is None else int(np.floor(min(max(end * rate, -1.0), count - 1) + 1e-9)) + 1
        else:
            first = 0 if start is None else bisect_left(range(count), start, key=self._of_one)
            stop = count if end is None else bisect_right(range(count), end, key=self._of_one)
        if first >= stop:
            last = (count - 1) / rate if rate is not None else self._of_one(count - 1)
            raise invalid(f"start ... end must hold at least one of the samples 0 ... {last:g} s, got none")
        return first, stop

    def _of_one(self, sample: int) -> float:
        return float(self.at(sample, sample + 1)[0])
