"""Maps of a period with few states, and the map as a function of the gain of a loop whose cut carries a sequence.

    x(P) = A x(0) + E u,   y = R x(0) + D u,   u = κ y:   Φ(κ) = A + κ E (I - κ D)⁻¹ R

D is strictly lower triangular, for what is read depends on what has entered before. Of many states only those matter that the
sequence reaches: the space that E, A E, A² E, ... span, as far as it tells on eigenvalues that are not small.

References
----------
Y. Saad, Numerical Methods for Large Eigenvalue Problems, 2nd ed., chapter 6 (Krylov subspaces).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import lu_factor, lu_solve, solve_triangular

from engine.model.linear_system import Array, balancing

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

MANY: Final = 40
"""Fewer states are as fast without a basis of their own."""
_SMALL: Final = 0.4
"""What counts only for eigenvalues smaller than this is left out."""
_LEFT: Final = 1e-18
_COLUMNS: Final = 4
"""As many eigenvalues may be one and the same."""
_ROUNDED: Final = 4e-16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SequenceMap:
    """A, E, R and D of shapes (n, n), (n, e), (e, n), (e, e)."""

    whole: Real
    entered: Real
    read: Real
    through: Real

    def at(self, gains: Array) -> Array:
        """Return Φ(κ) for gains of shape (k,), shape (k, n, n)."""
        if len(self.read) == 1:  # what enters once in a period is read once
            return np.asarray(self.whole + gains[:, None, None] * (self.entered @ self.read))
        return np.stack([self.whole + gain * (self.entered @ self._signals(gain, self.read)) for gain in gains])

    def slope(self, gain: complex, states: Complex) -> Complex:
        """Return dΦ/dκ times states (n,)."""
        signals = self._signals(gain, self.read @ states)
        return np.asarray(self.entered @ (signals + gain * self._signals(gain, self.through @ signals)))

    def _signals(self, gain: complex, given: Complex | Real) -> Complex | Real:
        """Return (I - κ D)⁻¹ times a vector or matrix of e rows."""
        if len(given) < 2:
            return given
        return np.asarray(
            solve_triangular(-gain * self.through, given, lower=True, unit_diagonal=True, check_finite=False)
        )

    def reached(self) -> SequenceMap:
        """Return the same of fewer states: eigenvalues that the gain moves are the same to rounding, but for small ones."""
        if len(self.whole) <= MANY:
            return self
        scale = balancing(self.whole)
        whole, entered = self.whole * scale / scale[:, None], self.entered / scale[:, None]
        basis = _krylov(whole, entered)
        return SequenceMap(
            whole=basis.T @ whole @ basis,
            entered=basis.T @ entered,
            read=(self.read * scale) @ basis,
            through=self.through,
        )


def shortened(maps: Array) -> Array:
    """Return maps (k, m, m) whose eigenvalues are those of maps (k, n, n) to rounding, but for small ones: m is smaller."""
    n = maps.shape[-1]
    if n <= MANY or not np.isfinite(maps).all():
        return maps
    found = []
    start = np.sin(np.arange(1.0, 1 + n * _COLUMNS).reshape(n, _COLUMNS) ** 2)  # in no special direction
    for whole in maps:
        scale = balancing(np.abs(whole))
        balanced = whole * scale / scale[:, None]
        basis = _krylov(balanced, start)
        found.append(basis.conj().T @ balanced @ basis)
    most = max(map(len, found))
    return np.stack([np.pad(one, (0, most - len(one))) for one in found])


def _krylov(whole: Array, entered: Real) -> Array:
    """Return an orthonormal basis of what the columns ``entered`` reach."""
    sizes = np.linalg.norm(entered, axis=0)
    block: Array = entered[:, sizes > 0] / sizes[sizes > 0]
    basis: Array = np.zeros((len(whole), 0), dtype=whole.dtype)
    floor = _LEFT
    while block.size and basis.shape[1] < len(whole):
        noise = _ROUNDED * float(np.linalg.norm(block))
        for _ in range(2):  # once more, for what the first time has left to rounding
            block = block - basis @ (basis.conj().T @ block)
        new, weights, _ = np.linalg.svd(block, full_matrices=False)
        kept = weights > max(noise, floor)
        basis = np.hstack([basis, new[:, kept]])
        block, floor = whole @ (new[:, kept] * weights[kept]), floor * _SMALL
    return basis


def null_vector(matrix: Complex) -> Complex:
    """Return the vector of length 1 that a matrix, singular but for rounding, makes smallest, by inverse iteration."""
    factors, order = lu_factor(matrix, check_finite=False)
    tiny = np.finfo(float).eps * np.abs(matrix).max()
    pivots = factors.diagonal()
    np.fill_diagonal(factors, np.where(np.abs(pivots) < tiny, tiny, pivots))
    found: Complex = np.ones(len(matrix), dtype=complex)
    for _ in range(3):
        found = np.asarray(lu_solve((factors, order), found, check_finite=False))
        found /= np.linalg.norm(found)
    return found
