"""A continuous curve as polynomial pieces, so that a metric is found on the curve and never read off a sample grid.

    y(t) on [edge_k, edge_k+1] is the polynomial of degree 16 through its values at Chebyshev nodes

Values may carry infinitesimals (see :mod:`engine.model.tangent`): crossings, extrema and integrals then carry the
exact derivative by the implicit-function rule dt*/dp = -(∂y/∂p) / ẏ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import (
    DEGREE,
    NODES,
    coefficient_matrix,
    differentiation_matrix,
    integration_matrix,
    weights,
)
from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]

_STILL = 1e-14
"""A piece that varies by less than this part of the curve does not move: its turning points are rounding."""

_EQUAL = 1e-15
"""Heights that differ by less than this part of the curve are equal: a product of matrices rounds each piece in its own way."""

_SAME = 4e-16
"""Two places of a piece, of length 1, that are nearer than this are one."""

_MOST_AT_ONCE = 8192  # pieces whose scan fits a cache

_NEAR = 0.02
"""Part of a piece's size from which on a turning point may hide two roots."""

_SCAN = np.linspace(0.0, 1.0, 4 * DEGREE + 1)
_TO_SCAN = weights(_SCAN)


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Polynomial pieces side by side.

    Parameters
    ----------
    edges : ndarray, shape (pieces + 1, lanes)
        Ends of the pieces in s; real parts increase strictly.
    values : ndarray, shape (pieces, N + 1, lanes)
        Values at the nodes of each piece; neighbours may disagree at their common edge (a jump).
    """

    edges: Array
    values: Array

    @property
    def end(self) -> float:
        """Last instant of the curve, s."""
        return float(self.edges[-1, 0].real)

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """Real parts of the edges, shape (pieces + 1,)."""
        return np.asarray(self.edges[:, 0].real)

    def nodes(self) -> tuple[Real, Real]:
        """Return the instants (s) and real values of all nodes, one after the other; neighbours share their common edge."""
        edges = self.times
        times = edges[:-1, None] + NODES * np.diff(edges)[:, None]
        return times.ravel(), self.values[:, :, 0].real.ravel()

    @property
    def slope(self) -> Curve:
        """The derivative with respect to time, piece by piece (jumps are not counted)."""
        width = np.diff(self.edges, axis=0)
        return Curve(edges=self.edges, values=differentiation_matrix() @ self.values / width[:, None, :])

    def __add__(self, other: Array | float) -> Curve:
        return Curve(edges=self.edges, values=self.values + other)

    def __mul__(self, factor: Array | float) -> Curve:
        return Curve(edges=self.edges, values=self.values * factor)

    def minus(self, other: Curve) -> Curve:
        """Return the difference of two curves on the same pieces."""
        return Curve(edges=self.edges, values=self.values - other.values)

    def sample(self, times: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the real values at ``times`` (right-continuous; the last value is held beyond the end)."""
        edges = self.times
        piece = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
        theta = np.clip((times - edges[piece]) / (edges[piece + 1] - edges[piece]), 0.0, 1.0)
        nodes = self.values[:, :, 0].real
        inside = np.einsum("tj,tj->t", weights(theta), nodes[piece])
        # an edge is a node, a piece that stands still is its nodes: known without interpolation, a level is that level exactly
        first = (theta == 0.0) | (nodes == nodes[:, :1]).all(axis=1)[piece]
        return np.asarray(np.where(first, nodes[piece, 0], np.where(theta == 1.0, nodes[piece, -1], inside)))

    def at(self, piece: int, theta: float, time: float | None = None) -> Array:
        """Return the value in ``piece`` at the fixed real instant ``time`` (default: where ``theta`` lies), all lanes."""
        width = self.edges[piece + 1] - self.edges[piece]
        instant = self.times[piece] + theta * (self.times[piece + 1] - self.times[piece]) if time is None else time
        local = (instant - self.edges[piece]) / width
        return np.asarray(np.einsum("pj,jp->p", weights(local), self.values[piece]))

    def read(self, time: float) -> Array:
        """Return the value at the fixed real instant ``time``, all lanes."""
        return self.at(self._piece(time), 0.0, time)

    def crossings(self, level: Array, *, backwards: bool = False) -> Iterator[tuple[Array, int]]:
        """Yield every instant where the curve passes through ``level``, with the piece it lies in.

        Parameters
        ----------
        level : ndarray, shape (lanes,) or ()
        backwards : bool
            From the last to the first.

        Yields
        ------
        (ndarray of shape (lanes,), int)
            The instants carry their derivatives. A jump across the level counts, at its edge.
        """
        base = float(np.ravel(level)[0].real)
        nodes = self.values[:, :, 0].real - base
        low, high = nodes.min(axis=1), nodes.max(axis=1)
        margin = 0.5 * (high - low)  # between its nodes the polynomial may leave their range a little
        near = (low - margin <= 0) & (high + margin >= 0)
        jumps = np.zeros(len(nodes), dtype=bool)
        jumps[1:] = (nodes[:-1, -1] < 0) != (nodes[1:, 0] < 0)
        order = np.flatnonzero(near | jumps)
        for k in order[::-1] if backwards else order:
            inside = [self._instant(int(k), theta, level) for theta in _roots(nodes[k])] if near[k] else []
            found = ([self.edges[k] + 0.0] if jumps[k] else []) + inside
            yield from ((instant, int(k)) for instant in (reversed(found) if backwards else found))

    def _instant(self, piece: int, theta: float, level: Array) -> Array:
        """Return the root near ``theta`` as an instant that carries its derivatives (one Newton step in the lanes)."""
        width = self.edges[piece + 1] - self.edges[piece]
        w = weights(np.asarray(theta))
        here = w @ self.values[piece]
        slope = (w @ differentiation_matrix()) @ self.values[piece]
        residual = here - level
        correction = np.where(slope[0].real != 0, residual / np.where(slope == 0, 1, slope), 0.0)
        # the real correction is rounding only: keep the root inside its piece
        instant = self.edges[piece] + width * (theta - correction)
        return np.asarray(instant)

    def largest(self) -> tuple[Array, float]:
        """Return (value, instant) of the greatest value; of the earliest among equals."""
        return self._best(self.values[:, :, 0].real)

    def smallest(self) -> tuple[Array, float]:
        """Return (value, instant) of the least value."""
        value, instant = (self * -1.0).largest()
        return -value, instant

    def turning(self, time: float) -> Array:
        """Return the stationary instant at ``time`` with its derivatives, dt/dp = -(∂ẏ/∂p) / ÿ; an edge moves as it does."""
        k = self._piece(time)
        for piece in (k, min(k + 1, len(self.values) - 1)):
            for side in (piece, piece + 1):
                if abs(time - self.times[side]) <= 1e-13 * max(abs(time), 1e-300):
                    return np.asarray(self.edges[side])
        width = self.edges[k + 1] - self.edges[k]
        theta = (time - self.times[k]) / (self.times[k + 1] - self.times[k])
        d = differentiation_matrix()
        w = weights((time - self.edges[k]) / width)  # (lanes, N + 1)
        slope = np.einsum("pj,jp->p", w @ d, self.values[k]) / width
        bend = float((weights(np.asarray(theta)) @ d @ d @ self.values[k, :, 0].real) / width[0].real ** 2)
        return (
            np.asarray(time - 1j * slope.imag / bend) if np.iscomplexobj(slope) and bend else np.full(len(width), time)
        )

    def _best(self, nodes: npt.NDArray[np.float64]) -> tuple[Array, float]:
        top, spread = nodes.max(axis=1), np.ptp(nodes, axis=1)
        scale = max(float(np.abs(nodes).max()), 1e-300)
        candidates = np.flatnonzero(top + 0.5 * spread >= top.max())
        top = (nodes[candidates] @ _TO_SCAN.T).max(axis=1)
        candidates = candidates[top + _NEAR * spread[candidates] >= top.max() - _EQUAL * scale]
        moving = candidates[spread[candidates] > _STILL * scale]
        row, theta = roots(nodes[moving] @ differentiation_matrix().T)
        inside = _clenshaw(nodes[moving[row]] @ coefficient_matrix().T, theta)
        piece = np.concatenate([candidates, moving[row], candidates])
        place = np.concatenate([np.zeros(len(candidates)), theta, np.ones(len(candidates))])
        heights = np.concatenate([nodes[candidates, 0], inside, nodes[candidates, -1]])
        order = np.lexsort((place, piece))
        # the earliest among equals: two that differ by rounding are equal
        first = order[np.argmax(heights[order] >= heights.max() - _EQUAL * scale)]
        k, th, edges = int(piece[first]), float(place[first]), self.times
        if spread[k] <= _STILL * scale:  # it has come there at the first of the pieces that do not move
            th = 0.0
            while k > 0 and max(spread[k - 1], abs(nodes[k - 1, -1] - nodes[k, 0])) <= _STILL * scale:
                k -= 1
        if th in {0.0, 1.0}:
            side = round(th)
            return self.values[k, -side], float(edges[k + side])
        return self.at(k, th), float(edges[k] + th * (edges[k + 1] - edges[k]))

    def turnings(self, least: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return (instants, real values) at which the curve turns back, in no order.

        Only pieces are looked at of which a node has the magnitude ``least``: take a tenth less than what is looked for.
        """
        nodes, times = self.values[:, :, 0].real, self.times
        slopes = nodes @ differentiation_matrix().T
        loud = np.flatnonzero(np.abs(nodes).max(axis=1) >= least)
        row, theta = roots(slopes[loud])
        piece = loud[row]
        found = _clenshaw(nodes[piece] @ coefficient_matrix().T, theta)
        kinks = np.flatnonzero(slopes[:-1, -1] * slopes[1:, 0] <= 0) + 1
        instants = times[piece] + theta * (times[piece + 1] - times[piece])
        return np.concatenate([instants, times[kinks]]), np.concatenate([found, nodes[kinks, 0]])

    def integral(self) -> Array:
        """Return the integral over the whole curve, shape (lanes,)."""
        width = np.diff(self.edges, axis=0)
        return np.asarray(np.einsum("j,kjp,kp->p", integration_matrix()[-1], self.values, width))

    def until(self, time: float) -> Curve:
        """Return the part before the fixed instant ``time``."""
        if time >= self.end:
            return self
        k = self._piece(time)
        last = np.full((1, self.edges.shape[1]), time, dtype=self.edges.dtype)
        part = self._part(k, self.edges[k], last[0])
        return Curve(
            edges=np.concatenate([self.edges[: k + 1], last]), values=np.concatenate([self.values[:k], part[None]])
        )

    def held(self, time: float, value: Array) -> Curve:
        """Return the curve up to the fixed instant ``time``, at ``value`` (lanes,) beyond its own end."""
        if time <= self.end:
            return self.until(time)
        last = np.full((1, self.edges.shape[1]), time, dtype=self.edges.dtype)
        still = np.broadcast_to(value, (1, *self.values.shape[1:]))
        return Curve(edges=np.concatenate([self.edges, last]), values=np.concatenate([self.values, still]))

    def since(self, time: float) -> Curve:
        """Return the part after the fixed instant ``time``."""
        if time <= self.times[0]:
            return self
        k = self._piece(np.nextafter(time, np.inf))
        first = np.full((1, self.edges.shape[1]), time, dtype=self.edges.dtype)
        part = self._part(k, first[0], self.edges[k + 1])
        return Curve(
            edges=np.concatenate([first, self.edges[k + 1 :]]),
            values=np.concatenate([part[None], self.values[k + 1 :]]),
        )

    def _piece(self, time: float) -> int:
        return int(np.clip(np.searchsorted(self.times, time, side="left") - 1, 0, len(self.values) - 1))

    def _part(self, piece: int, start: Array, end: Array) -> Array:
        """Return node values of the piece between two instants, shape (N + 1, lanes)."""
        width = self.edges[piece + 1] - self.edges[piece]
        theta = (start + NODES[:, None] * (end - start) - self.edges[piece]) / width
        return np.asarray(np.einsum("jpl,lp->jp", weights(theta), self.values[piece]))

    def absolute(self) -> Curve:
        """Return |y| with an edge at every change of sign, so that it stays polynomial on each piece."""
        nodes = self.values[:, :, 0].real
        mixed = (nodes.min(axis=1) < 0) & (nodes.max(axis=1) > 0)
        mixed &= np.abs(nodes).max(axis=1) > _STILL * np.abs(nodes).max()
        candidates = np.flatnonzero(mixed)
        row, theta = roots(nodes[candidates])
        inside = (theta > 0) & (theta < 1)
        # every part of a piece from one change of sign to the next; the moving cut contributes nothing to first order
        # because the curve is zero there
        piece = np.concatenate([np.arange(len(nodes)), candidates[row[inside]]])
        start = np.concatenate([np.zeros(len(nodes)), theta[inside]])
        order = np.lexsort((start, piece))
        piece, start = piece[order], start[order]
        end = np.append(np.where(piece[1:] == piece[:-1], start[1:], 1.0), 1.0)
        width = np.diff(self.edges, axis=0)
        edges = np.concatenate([self.edges[piece] + start[:, None] * width[piece], self.edges[-1:]])
        values = self.values[piece]
        whole = (start == 0) & (end == 1)
        cut = np.flatnonzero(~whole)
        series = np.einsum("cl,klp->ckp", coefficient_matrix(), values[cut])
        place = 2 * (start[cut, None] + NODES * (end - start)[cut, None]) - 1
        values[cut] = np.polynomial.chebyshev.chebval(place[:, :, None], series[:, :, None, :], tensor=False)
        signs = np.where(values[:, :, 0].real.sum(axis=1) < 0, -1.0, 1.0)
        return Curve(edges=edges, values=signs[:, None, None] * values)

    def squared(self) -> Curve:
        """Return y² with each piece halved, so that degree 16 holds it again."""
        return self._halved(lambda v, _t: v * v)

    def times_time(self) -> Curve:
        """Return t y(t) with each piece halved, so that degree 16 holds it again."""
        return self._halved(lambda v, t: v * t)

    def _halved(self, function: Callable[[Array, Array], Array]) -> Curve:
        k, _, lanes = self.values.shape
        width = np.diff(self.edges, axis=0)
        edges = np.empty((2 * k + 1, lanes), dtype=self.edges.dtype)
        edges[0::2] = self.edges
        edges[1::2] = self.edges[:-1] + width / 2
        values = np.empty((2 * k, DEGREE + 1, lanes), dtype=np.result_type(self.values, self.edges))
        for half in (0, 1):
            part = weights((NODES + half) / 2) @ self.values
            start = self.edges[:-1] + half * width / 2
            time = start[:, None, :] + NODES[None, :, None] * (width / 2)[:, None, :]
            values[half::2] = function(part, time)
        return Curve(edges=edges, values=values)


def _clenshaw(coefficients: npt.NDArray[np.floating[Any]], theta: Real) -> Real:
    """Return Chebyshev series, one for each row, at one θ in [0, 1] each."""
    return np.asarray(np.polynomial.chebyshev.chebval(2 * theta - 1, coefficients.T, tensor=False))


def _polished(coefficients: npt.NDArray[np.floating[Any]], a: Real, b: Real) -> Real:
    """Return the roots of Chebyshev series inside their brackets [a, b] of [0, 1], by Newton kept in the bracket.

    A root at an end may have no change of sign, by rounding: then it is the end at which the series is nearer to 0.
    """
    derivatives = 2 * np.polynomial.chebyshev.chebder(coefficients, axis=1)
    fa, fb = _clenshaw(coefficients, a), _clenshaw(coefficients, b)
    with np.errstate(divide="ignore", invalid="ignore"):
        theta = np.where(fa != fb, a + (b - a) * fa / (fa - fb), 0.5 * (a + b))
    below = fa < 0
    bracketed = below != (fb < 0)
    theta = np.where(bracketed, theta, np.where(np.abs(fa) <= np.abs(fb), a, b))
    a, b = a.copy(), b.copy()
    active = np.flatnonzero(bracketed)
    for _ in range(60):
        if not len(active):
            break
        at = theta[active]
        f = _clenshaw(coefficients[active], at)
        left = (f < 0) == below[active]
        a[active] = np.where(left, at, a[active])
        b[active] = np.where(left, b[active], at)
        slope = _clenshaw(derivatives[active], at)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            new = at - f / slope
        middle = 0.5 * (a[active] + b[active])
        new = np.where((new >= a[active]) & (new <= b[active]), new, middle)
        theta[active] = np.where(f == 0, at, new)
        active = active[(f != 0) & (np.abs(new - at) > _SAME)]
    return theta


def roots(nodes: Real) -> tuple[npt.NDArray[np.intp], Real]:
    """Return the real roots in [0, 1] of the polynomials through ``nodes``.

    A polynomial is scanned four times finer than its nodes; a root is polished by Newton inside its bracket. Where the
    scan comes near zero and turns back, the stationary point itself is looked at, so that a pair of close roots between
    two scan points is not lost.

    Parameters
    ----------
    nodes : ndarray, shape (pieces, N + 1)

    Returns
    -------
    (ndarray of int, ndarray), shapes (roots,)
        Piece and θ, in the order of time.
    """
    if len(nodes) > _MOST_AT_ONCE:
        starts = range(0, len(nodes), _MOST_AT_ONCE)
        parts = [roots(nodes[k : k + _MOST_AT_ONCE]) for k in starts]
        rows = [row + k for k, (row, _) in zip(starts, parts, strict=True)]
        return np.concatenate(rows), np.concatenate([theta for _, theta in parts])
    scan = nodes @ _TO_SCAN.T
    negative = scan < 0
    changes = negative[:, :-1] != negative[:, 1:]
    size = np.abs(scan)
    turning = (size[:, 1:-1] < size[:, :-2]) & (size[:, 1:-1] <= size[:, 2:]) & ~changes[:, :-1] & ~changes[:, 1:]
    turning &= size[:, 1:-1] < _NEAR * size.max(axis=1, keepdims=True)
    row, k = np.nonzero(changes)
    a, b = _SCAN[k], _SCAN[k + 1]
    touching, t = np.nonzero(turning)
    if len(touching):
        series = nodes[touching] @ coefficient_matrix().T
        low, high = _SCAN[t], _SCAN[t + 2]
        top = _polished(np.polynomial.chebyshev.chebder(series, axis=1), low, high)
        twice = (_clenshaw(series, top) < 0) != negative[touching, t + 1]
        row = np.concatenate([row, touching[twice], touching[twice]])
        a, b = np.concatenate([a, low[twice], top[twice]]), np.concatenate([b, top[twice], high[twice]])
    if not len(row):
        return row, np.zeros(0)
    theta = _polished(nodes[row] @ coefficient_matrix().T, a, b)
    order = np.lexsort((theta, row))
    return row[order], theta[order]


def _roots(nodes: Real) -> list[float]:
    """Return the roots of one polynomial, in order."""
    return [float(theta) for theta in roots(nodes[None])[1]]
