"""One step of the integration: a polynomial that satisfies the equations at Radau points (Radau IIA of high order).

    x_j = x_0 + h Σ_k a_jk f(t_0 + c_k h, x_k),   j = 1..s

The method is L-stable and of order 2 s - 1 at the end of a step, so that stiff and smooth systems need no choice of a
method, and its polynomial of degree s is the dense output. A step is held when the last Legendre coefficients of that
polynomial are below the tolerance: what is seen between the points is as good as what is at the end.

On a step longer than a delay τ what comes out of it near its end went in on the step itself. The polynomial through start and
stages of what goes in, z, gives it; both unknowns are solved for together:

    w_j = past_j + Σ_k l_jk z(t_0 + c_k h, x_k, w_k),   l_jk the value at c_j - τ / h of the k-th Lagrange polynomial, k = 0..s

References
----------
E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", Springer 1996, IV.5 and IV.8;
A. Bellen, M. Zennaro, "Numerical Methods for Delay Differential Equations", Oxford 2003, chapter 6 (overlapping).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack

from engine.exact.time.chebyshev import NODES

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

STAGES = 13
SHORT_STAGES = 7
"""For steps that are short already, because a command kinks at every sample; and for the equations of many states."""

MANY_STATES = 40
"""From here on the equations of a step are what costs, and fewer points are cheaper."""

_NEWTON = 12
_EPS = 2.3e-16


@dataclass(frozen=True, kw_only=True, eq=False)
class Scheme:
    """Points and matrices for s stages.

    ``points`` (s,) in (0, 1]; ``a`` (s, s); ``to_nodes`` (17, s + 1) from start and stages to Chebyshev nodes;
    ``tail`` (2, s + 1) the last two Legendre coefficients; ``derivative`` (s + 1, s + 1) d/dθ at start and stages.
    """

    points: Real
    a: Real
    to_nodes: Real
    tail: Real

    def at(self, theta: Array) -> Array:
        """Return the weights from start and stages to the points ``theta``, shape (*theta.shape, s + 1)."""
        return np.asarray(_vander(np.asarray(theta), len(self.points)) @ _to_coefficients(len(self.points)))

    def back(self, delays: Array, grain: float) -> Array:
        """Return the weights from start and stages to what left them ``delays`` (..., m), in steps, before each stage.

        Shape (..., m, s, s + 1); 0 where that is before the step, or at its start to within ``grain`` steps: a jump there is not yet seen.
        """
        theta = self.points - delays[..., None]
        inside = theta.real > grain
        return np.where(inside[..., None], self.at(np.where(inside, theta, 0.0)), 0.0)


@dataclass(frozen=True, eq=False)
class Sums:
    """What unknowns y at the stages, states and then delayed signals, are made of besides what is known: Σ_k weights_jk g(y)_k.

    Rates are summed by ``states`` (s, s), what goes into the delays by ``delayed`` (m, s, s).
    """

    states: Real
    delayed: Real

    def of(self, g: Array) -> Array:
        """Return the sums of ``g`` (..., s, n + m)."""
        m = len(self.delayed)
        if not m:
            return np.asarray(self.states @ g)
        n = g.shape[-1] - m
        return np.concatenate(
            [self.states @ g[..., :n], np.einsum("bjk,...kb->...jb", self.delayed, g[..., n:])], axis=-1
        )

    def factors(self, jacobian: Real) -> tuple[Array, Array] | None:
        """Return the factors of 1 - Σ jacobian, slopes (s, n + m, n + m) of g; None where it is singular."""
        s, r = jacobian.shape[:2]
        n = r - len(self.delayed)
        blocks = np.empty((s, r, s, r))
        blocks[:, :n] = np.einsum("jk,kab->jakb", -self.states, jacobian[:, :n])
        if n < r:
            blocks[:, n:] = np.einsum("ajk,kab->jakb", -self.delayed, jacobian[:, n:])
        matrix = blocks.reshape(s * r, s * r)
        matrix[np.diag_indices(s * r)] += 1.0
        if not np.isfinite(matrix).all():
            return None
        triangles, pivots, info = lapack.dgetrf(matrix, overwrite_a=True)
        return None if info else (triangles, pivots)


def _vander(theta: Array, degree: int) -> Array:
    return np.asarray(np.polynomial.legendre.legvander(2 * np.asarray(theta) - 1, degree))


@cache
def _to_coefficients(stages: int) -> Real:
    points = np.concatenate([[0.0], _radau(stages)])
    return np.asarray(np.linalg.inv(_vander(points, stages)))


@cache
def _radau(stages: int) -> Real:
    from scipy.special import roots_jacobi  # noqa: PLC0415 - a twentieth of a second

    inner = roots_jacobi(stages - 1, 1, 0)[0]
    return np.concatenate([(1 + inner) / 2, [1.0]])


@cache
def scheme(stages: int) -> Scheme:
    """Return the method with so many stages (two at least)."""
    points = _radau(stages)
    fit = np.linalg.inv(_vander(points, stages - 1))
    primitives = np.stack(
        [np.polynomial.legendre.legint(row, lbnd=-1) / 2 for row in np.eye(stages)]
    )  # ∫ P_k from θ = 0, as Legendre coefficients
    integral = _vander(points, stages) @ primitives.T
    to_nodes = _vander(NODES, stages) @ _to_coefficients(stages)
    to_nodes[[0, -1]] = np.eye(stages + 1)[[0, -1]]  # both ends are start and last stage themselves
    return Scheme(
        points=points,
        a=integral @ fit,
        to_nodes=to_nodes,
        tail=_to_coefficients(stages)[-2:],
    )


def solve(
    g: Callable[[Real], Real], slope: Callable[[Real], Real], sums: Sums, *, known: Real, guess: Real, scale: Real
) -> Real | None:
    """Return y (s, r) with y = known + Σ g(y) at the stages of one step, None where Newton's method does not converge.

    Parameters
    ----------
    g : callable
        (s, r) -> (s, r): rates, and what goes into the delays.
    slope : callable
        (s, r) -> (s, r, r): their exact slopes.
    sums : Sums
    known, guess : ndarray, shape (s, r)
    scale : ndarray, shape (r,)
        Size of each unknown; corrections are judged relative to it.
    """
    y = guess
    if not y.shape[1]:
        return y
    factors: tuple[Array, Array] | None = None
    last = np.inf
    for _ in range(_NEWTON):
        values = g(y)
        residual = known + sums.of(values) - y
        if factors is None and np.isfinite(residual).all():
            factors = sums.factors(slope(y) * (scale / scale[:, None]))
        if factors is None:
            return None
        step = _apply(factors, (residual / scale).ravel()).reshape(y.shape) * scale
        y = y + step
        still = ~values.any(axis=0)
        y[:, still] = known[:, still]  # what does not move stays exactly where it is, and what follows from it, too
        size = float(np.max(np.abs(step) / scale))
        if size <= 20 * _EPS or (size <= 1e-11 and size <= 1e-3 * last) or (size <= 1e-13 and last <= 1e-12):
            return y
        if not math.isfinite(size) or (size > 2 * last and size > 1e-9):
            return None
        if size > 0.03 * last:
            factors = None
        last = size
    return y if last <= 1e-12 else None


def infinitesimal(jacobian: Real, residual: Real, sums: Sums, scale: Real) -> Real | None:
    """Return the solution (lanes, s, r) of the linearised step for ``residual`` (lanes, s, r)."""
    lanes, s, r = residual.shape
    if not r:
        return residual
    factors = sums.factors(jacobian * (scale / scale[:, None]))
    if factors is None:
        return None
    return np.asarray(_apply(factors, (residual / scale).reshape(lanes, s * r).T).T.reshape(lanes, s, r) * scale)


def _apply(factors: tuple[Array, Array], right: Array) -> Array:
    solution, _ = lapack.dgetrs(*factors, right)
    return np.asarray(solution)
