"""(z - Φ)⁻¹ f at many z: a triangular form once, and a substitution at each.

    Φ = Q T Qᴴ,   (z - T) (Qᴴ x) = Qᴴ f

References
----------
G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., section 7.6.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import schur

from engine.model.linear_system import Array, balancing

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

_MANY: Final = 40
"""Fewer states are solved at once."""


class Resolvent:
    """Solves (z - Φ) x = f; states that nothing follows from are solved behind the others.

    Parameters
    ----------
    whole : ndarray, shape (n, n)
        Φ.
    """

    def __init__(self, whole: Real) -> None:
        self._whole = whole
        followed = whole.any(axis=0)
        self._inner, self._outer = np.flatnonzero(followed), np.flatnonzero(~followed)

    def __call__(self, z: Complex, right: Complex) -> Complex:
        """Return x (k, n) for z (k,) and f (k, n); NaN where there is none."""
        found = np.zeros(right.shape, dtype=complex)
        solve = self._at_once if len(self._inner) <= _MANY else self._substituted
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            found[:, self._inner] = inner = solve(z, right[:, self._inner])
            behind = self._whole[self._outer[:, None], self._inner]
            found[:, self._outer] = (right[:, self._outer] + inner @ behind.T) / z[:, None]
        return found

    def _at_once(self, z: Complex, right: Complex) -> Array:
        own = self._whole[self._inner[:, None], self._inner]
        return _safely(z[:, None, None] * np.eye(len(own)) - own, right)

    @cached_property
    def _triangular(self) -> tuple[Complex, Complex, Real]:
        """T, Q and the scales of the states."""
        own = self._whole[self._inner[:, None], self._inner]
        scale = balancing(own)
        form, basis = schur(own * scale / scale[:, None], output="complex")
        return form, basis, scale

    def _substituted(self, z: Complex, right: Complex) -> Array:
        form, basis, scale = self._triangular
        found = (right / scale) @ basis.conj()
        for i in range(len(form) - 1, -1, -1):
            found[:, i] = (found[:, i] + found[:, i + 1 :] @ form[i, i + 1 :]) / (z - form[i, i])
        return np.asarray((found @ basis.T) * scale)


def _safely(matrix: Array, right: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(matrix, right[:, :, None])[:, :, 0])
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full_like(right, np.nan)
        return np.concatenate([_safely(m[None], r[None]) for m, r in zip(matrix, right, strict=True)])
