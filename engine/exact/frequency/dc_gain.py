"""Gains at rest in double precision, and how far rounding may have moved them.

    M x = r,  y = C x + D;   every coefficient is rounded, so y is known to  ε (|C| |M⁻¹| (|M| |x| + |r|) + |C| |x| + |D|)

References
----------
R. D. Skeel, "Scaling for numerical stability in Gaussian elimination", Journal of the ACM 26 (1979) 494-526.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.model.tangent import evened, solve

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem

_ROUNDING = 10 * float(np.finfo(float).eps)
"""A coefficient of a block is made of a few numbers, and one of the connected system of a few of those."""


def static_gain(system: LaneSystem) -> Array:
    """Return the gain at s = 0, shape (lanes, outputs, inputs).

    Raises
    ------
    numpy.linalg.LinAlgError
        When the system has a pole at s = 0.
    """
    return _read(system, states_at_rest(system))


def states_at_rest(system: LaneSystem) -> Array:
    """Return states and delayed signals at rest for each input of 1, shape (lanes, n + m, inputs).

    Raises
    ------
    numpy.linalg.LinAlgError
        When the system has a pole at s = 0.
    """
    matrix, right = _equations(system)
    if not matrix.shape[-1]:
        return right
    inner = solve(matrix, right)
    return np.asarray(inner + solve(matrix, right - matrix @ inner))


def known_gain(system: LaneSystem) -> tuple[Array, npt.NDArray[np.float64]]:
    """Return the gain at s = 0 and how far rounding may have moved each, shape (outputs, inputs).

    Raises
    ------
    numpy.linalg.LinAlgError
        When the system has a pole at s = 0.
    """
    inner = states_at_rest(system)
    read, through = np.abs(np.concatenate([system.c1[0].real, system.d12[0].real], axis=-1)), np.abs(system.d11[0].real)
    size = np.abs(inner[0].real)
    matrix, right = _equations(system)
    moved = np.abs(matrix[0].real) @ size + np.abs(right[0].real)
    if len(moved):
        size = size + np.abs(np.linalg.inv(matrix[0].real)) @ moved
    return _read(system, inner), np.asarray(_ROUNDING * (read @ size + through))


def _read(system: LaneSystem, inner: Array) -> Array:
    read = np.concatenate([system.c1, system.d12], axis=-1)
    return np.asarray(read @ inner + system.d11)


def _equations(system: LaneSystem) -> tuple[Array, Array]:
    """Return M and r, their rows of one size, and once more what was left: a weak coupling must not drown in a strong one."""
    n, m = system.n, system.m
    if not n + m:
        return np.zeros((system.lanes, 0, 0)), np.zeros((system.lanes, 0, system.n_in))
    top = np.concatenate([system.a, system.b2], axis=-1)
    bottom = np.concatenate([system.c2, system.d22 - np.eye(m)], axis=-1)
    matrix = np.concatenate([top, bottom], axis=-2)
    right = -np.concatenate([system.b1, system.d21], axis=-2)
    rows = evened(matrix[0].real)
    return matrix * rows, right * rows
