"""Exact derivatives without differences: every quantity carries its infinitesimals in its imaginary part.

    f(p (1 + i h)) = f(p) + i h p f'(p) + O(h²),   h = 1e-30, so that h² vanishes beside 1 in double precision

A *lane* is one parameter's direction. Arrays that may depend on parameters have a lane axis; all lanes share the real
part (the value) and differ in the imaginary part. Nothing is subtracted, so there is neither a truncation nor a
rounding error of a step. Decisions (which segment, which crossing) look at the real part alone.

References
----------
J. Martins, P. Sturdza, J. Alonso, "The complex-step derivative approximation", ACM TOMS 29 (2003) 245-262.
"""

from __future__ import annotations

import numpy as np

from engine.model.linear_system import Array

INFINITESIMAL = 1e-30

_ROUNDED = 2 * float(np.finfo(float).eps)
"""What rounding may leave over of an equation, of the size of its terms and for each of them."""
_TURNS = 4
"""How often what is left over is solved for at most."""


def slopes(value: Array) -> Array:
    """Return the derivatives that the imaginary part of ``value`` carries, per unit of the infinitesimal."""
    return np.imag(value) / INFINITESIMAL


def parted(value: Array, other: Array) -> bool:
    """Return whether two quantities of one size, shape (lanes,), move apart with a parameter.

    A hundredth is more than the slopes of two that are about to become one differ by.
    """
    largest = np.maximum(np.abs(value.imag), np.abs(other.imag))
    return bool(np.any(np.abs(value.imag - other.imag) > 0.01 * largest))


def evened(matrix: Array) -> Array:
    """Return the powers of 2, shape (..., k, 1), that make the rows of ``matrix``, shape (..., k, k), of one size."""
    _, exponent = np.frexp(np.abs(matrix).max(axis=-1, keepdims=True, initial=0.0))
    return np.asarray(np.ldexp(1.0, -exponent))


def solve_each(matrix: Array, right: Array) -> Array:
    """Solve ``matrix @ x = right`` for each of many, shapes (k, n, n) and (k, n, q).

    Small unknowns beside large ones keep their digits: where what is left over is more than rounding makes of the terms of
    its own row, it is solved for as well.

    Raises
    ------
    numpy.linalg.LinAlgError
        When one is singular.

    References
    ----------
    R. Skeel, "Iterative refinement implies numerical stability for Gaussian elimination", Math. Comp. 35 (1980) 817-832.
    """
    found = np.asarray(np.linalg.solve(matrix, right))
    poor = np.arange(len(matrix))
    for _ in range(_TURNS):
        m, x, b = matrix[poor], found[poor], right[poor]
        left_over = b - m @ x
        terms = np.abs(m) @ np.abs(x) + np.abs(b)
        still = (np.abs(left_over) > _ROUNDED * matrix.shape[-1] * terms).any(axis=(1, 2))
        if not still.any():
            break
        poor = poor[still]
        found[poor] += np.linalg.solve(m[still], left_over[still])
    return found


def solve(matrix: Array, right: Array) -> Array:
    """Solve ``matrix @ x = right`` for lanes that share the real part, factorising that part once.

    Parameters
    ----------
    matrix : ndarray, shape (lanes, k, k)
    right : ndarray, shape (lanes, k, q)

    Returns
    -------
    ndarray, shape (lanes, k, q)
        Exact to first order in the infinitesimal: M x = r gives M₀ x₁ = r₁ - M₁ x₀.

    Raises
    ------
    numpy.linalg.LinAlgError
        When the common real part is singular.
    """
    if not np.iscomplexobj(matrix) and not np.iscomplexobj(right):
        return solve_each(matrix[:1], right)
    common = matrix[0].real
    inverse = np.linalg.inv(common)

    def solved(sides: Array) -> Array:
        found = inverse @ sides
        return np.asarray(found + inverse @ (sides - common @ found))

    value = solved(right[0].real)
    return np.asarray(value + 1j * solved(right.imag - matrix.imag @ value))
