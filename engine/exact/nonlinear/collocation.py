"""One step of the integration: a polynomial that satisfies the equations at Radau points (Radau IIA of high order).

    x_j = x_0 + h Σ_k a_jk f(t_0 + c_k h, x_k),   j = 1..s

The method is L-stable and of order 2 s - 1 at the end of a step, so that stiff and smooth systems need no choice of a
method, and its polynomial of degree s is the dense output. A step is held when the last Legendre coefficients of that
polynomial are below the tolerance: what is seen between the points is as good as what is at the end.

References
----------
E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", Springer 1996, IV.5 and IV.8.
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

    def at(self, theta: Array) -> Real:
        """Return the weights from start and stages to the points ``theta``, shape (len(theta), s + 1)."""
        return _vander(np.asarray(theta), len(self.points)) @ _to_coefficients(len(self.points))


def _vander(theta: Array, degree: int) -> Real:
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
    rates: Callable[[Real], Real],
    slope: Callable[[Real], Real],
    *,
    start: Real,
    guess: Real,
    width: float,
    method: Scheme,
    scale: Real,
) -> Real | None:
    """Return the stages (s, n) of one step, None where Newton's method does not converge.

    Parameters
    ----------
    rates : callable
        (s, n) -> (s, n): rates at the stages.
    slope : callable
        (s, n) -> (s, n, n): their exact slopes.
    start : ndarray, shape (n,)
    guess : ndarray, shape (s, n)
    width : float
    method : Scheme
    scale : ndarray, shape (n,)
        Size of each state; corrections are judged relative to it.
    """
    x = guess
    if not x.shape[1]:
        return x
    factors: tuple[Array, Array] | None = None
    last = np.inf
    for _ in range(_NEWTON):
        f = rates(x)
        residual = start + width * (method.a @ f) - x
        if factors is None and np.isfinite(residual).all():
            factors = _factors(slope(x) * (scale / scale[:, None]), width, method)
        if factors is None:
            return None
        step = _apply(factors, (residual / scale).ravel()).reshape(x.shape) * scale
        x = x + step
        still = ~f.any(axis=0)
        x[:, still] = start[still]  # what does not move stays exactly where it is, and what follows from it, too
        size = float(np.max(np.abs(step) / scale))
        if size <= 20 * _EPS or (size <= 1e-11 and size <= 1e-3 * last) or (size <= 1e-13 and last <= 1e-12):
            return x
        if not math.isfinite(size) or (size > 2 * last and size > 1e-9):
            return None
        if size > 0.03 * last:
            factors = None
        last = size
    return x if last <= 1e-12 else None


def infinitesimal(jacobian: Real, residual: Real, width: float, method: Scheme, scale: Real) -> Real | None:
    """Return the solution (lanes, s, n) of the linearised step for ``residual`` (lanes, s, n)."""
    lanes, s, n = residual.shape
    if not n:
        return residual
    factors = _factors(jacobian * (scale / scale[:, None]), width, method)
    if factors is None:
        return None
    return np.asarray(_apply(factors, (residual / scale).reshape(lanes, s * n).T).T.reshape(lanes, s, n) * scale)


def _factors(jacobian: Real, width: float, method: Scheme) -> tuple[Array, Array] | None:
    s, n = jacobian.shape[:2]
    matrix = np.einsum("jk,kab->jakb", -width * method.a, jacobian).reshape(s * n, s * n)
    matrix[np.diag_indices(s * n)] += 1.0
    if not np.isfinite(matrix).all():
        return None
    triangles, pivots, info = lapack.dgetrf(matrix, overwrite_a=True)
    return None if info else (triangles, pivots)


def _apply(factors: tuple[Array, Array], right: Array) -> Array:
    solution, _ = lapack.dgetrs(*factors, right)
    return np.asarray(solution)
