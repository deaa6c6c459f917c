"""What a curve is at instants that are fixed, and over the intervals between them, while its pieces move with the delays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import DEGREE, integration_matrix, weights

if TYPE_CHECKING:
    from engine.exact.time.curve import Curve
    from engine.model.linear_system import Array

Samples = npt.NDArray[np.float64]

_AT_ONCE = 4096
"""Stretches of a curve that are integrated at a time."""


def values_at(curve: Curve, instants: Samples, *, after: float = 0.0) -> Array:
    """Return the curve at fixed instants, shape (lanes, instants); what jumps within ``after`` (s) behind one has jumped."""
    piece, w = _located(curve, instants, after)
    return np.asarray(np.einsum("kpj,kjp->pk", w, curve.values[piece]))


def means(curve: Curve, h: float, count: int) -> Array:
    """Return the exact mean of the curve over each of the first ``count`` intervals of length h, shape (lanes, count)."""
    width = np.diff(curve.edges, axis=0)
    primitive = np.einsum("jl,klp->kjp", integration_matrix(), curve.values) * width[:, None, :]
    before = np.concatenate([np.zeros((1, width.shape[1])), np.cumsum(primitive[:, -1], axis=0)])
    ends: Samples = h * np.arange(count + 1, dtype=np.float64)
    piece, w = _located(curve, ends)
    integral = before[piece] + np.einsum("kpj,kjp->kp", w, primitive[piece])
    return np.asarray(np.diff(integral, axis=0).T / h)


def moments(curve: Curve, h: float, count: int, rows: int) -> Array:
    """Return ∫_0^1 φ^i y((m + 1 - φ) h) dφ for i < rows, m < count, exact, shape (lanes, rows, count)."""
    ends: Samples = h * np.arange(count + 1, dtype=np.float64)
    times = curve.times
    # stretches between samples and edges of pieces; an edge keeps its infinitesimals
    cuts = np.concatenate([ends, times[(times > 0) & (times < ends[-1])]])
    moving = np.concatenate([
        np.broadcast_to(ends[:, None], (ends.size, curve.edges.shape[1])),
        curve.edges[(times > 0) & (times < ends[-1])],
    ])  # fmt: skip
    order = np.argsort(cuts, kind="stable")
    cuts, moving = cuts[order], moving[order]
    middle = (cuts[:-1] + cuts[1:]) / 2
    wide = np.flatnonzero(np.diff(cuts) > 0)
    interval = np.clip(np.searchsorted(ends, middle, side="right") - 1, 0, count - 1)
    piece = np.clip(np.searchsorted(times, middle, side="right") - 1, 0, len(times) - 2)
    nodes, shares = np.polynomial.legendre.leggauss((DEGREE + rows) // 2 + 1)
    nodes, shares = (1 + nodes) / 2, shares / 2
    found = np.zeros((count, rows, curve.edges.shape[1]), dtype=curve.values.dtype)
    for first in range(0, wide.size, _AT_ONCE):
        k = wide[first : first + _AT_ONCE]
        begin, width = moving[k][:, None], (moving[k + 1] - moving[k])[:, None]
        t = begin + width * nodes[:, None]  # (stretches, nodes, lanes)
        start, end = curve.edges[piece[k]][:, None], curve.edges[piece[k] + 1][:, None]
        y = np.einsum("kqpj,kjp->kqp", weights((t - start) / (end - start)), curve.values[piece[k]])
        y = y * shares[:, None] * width / h
        phi = (ends[interval[k] + 1][:, None, None] - t) / h
        for i in range(rows):
            np.add.at(found, (interval[k], i), (y * phi**i).sum(axis=1))
    return found.transpose(2, 1, 0)


def _located(curve: Curve, instants: Samples, after: float = 0.0) -> tuple[npt.NDArray[np.intp], Array]:
    """Return the piece of each fixed instant and the interpolation weights there, shapes (k,) and (k, lanes, N + 1)."""
    edges = curve.times
    piece = np.clip(np.searchsorted(edges, instants + after, side="right") - 1, 0, len(edges) - 2)
    start = curve.edges[piece]
    # pieces move with the delays: a fixed instant then lies elsewhere in its piece, lane by lane
    theta = (instants[:, None] - start) / (curve.edges[piece + 1] - start)
    return piece, weights(theta)
