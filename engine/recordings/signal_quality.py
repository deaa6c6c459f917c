"""What is noticed in the samples of a channel while they pass: missing ones, saturation, a signal that never moves.

A channel counts as clipped where it stays at its extreme for three samples or more and arrives there steeply: by more
than four of its smallest steps, and at a good part of its usual speed. A rounded peak of a coarse converter arrives by
single steps, a position that settles arrives slowly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.float64]

_RUN = 3
_STEEP = 4.0
_SPEED = 0.3
_FEW = 16
_MOST_STRETCHES = 20
_PIECE = 1 << 14
"""Samples that are looked at together: as many as stay in the nearest memory."""
_LARGEST = float(np.finfo(np.float64).max)


def _length(steps: Values) -> float:
    """Return the root of the sum of squares, which exists also where the squares would be beyond all numbers.

    Not by a product of vectors: that goes through BLAS, whose threads cost more than so few numbers are worth.
    """
    largest = float(steps.max())
    return largest * math.sqrt(float(np.square(steps / largest).sum()))


@dataclass(slots=True)
class _End:
    """How often, and how, a channel stays at its largest (sign 1) or smallest (-1) value."""

    sign: float
    extreme: float = -np.inf
    samples: int = 0
    stretches: int = 0
    steep: float = 0.0
    pending: int = 0  # samples of a stretch that may go on in the next piece
    entry: float = 0.0

    def add(self, values: Values, before: float) -> None:
        signed = self.sign * values
        with np.errstate(invalid="ignore"):
            top = float(np.fmax.reduce(signed))
        if np.isnan(top) or top < self.extreme:
            self._end()
            return
        if top > self.extreme:
            self.extreme, self.samples, self.stretches, self.steep, self.pending = top, 0, 0, 0.0, 0
        at = np.concatenate([[False], signed == self.extreme, [False]])
        edges = np.flatnonzero(at[1:] != at[:-1]).reshape(-1, 2)
        # a stretch that began in the piece before goes on only at the first sample
        if self.pending and (not edges.size or edges[0, 0] > 0):
            self._end()
        for begin, stop in _long(edges, signed.size, continued=self.pending > 0):
            if not (begin == 0 and self.pending):
                self.entry = self.extreme - (float(signed[begin - 1]) if begin else self.sign * before)
            self.pending += stop - begin
            if stop < signed.size:
                self._end()

    def _end(self) -> None:
        if self.pending >= _RUN:
            self.samples += self.pending
            self.stretches += 1
            if np.isfinite(self.entry):
                self.steep = max(self.steep, self.entry)
        self.pending = 0

    def found(self, steep: float) -> dict[str, Any] | None:
        self._end()
        if not self.stretches or not self.steep > steep:
            return None
        return {"value": self.sign * self.extreme, "samples": self.samples, "stretches": self.stretches}


def _long(edges: npt.NDArray[np.int64], size: int, *, continued: bool) -> list[tuple[int, int]]:
    """Return the stretches that are long enough, or touch the ends of the piece and may be."""
    keep = (edges[:, 1] - edges[:, 0] >= _RUN) | (edges[:, 1] == size)
    if continued:
        keep |= edges[:, 0] == 0
    return [(int(begin), int(stop)) for begin, stop in edges[keep]]


@dataclass(slots=True)
class ChannelQuality:
    """Looks at one channel piece by piece."""

    count: int = 0
    missing: int = 0
    stretches: list[list[int]] = field(default_factory=list)
    _last: float = np.nan
    _step: float = np.inf
    _path: float = 0.0  # root of the sum of all squared steps
    _moves: int = 0
    _high: _End = field(default_factory=lambda: _End(1.0))
    _low: _End = field(default_factory=lambda: _End(-1.0))
    _distinct: set[float] = field(default_factory=set)

    def add(self, values: Values) -> None:
        """Look at the next samples (n,)."""
        for start in range(0, values.size, _PIECE):
            self._add(values[start : start + _PIECE])

    def _add(self, values: Values) -> None:
        gone = np.isnan(values)
        if gone.any():
            self._note_missing(gone)
        with np.errstate(over="ignore", invalid="ignore"):
            steps = np.minimum(np.abs(np.diff(values, prepend=self._last)), _LARGEST)
        moved = steps[steps > 0.0]
        if moved.size:
            self._step = min(self._step, float(moved.min()))
            self._path = math.hypot(self._path, _length(moved))
            self._moves += moved.size
        if len(self._distinct) <= _FEW:
            self._distinct.update(np.unique(values[~gone])[: _FEW + 1].tolist())
        self._high.add(values, self._last)
        self._low.add(values, self._last)
        self.count += values.size
        self._last = float(values[-1])

    def _note_missing(self, gone: npt.NDArray[np.bool_]) -> None:
        self.missing += int(gone.sum())
        edges = np.flatnonzero(np.diff(np.concatenate([[False], gone, [False]]))).reshape(-1, 2) + self.count
        for begin, stop in edges[:_MOST_STRETCHES].tolist():
            if self.stretches and self.stretches[-1][1] == begin:
                self.stretches[-1][1] = stop
            elif len(self.stretches) < _MOST_STRETCHES:
                self.stretches.append([begin, stop])

    @property
    def constant(self) -> bool:
        """Whether all samples that are there are equal."""
        return len(self._distinct) == 1

    def document(self) -> dict[str, Any]:
        """Return what was noticed.

        ``missing_stretches`` are the first 20 of [begin, end) in samples. A signal of few values (a switch, a held
        command) stays at its extremes by nature: it is not searched for clipping.
        """
        clipped = {}
        if len(self._distinct) > _FEW:
            steep = max(_STEEP * self._step, _SPEED * (self._path / self._moves**0.5))
            for name, end in (("high", self._high), ("low", self._low)):
                found = end.found(steep)
                if found:
                    clipped[name] = found
        there = np.isfinite(self._high.extreme)
        return {
            "minimum": -self._low.extreme if there else None,
            "maximum": self._high.extreme if there else None,
            "missing": self.missing,
            "missing_stretches": self.stretches,
            "constant": self.constant,
            "clipped": clipped,
        }


def remarks(name: str, found: dict[str, Any], count: int, *, rounded: int = 0) -> list[str]:
    """Return sentences on what was noticed in a channel of ``count`` samples, ``rounded`` of which float64 does not hold."""
    said = []
    if found["missing"]:
        said.append(f"{name} has {found['missing']} missing samples of {count}")
    if rounded:
        said.append(said_of_rounded(name, rounded, count))
    if found["constant"] and rounded:
        said.append(f"{name} never changes once its values are rounded: nothing tells whether those in the file do")
    elif found["constant"]:
        said.append(f"{name} never changes: is its sensor connected?")
    said += [
        f"{name} may be clipped: it stays at {clip['value']:.6g} for {clip['samples']} samples "
        f"in {clip['stretches']} stretch{'es' if clip['stretches'] > 1 else ''}"
        for clip in found["clipped"].values()
    ]
    return said


def said_of_rounded(name: str, rounded: int, count: int) -> str:
    """Return the sentence on values that float64 does not hold."""
    return (
        f"{name}: {rounded} of {count} values are rounded, float64 holds whole numbers up to 2^53 = {2**53} and 53 bits of "
        "larger ones: the file has them exactly"
    )
