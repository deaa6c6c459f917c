"""Whether instants lie on an even axis, as far as their printing tells.

    t_i = a_k + b i + e_i   between two gaps,   b such that the band that holds all e is narrowest

Rounding, and cutting off, leave errors within a band as wide as the last printed digit. The line is followed in blocks of
a thousand instants, so that memory does not grow with the samples that matter.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

_BLOCK = 1024
_DIGITS = 12
_LOOKED_AT = 4096
_FEW = 64


def rounding(instants: Values) -> float:
    """Return to what some instants (n,) seem rounded, in their unit; 0 where they have all digits that they can have."""
    some = np.abs(instants[np.isfinite(instants)])
    if not some.any():
        return 0.0
    # a number of six digits is rounded the more the larger it is
    decade = 10.0 ** np.floor(np.log10(some.max()))
    largest = some[some >= decade]
    some = (largest if largest.size >= _FEW else some[some >= 0.1 * decade])[:_LOOKED_AT]
    for digits in range(_DIGITS + 1):
        scaled = some * 10.0**digits
        # a printed number is the nearest float64 to a multiple of the last digit
        if np.all(np.abs(scaled - np.rint(scaled)) <= 4.0 * np.spacing(scaled) + 1e-9):
            return float(10.0**-digits)
    single = some.astype(np.float32)
    return float(np.spacing(single.max())) if np.array_equal(single.astype(np.float64), some) else 0.0


@dataclass(slots=True)
class Evenness:
    """Follows instants piece by piece."""

    _slope: float = np.nan
    _first: float = 0.0
    _count: int = 0
    _segment: int = 0
    _blocks: list[npt.NDArray[np.float64]] = field(default_factory=list)

    def add(self, instants: Values, gaps: npt.NDArray[np.int64]) -> None:
        """Look at the next instants (n,), s; ``gaps`` are the places in them before which there is a gap."""
        if np.isnan(self._slope):
            self._first = float(instants[0])
            self._slope = _slope_of_longest(instants, gaps)
        number = np.arange(self._count, self._count + instants.size)
        off = instants - self._first - self._slope * number
        edges = np.unique(np.concatenate([np.arange(0, instants.size, _BLOCK), gaps]))
        segments = self._segment + np.searchsorted(gaps, edges, side="right")
        middle = self._count + 0.5 * (edges + np.append(edges[1:], instants.size) - 1)
        low, high = np.minimum.reduceat(off, edges), np.maximum.reduceat(off, edges)
        self._blocks.append(np.stack([segments.astype(np.float64), middle, low, high]))
        self._count += instants.size
        self._segment += gaps.size

    @property
    def broken(self) -> bool:
        """Whether there are gaps."""
        return self._segment > 0

    def jitter(self) -> float:
        """Return how far instants are off their line at most, s: half the width of the band that holds them."""
        if not self._blocks:
            return 0.0
        segment, middle, low, high = np.concatenate(self._blocks, axis=1)
        begins = np.flatnonzero(np.diff(segment, prepend=-1.0))
        ends = np.append(begins[1:], segment.size) - 1
        longest = int(np.argmax(middle[ends] - middle[begins]))
        first, last = begins[longest], ends[longest]
        slope = 0.0
        if last > first:
            part = slice(first, last + 1)
            slope = _narrowest(middle[part], low[part], high[part])
        width = np.maximum.reduceat(high - slope * middle, begins) - np.minimum.reduceat(low - slope * middle, begins)
        return 0.5 * float(width.max())


def _slope_of_longest(instants: Values, gaps: npt.NDArray[np.int64]) -> float:
    """Return the distance of the instants of the longest stretch without a gap."""
    edges = np.concatenate([[0], gaps, [instants.size]]).astype(np.int64)
    lengths = np.diff(edges)
    at = int(np.argmax(lengths))
    begin, end = int(edges[at]), int(edges[at + 1])
    if end - begin < 2:
        return float((instants[-1] - instants[0]) / max(instants.size - 1, 1))
    number, off = np.arange(end - begin, dtype=np.float64), instants[begin:end] - instants[begin]
    chord = float(off[-1] / number[-1])
    return chord + _narrowest(number, off - chord * number, off - chord * number)


def _narrowest(number: Values, low: Values, high: Values) -> float:
    """Return the slope of the narrowest band that holds low ... high (n,): its width is convex in the slope."""

    def width(slope: float) -> float:
        return float((high - slope * number).max() - (low - slope * number).min())

    # the ends of the narrowest band lie within the band of slope 0
    most = 2.0 * width(0.0) / float(number[-1] - number[0])
    left, right = -most, most
    for _ in range(60):
        a, b = left + (right - left) / 3.0, right - (right - left) / 3.0
        left, right = (left, b) if width(a) <= width(b) else (a, right)
    return 0.5 * (left + right)
