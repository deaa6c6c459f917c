"""Chebyshev interpolation on the unit interval: nodes, barycentric weights, differentiation and integration.

    nodes θ_j = (1 - cos(π j / N)) / 2,  j = 0..N;  a polynomial of degree N is its N + 1 values there

References
----------
L. N. Trefethen, "Approximation Theory and Approximation Practice", SIAM 2013, chapters 3-5 and 19.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from engine.model.linear_system import Array

Real = npt.NDArray[np.float64]

DEGREE = 16
"""Degree of every piece: a segment that such a polynomial cannot hold to 1e-13 is divided."""


def _nodes(degree: int) -> Real:
    return np.asarray((1 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2)


NODES = _nodes(DEGREE)
_SIGNS = (-1.0) ** np.arange(DEGREE + 1)
_SIGNS[[0, -1]] *= 0.5


@cache
def coefficient_matrix() -> Real:
    """Return the matrix that turns node values into Chebyshev coefficients, shape (N + 1, N + 1)."""
    x = 2 * NODES - 1
    return np.asarray(np.linalg.inv(np.cos(np.outer(np.arccos(np.clip(x, -1, 1)), np.arange(DEGREE + 1)))))


@cache
def differentiation_matrix() -> Real:
    """Return the matrix that turns node values into node values of the derivative with respect to θ."""
    w = _SIGNS
    gap = NODES[:, None] - NODES[None, :] + np.eye(DEGREE + 1)
    d = (w[None, :] / w[:, None]) / gap
    np.fill_diagonal(d, 0.0)
    np.fill_diagonal(d, -d.sum(axis=1))
    return np.asarray(d)


@cache
def integration_matrix() -> Real:
    """Return the matrix that turns node values into node values of the integral from 0 to θ."""
    # exact for degree N: integrate each Chebyshev polynomial with the classical recurrence
    n = DEGREE
    x = 2 * NODES - 1
    t = np.cos(np.outer(np.arccos(np.clip(x, -1, 1)), np.arange(n + 2)))
    primitive = np.zeros((n + 1, n + 1))
    primitive[:, 0] = x
    primitive[:, 1] = t[:, 2] / 4
    for k in range(2, n + 1):
        primitive[:, k] = t[:, k + 1] / (2 * (k + 1)) - t[:, k - 1] / (2 * (k - 1))
    primitive -= primitive[0]
    return np.asarray(primitive @ coefficient_matrix() / 2)


@cache
def interior() -> tuple[Real, Real]:
    """Return points strictly inside the interval and the matrix from values there to node values.

    A signal that jumps at the ends of a segment is sampled inside only, so each end gets its one-sided limit.
    """
    points = (1 - np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))) / 2
    vandermonde = np.cos(np.outer(np.arccos(2 * points - 1), np.arange(DEGREE + 1)))
    at_nodes = np.cos(np.outer(np.arccos(np.clip(2 * NODES - 1, -1, 1)), np.arange(DEGREE + 1)))
    return points, at_nodes @ np.linalg.inv(vandermonde)


def weights(theta: Array) -> Array:
    """Return the interpolation weights from node values to the points ``theta``.

    Parameters
    ----------
    theta : ndarray, shape (...), real or carrying infinitesimals
        Points in [0, 1] (extrapolation a little outside is allowed).

    Returns
    -------
    ndarray, shape (..., N + 1)
    """
    inside = np.clip(np.real(theta), 0.0, 1.0)
    gap = np.asarray(inside)[..., None] - NODES
    node = np.abs(gap) < 1e-290
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = _SIGNS / gap
        basis = terms / terms.sum(axis=-1, keepdims=True)
    basis = np.where(node.any(axis=-1, keepdims=True), node, basis)
    offset = theta - inside  # the infinitesimal part, and what the clipping took away
    if np.any(offset != 0):
        basis = basis + offset[..., None] * (basis @ differentiation_matrix())
    return np.asarray(basis)


def tail(values: Array) -> Real:
    """Return the size of the last two Chebyshev coefficients: what the polynomial fails to hold.

    Parameters
    ----------
    values : ndarray, shape (N + 1, ...)
    """
    rows = coefficient_matrix()[-2:]
    return np.asarray(np.abs(np.tensordot(rows, values, axes=1)).sum(axis=0))
