"""Least squares with tables of many rows: by the triangle of their decomposition, piece by piece.

    [X  Z] = Q [R  S; 0  T]:   (1 - P) Z has the inner products of [(1 - U Uᵀ) S; T],   U spans the range of R

A triangle has as many rows as the table has columns, whatever is recorded; all that a search asks for are inner products.

References
----------
G. Golub, C. Van Loan, "Matrix Computations", 4th ed., Johns Hopkins 2013, section 5.3 (least squares by QR), 5.2.8 (rows by pieces).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]

_ROWS: Final = 256
"""Of a piece: so few stay in the nearest memory, and no library divides them among threads, which wait for each other longer
than the work takes (2,500 rows in one piece: 50 ms on two busy cores, 0.2 ms in pieces)."""
_SEEN: Final = 1e-12
"""A direction of the scaled columns that is weaker than this part of the strongest is none."""


def triangle(table: Matrix) -> Matrix:
    """Return R of a table (rows, columns), which has the inner products of its columns; at most (columns, columns)."""
    columns = table.shape[1]
    rows = max(_ROWS, 2 * columns)
    found = table
    while len(found) > rows:
        pieces = np.pad(found, ((0, -len(found) % rows), (0, 0))).reshape(-1, rows, columns)
        found = np.asarray(np.linalg.qr(pieces, mode="r")).reshape(-1, columns)
    return np.asarray(np.linalg.qr(found, mode="r"))


def solved(corner: Matrix, known: int) -> tuple[Matrix, Matrix]:
    """Return what solves for the columns behind the ``known`` ones, (known, others), and what is left of these, (few, others).

    Parameters
    ----------
    corner : ndarray
        The triangle of all columns.
    known : int
        The first columns, whose combinations are taken off the others.
    """
    scale = np.linalg.norm(corner[:, :known], axis=0)
    scale[scale == 0] = 1.0
    left, strength, right = np.linalg.svd(corner[:known, :known] / scale, full_matrices=False)
    kept = strength > _SEEN * strength[0]
    left, wanted = left[:, kept], corner[:known, known:]
    within = left.T @ wanted
    found = (right[kept].T / strength[kept]) @ within / scale[:, None]
    return found, np.concatenate([wanted - left @ within, corner[known:, known:]])
