"""What a curve is at instants that are fixed, and over the intervals between them, while its pieces move with the delays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import DEGREE, NODES, differentiation_matrix, weights

if TYPE_CHECKING:
    from engine.exact.time.curve import Curve
    from engine.model.linear_system import Array

Samples = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

_AT_ONCE = 4096
"""Stretches of a curve that are integrated at a time."""
_TOGETHER = 512
"""Instants of a curve that are read at a time; most of those of long pieces are of one piece, which needs one product."""
_MANY = 24
"""Intervals within one piece from which on its moments are a polynomial of their own: 17 values of it, not a sum for each."""


def values_at(curve: Curve, instants: Samples, *, after: float = 0.0) -> Array:
    """Return the curve at fixed instants that increase, shape (lanes, instants); what jumps within ``after`` (s) behind one has jumped."""
    piece = np.clip(np.searchsorted(curve.times, instants + after, side="right") - 1, 0, len(curve.times) - 2)
    return _Pieces.of(curve).read(piece, instants).T


def moments(curve: Curve, h: float, count: int, rows: int) -> Array:
    """Return ∫_0^1 φ^i y((m + 1 - φ) h) dφ for i < rows, m < count, exact, shape (lanes, rows, count)."""
    starts: Samples = h * np.arange(count, dtype=np.float64)
    times, pieces = curve.times, _Pieces.of(curve)
    edges = 1 + np.flatnonzero(times[1:-1] < h * count)
    divided = np.searchsorted(starts, times[edges], side="right") - 1
    piece = np.clip(np.searchsorted(times, starts) - 1, 0, len(times) - 2)
    whole = np.ones(count, dtype=bool)
    whole[divided] = False
    many = np.bincount(piece[whole], minlength=len(times) - 1) >= _MANY
    whole &= many[piece]
    found = np.zeros((count, rows, curve.edges.shape[1]), dtype=curve.values.dtype)
    if many.any():
        place = np.cumsum(many)[piece[whole]] - 1
        read = _within(pieces, np.flatnonzero(many), h, rows).read(place, starts[whole])
        found[whole] = read.reshape(-1, *found.shape[1:])
    # all others between their ends and edges of pieces, in parts of an interval: those of each are 1 together, however late it is
    single = np.flatnonzero(~whole)
    interval = np.concatenate([single, divided])
    order = np.argsort(interval, kind="stable")
    interval, piece = interval[order], np.concatenate([piece[single], edges])[order]
    begin = np.zeros((interval.size, curve.edges.shape[1]), dtype=curve.edges.dtype)
    begin[order >= single.size] = (curve.edges[edges] - starts[divided, None]) / h
    end = np.ones_like(begin)
    goes_on = np.flatnonzero(interval[1:] == interval[:-1])
    end[goes_on] = begin[goes_on + 1]
    np.add.at(found, interval, _integrated(pieces, piece, starts[interval, None], begin, end, h=h, rows=rows))
    return found.transpose(2, 1, 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pieces:
    """Polynomials through ``values`` (pieces, N + 1, lanes) from ``begin`` on, each over its ``width`` (pieces, lanes)."""

    begin: Array
    width: Array
    values: Array

    @classmethod
    def of(cls, curve: Curve) -> _Pieces:
        return cls(begin=curve.edges[:-1], width=np.diff(curve.edges, axis=0), values=curve.values)

    def read(self, piece: Indices, instants: Array) -> Array:
        """Return pieces, which increase, at fixed instants (instants,) or lane by lane (instants, lanes), shape (instants, lanes)."""
        found = np.empty((len(instants), self.values.shape[2]), dtype=np.result_type(self.begin, self.values))
        slopes = differentiation_matrix() @ self.values
        for first in range(0, len(instants), _TOGETHER):
            part = slice(first, first + _TOGETHER)
            k = piece[part]
            # pieces move with the delays: a fixed instant then lies elsewhere in its piece, lane by lane
            theta = (instants[part].reshape(k.size, -1) - self.begin[k]) / self.width[k]
            inside = np.clip(theta[:, 0].real, 0.0, 1.0)
            basis, offset = weights(inside), theta - inside[:, None]
            if k[0] == k[-1]:
                value, slope = _product(basis, self.values[k[0]]), _product(basis, slopes[k[0]])
            else:
                value, slope = (np.einsum("kj,kjp->kp", basis, of[k]) for of in (self.values, slopes))
            found[part] = value + offset * slope
        return found


def _within(pieces: _Pieces, numbers: Indices, h: float, rows: int) -> _Pieces:
    """Return the moments of intervals within a piece by where they start, row by row beside each other: polynomials as well."""
    begin, width = pieces.begin[numbers], pieces.width[numbers] - h
    starts = (begin[:, None] + width[:, None] * NODES[:, None]).reshape(-1, begin.shape[1])
    zero = np.zeros((starts.shape[0], 1))
    found = _integrated(pieces, np.repeat(numbers, NODES.size), starts, zero, zero + 1, h=h, rows=rows)
    return _Pieces(
        begin=np.tile(begin, rows), width=np.tile(width, rows), values=found.reshape(len(numbers), NODES.size, -1)
    )


def _integrated(
    pieces: _Pieces, piece: Indices, starts: Array, begin: Array, end: Array, *, h: float, rows: int
) -> Array:
    """Return the moments of one piece each over parts of an interval from ``starts`` on, (stretches, rows, lanes)."""
    nodes, shares = np.polynomial.legendre.leggauss((DEGREE + rows) // 2 + 1)
    nodes, shares = (1 + nodes) / 2, shares / 2
    found = np.empty((len(piece), rows, pieces.begin.shape[1]), dtype=pieces.values.dtype)
    for first in range(0, len(piece), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        share = (end[part] - begin[part])[:, None]
        at = begin[part, None] + share * nodes[:, None]  # (stretches, nodes, lanes)
        t = starts[part, None] + h * at
        y = pieces.read(np.repeat(piece[part], nodes.size), t.reshape(-1, t.shape[2]))
        y = y.reshape(-1, nodes.size, y.shape[1]) * (shares[:, None] * share)
        for i in range(rows):
            found[part, i] = y.sum(axis=1)
            y *= 1 - at
    return found


def _product(basis: Samples, values: Array) -> Array:
    """Return a product, real and infinitesimal parts apart: a real matrix need not become a complex one for it."""
    if not np.iscomplexobj(values):
        return np.asarray(basis @ values)
    return np.asarray(basis @ values.real + 1j * (basis @ values.imag))
