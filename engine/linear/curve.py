"""A continuous curve as polynomial pieces, so that a metric is found on the curve and never read off a sample grid.

    y(t) on [edge_k, edge_k+1] is the polynomial of degree 16 through its values at Chebyshev nodes

Values may carry infinitesimals (see :mod:`engine.linear.tangent`): crossings, extrema and integrals then carry the
exact derivative by the implicit-function rule dt*/dp = -(∂y/∂p) / ẏ.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.linear.chebyshev import (
    DEGREE,
    NODES,
    coefficient_matrix,
    differentiation_matrix,
    integration_matrix,
    weights,
)
from engine.linear.system import Array

_STILL = 1e-14
"""A piece that varies by less than this part of the curve does not move: its turning points are rounding."""

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

    @property
    def slope(self) -> Curve:
        """The derivative with respect to time, piece by piece (jumps are not counted)."""
        width = np.diff(self.edges, axis=0)
        return Curve(
            edges=self.edges, values=np.einsum("jl,klp->kjp", differentiation_matrix(), self.values) / width[:, None, :]
        )

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
        # an edge is a node: its value is known without interpolation, a zero there is 0.0
        return np.asarray(np.where(theta == 0.0, nodes[piece, 0], np.where(theta == 1.0, nodes[piece, -1], inside)))

    def at(self, piece: int, theta: float, time: float | None = None) -> Array:
        """Return the value in ``piece`` at the fixed real instant ``time`` (default: where ``theta`` lies), all lanes."""
        width = self.edges[piece + 1] - self.edges[piece]
        instant = self.times[piece] + theta * (self.times[piece + 1] - self.times[piece]) if time is None else time
        local = (instant - self.edges[piece]) / width
        return np.asarray(np.einsum("pj,jp->p", weights(local), self.values[piece]))

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
        top = nodes.max(axis=1)
        spread = top - nodes.min(axis=1)
        candidates = np.flatnonzero(top + 0.5 * spread >= top.max())
        edges = self.times
        best: tuple[Array, float] | None = None
        scale = max(float(np.abs(nodes).max()), 1e-300)
        for k in candidates:
            points = [(self.values[k, 0], float(edges[k]))]
            if spread[k] > _STILL * scale:
                inside = _roots(differentiation_matrix() @ nodes[k])
                points += [(self.at(int(k), th), float(edges[k] + th * (edges[k + 1] - edges[k]))) for th in inside]
            points += [(self.values[k, -1], float(edges[k + 1]))]
            for value, instant in points:
                if best is None or value[0].real > best[0][0].real + 1e-15 * scale:
                    best = (value, instant)
        assert best is not None  # a curve has at least one piece
        return best

    def turning_values(self, least: float) -> npt.NDArray[np.float64]:
        """Return the real values, of magnitude ``least`` or more, at which the curve turns back."""
        nodes = self.values[:, :, 0].real
        slopes = nodes @ differentiation_matrix().T
        loud = np.flatnonzero(np.abs(nodes).max(axis=1) >= least)
        found = [float(self.at(int(k), theta)[0].real) for k in loud for theta in _roots(slopes[k])]
        kinks = np.flatnonzero(slopes[:-1, -1] * slopes[1:, 0] <= 0)
        return np.array([*found, *nodes[kinks + 1, 0]])

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
        edges, values = self.edges, self.values
        signs = np.where(values[:, :, 0].real.sum(axis=1) < 0, -1.0, 1.0)
        nodes = values[:, :, 0].real
        mixed = (nodes.min(axis=1) < 0) & (nodes.max(axis=1) > 0)
        mixed &= np.abs(nodes).max(axis=1) > _STILL * np.abs(nodes).max()
        out_edges: list[Array] = []
        out_values: list[Array] = []
        for k in range(len(values)):
            out_edges.append(edges[k])
            if not mixed[k]:
                out_values.append(signs[k] * values[k])
                continue
            width = edges[k + 1] - edges[k]
            cuts = [0.0, *(root for root in _roots(values[k, :, 0].real) if 0.0 < root < 1.0), 1.0]
            # the moving cut contributes nothing to first order because the curve is zero there
            for a, b in itertools.pairwise(cuts):
                part = weights(a + NODES * (b - a)) @ values[k]
                sign = -1.0 if part[:, 0].real.sum() < 0 else 1.0
                out_values.append(sign * part)
                if b < 1.0:
                    out_edges.append(edges[k] + b * width)
        out_edges.append(edges[-1])
        return Curve(edges=np.array(out_edges), values=np.array(out_values))

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
            part = np.einsum("jl,klp->kjp", weights((NODES + half) / 2), self.values)
            start = self.edges[:-1] + half * width / 2
            time = start[:, None, :] + NODES[None, :, None] * (width / 2)[:, None, :]
            values[half::2] = function(part, time)
        return Curve(edges=edges, values=values)


def _polish(coefficients: npt.NDArray[np.float64], a: float, b: float) -> float:
    """Return the root of a Chebyshev series inside the bracket [a, b] of [0, 1], by Newton kept in the bracket."""
    derivative = np.polynomial.chebyshev.chebder(coefficients)
    fa = float(np.polynomial.chebyshev.chebval(2 * a - 1, coefficients))
    fb = float(np.polynomial.chebyshev.chebval(2 * b - 1, coefficients))
    theta = a + (b - a) * fa / (fa - fb) if fa != fb else 0.5 * (a + b)
    for _ in range(60):
        f = float(np.polynomial.chebyshev.chebval(2 * theta - 1, coefficients))
        if f == 0.0:
            break
        if (f < 0) == (fa < 0):
            a = theta
        else:
            b = theta
        slope = 2 * float(np.polynomial.chebyshev.chebval(2 * theta - 1, derivative))
        new = theta - f / slope if slope != 0.0 else 0.5 * (a + b)
        if not a <= new <= b:
            new = 0.5 * (a + b)
        moved, theta = abs(new - theta), new
        if moved <= 4e-16:
            break
    return theta


def _roots(nodes: npt.NDArray[np.float64]) -> list[float]:
    """Return the real roots in [0, 1] of the polynomial through ``nodes``, in order.

    The polynomial is scanned four times finer than its nodes; a root is polished by Newton inside its bracket. Where the
    scan comes near zero and turns back, the stationary point itself is looked at, so that a pair of close roots between
    two scan points is not lost.
    """
    scan = _TO_SCAN @ nodes
    negative = scan < 0
    changes = negative[:-1] != negative[1:]
    size = np.abs(scan)
    turning = (size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:]) & ~changes[:-1] & ~changes[1:]
    turning &= size[1:-1] < 0.02 * size.max()
    if not changes.any() and not turning.any():
        return []
    coefficients = coefficient_matrix() @ nodes
    brackets = [(float(_SCAN[k]), float(_SCAN[k + 1])) for k in np.flatnonzero(changes)]
    for k in np.flatnonzero(turning) + 1:
        a, b = float(_SCAN[k - 1]), float(_SCAN[k + 1])
        top = _polish(np.asarray(np.polynomial.chebyshev.chebder(coefficients), dtype=np.float64), a, b)
        if (float(np.polynomial.chebyshev.chebval(2 * top - 1, coefficients)) < 0) != bool(negative[k]):
            brackets += [(a, top), (top, b)]
    return sorted(_polish(coefficients, a, b) for a, b in brackets)
