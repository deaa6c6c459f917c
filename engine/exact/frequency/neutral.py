"""Echoes that never die out: loops of delays and direct gains alone.

    w = diag(e^{-s τ}) D22 w;   the loop is neutral where max over phases of ρ(D22 diag(e^{jφ})) >= 1

Delays without an exact ratio run through all combinations of phases, each delay of its own length with one phase. Delays of
one length have that phase in common: what cancels between two of them cancels always.

References
----------
J. Hale, S. Verduyn Lunel, "Strong stabilization of neutral functional differential equations", IMA J. Math. Control
Inf. 19 (2002).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.linalg import eig

if TYPE_CHECKING:
    from collections.abc import Callable

Real = npt.NDArray[np.float64]

_LIMIT = 1 - 1e-12
_SAME = 1e-12
"""Delays that differ by less than this part of the longest are of one length: 0.1 + 0.2 is 0.3."""
_LOOKED_AT, _CLIMBED, _FEW = 4096, 4, 10


def neutral(d22: Real, delays: Real) -> bool:
    """Return whether echoes do not die out, whatever the exact ratio of delays of different length.

    Parameters
    ----------
    d22 : ndarray, shape (m, m)
        Direct gains from delayed signals to signals that are delayed.
    delays : ndarray, shape (m,)
        s.
    """
    if not d22.size or not d22.any() or float(np.abs(np.linalg.eigvals(np.abs(d22))).max()) < _LIMIT:
        return False
    order = np.argsort(delays)
    apart = np.diff(delays[order], prepend=delays[order[0]]) > _SAME * float(delays.max())
    length = np.empty(len(delays), dtype=np.intp)
    length[order] = np.cumsum(apart)
    lengths = int(length.max()) + 1
    if lengths == 1:  # a phase common to all turns the eigenvalues and leaves their size
        return bool(np.abs(np.linalg.eigvals(d22)).max() >= _LIMIT)
    looked_at = _spread(lengths - 1, int(np.clip(_LOOKED_AT * 1000 / len(d22) ** 3, 64, _LOOKED_AT)))
    turned = np.exp(1j * np.concatenate([np.zeros((len(looked_at), 1)), looked_at], axis=1))
    sizes = np.abs(np.linalg.eigvals(d22 * turned[:, None, length])).max(axis=1)
    if sizes.max() >= _LIMIT:
        return True
    from scipy.optimize import minimize  # noqa: PLC0415 -- loads slowly, and few systems have such loops

    climb = _size_and_slope(d22, length)
    best = looked_at[np.argsort(-sizes)[: _CLIMBED if len(d22) <= _FEW else 1]]
    return any(
        -minimize(climb, start, jac=True, method="BFGS", options={"gtol": 1e-9, "maxiter": 60}).fun >= _LIMIT
        for start in best
    )


def _spread(dimensions: int, count: int) -> Real:
    """Return ``count`` phases for each dimension, evenly spread: multiples of powers of an irrational number."""
    ratio = 2.0
    for _ in range(40):  # the root of x^(d + 1) = x + 1
        ratio = (1 + ratio) ** (1 / (dimensions + 1))
    return np.asarray(2 * np.pi * (np.arange(count)[:, None] * ratio ** -np.arange(1.0, dimensions + 1) % 1.0))


def _size_and_slope(d22: Real, length: npt.NDArray[np.intp]) -> Callable[[Real], tuple[float, Real]]:
    """Return what gives, less than nothing, the size of the largest eigenvalue and its slopes in all phases but the first."""

    def found(phases: Real) -> tuple[float, Real]:
        turned = d22 * np.exp(1j * np.concatenate([[0.0], phases]))[length]
        values, left, right = eig(turned, left=True, right=True)  # type: ignore[misc]  # its stubs miss the third value that left=True brings
        at = int(np.argmax(np.abs(values)))
        row, column = left[:, at].conj(), right[:, at]
        # dλ = Σ (row D22 diag(e^{jφ}))_i column_i j dφ_i / (row column)
        share = (row @ turned) * column / (row @ column) if row @ column else np.zeros(len(d22))
        moved = share * 1j * np.conj(values[at]) / np.abs(values[at])
        slope = np.bincount(length, weights=moved.real, minlength=len(phases) + 1)
        return -float(np.abs(values[at])), np.asarray(-slope[1:], dtype=np.float64)

    return found
