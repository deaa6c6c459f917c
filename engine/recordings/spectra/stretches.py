"""Samples that are looked at one stretch at a time: an array, or a recording that is read as it is needed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from engine.exact.frequency.fourier import Real

_AT_ONCE = 1 << 19
"""Samples of a stretch: 4 MB."""


class Samples(Protocol):
    """Samples in order."""

    @property
    def size(self) -> int:
        """How many there are."""

    def __getitem__(self, span: slice, /) -> Real:
        """Return those of a span without a step."""


def stretches(values: Samples) -> Iterator[tuple[int, Real]]:
    """Yield the number of the first sample of a stretch, and the stretch, one after the other."""
    for start in range(0, values.size, _AT_ONCE):
        yield start, values[start : start + _AT_ONCE]


def extremes(values: Samples) -> tuple[float, float]:
    """Return the lowest and the highest of at least one sample."""
    ends = [(float(part.min()), float(part.max())) for _, part in stretches(values)]
    return min(low for low, _ in ends), max(high for _, high in ends)
