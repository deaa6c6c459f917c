"""What a curve is at instants that are fixed, and over the intervals between them, while its pieces move with the delays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import DEGREE, differentiation_matrix, integration_matrix, weights

if TYPE_CHECKING:
    from engine.exact.time.curve import Curve
    from engine.model.linear_system import Array

Samples = npt.NDArray[np.float64]

_AT_ONCE = 4096
"""Stretches of a curve that are integrated at a time."""
_TOGETHER = 512
"""Instants of a curve that are read at a time; most of those of long pieces are of one piece, which needs one product."""


def values_at(curve: Curve, instants: Samples, *, after: float = 0.0) -> Array:
    """Return the curve at fixed instants that increase, shape (lanes, instants); what jumps within ``after`` (s) behind one has jumped."""
    return _read(curve.edges, curve.values, _piece(curve, instants + after), instants).T


def means(curve: Curve, h: float, count: int) -> Array:
    """Return the exact mean of the curve over each of the first ``count`` intervals of length h, shape (lanes, count)."""
    width = np.diff(curve.edges, axis=0)
    primitive = np.einsum("jl,klp->kjp", integration_matrix(), curve.values) * width[:, None, :]
    before = np.concatenate([np.zeros((1, width.shape[1])), np.cumsum(primitive[:, -1], axis=0)])
    ends: Samples = h * np.arange(count + 1, dtype=np.float64)
    piece = _piece(curve, ends)
    integral = before[piece] + _read(curve.edges, primitive, piece, ends)
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
        y = _read(curve.edges, curve.values, np.repeat(piece[k], nodes.size), t.reshape(-1, t.shape[2])).reshape(
            t.shape
        )
        y = y * (shares[:, None] * (width / h))
        phi = (ends[interval[k] + 1][:, None, None] - t) / h
        for i in range(rows):
            np.add.at(found, (interval[k], i), y.sum(axis=1))
            y *= phi
    return found.transpose(2, 1, 0)


def _piece(curve: Curve, instants: Samples) -> npt.NDArray[np.intp]:
    """Return the piece of each fixed instant."""
    edges = curve.times
    return np.clip(np.searchsorted(edges, instants, side="right") - 1, 0, len(edges) - 2)


def _read(edges: Array, values: Array, piece: npt.NDArray[np.intp], instants: Array) -> Array:
    """Return pieces at fixed instants that increase, (instants,) or lane by lane (instants, lanes), shape (instants, lanes)."""
    found = np.empty((len(instants), values.shape[2]), dtype=np.result_type(edges, values))
    slopes = differentiation_matrix() @ values
    for begin in range(0, len(instants), _TOGETHER):
        part = slice(begin, begin + _TOGETHER)
        k = piece[part]
        # pieces move with the delays: a fixed instant then lies elsewhere in its piece, lane by lane
        theta = (instants[part].reshape(k.size, -1) - edges[k]) / (edges[k + 1] - edges[k])
        inside = np.clip(theta[:, 0].real, 0.0, 1.0)
        basis, offset = weights(inside), theta - inside[:, None]
        if k[0] == k[-1]:
            found[part] = _product(basis, values[k[0]]) + offset * _product(basis, slopes[k[0]])
        else:
            found[part] = np.einsum("kj,kjp->kp", basis, values[k]) + offset * np.einsum("kj,kjp->kp", basis, slopes[k])
    return found


def _product(basis: Samples, values: Array) -> Array:
    """Return a product, real and infinitesimal parts apart: a real matrix need not become a complex one for it."""
    if not np.iscomplexobj(values):
        return np.asarray(basis @ values)
    return np.asarray(basis @ values.real + 1j * (basis @ values.imag))
