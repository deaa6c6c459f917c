"""Small matrices: scaled, solved and decomposed in place."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.linear.compiled import compiled

Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

_SWEEPS: Final = 8
_WORTH: Final = 0.95


@compiled
def balance(a: Series, b: Series, c: Series, b2: Series, c2: Series) -> None:
    """Scale states by powers of two so that rows and columns of A are alike (Osborne)."""
    n = a.shape[0]
    for _ in range(_SWEEPS):
        changed = False
        for i in range(n):
            row, column = 0.0, 0.0
            for j in range(n):
                if j != i:
                    row += abs(a[i, j].real)
                    column += abs(a[j, i].real)
            if row == 0.0 or column == 0.0:
                continue
            before, factor = row + column, 1.0
            while column * 2.0 < row:
                factor, row, column = factor * 2.0, row / 2.0, column * 2.0
            while row * 2.0 < column:
                factor, row, column = factor / 2.0, row * 2.0, column / 2.0
            if row + column < _WORTH * before:
                changed = True
                for j in range(n):
                    a[j, i] *= factor
                    a[i, j] /= factor
                for j in range(b.shape[1]):
                    b[i, j] /= factor
                for j in range(c.shape[0]):
                    c[j, i] *= factor
                for j in range(b2.shape[1]):
                    b2[i, j] /= factor
                    c2[j, i] *= factor
        if not changed:
            break


@compiled
def solve(a: Series, right: Series, work: Series, out: Series) -> bool:
    """Write A⁻¹ right (n,) and return whether there is one."""
    n = right.shape[0]
    for i in range(n):
        for j in range(n):
            work[i, j] = a[i, j]
        work[i, n] = right[i]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(work[i, k].real) > abs(work[pivot, k].real):
                pivot = i
        if work[pivot, k].real == 0.0:
            return False
        if pivot != k:
            for j in range(k, n + 1):
                work[k, j], work[pivot, j] = work[pivot, j], work[k, j]
        for i in range(k + 1, n):
            factor = work[i, k] / work[k, k]
            if factor != 0.0:
                for j in range(k + 1, n + 1):
                    work[i, j] -= factor * work[k, j]
    for i in range(n - 1, -1, -1):
        total = work[i, n]
        for j in range(i + 1, n):
            total = total - work[i, j] * out[j]
        out[i] = total / work[i, i]
    return True


@compiled
def decompose(matrix: Series, pivots: Whole, size: int) -> None:
    """Overwrite a matrix with its triangular factors (partial pivoting)."""
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(matrix[i, k].real) > abs(matrix[pivot, k].real):
                pivot = i
        pivots[k] = pivot
        if pivot != k:
            for c in range(size):
                matrix[k, c], matrix[pivot, c] = matrix[pivot, c], matrix[k, c]
        for i in range(k + 1, size):
            factor = matrix[i, k] / matrix[k, k]
            matrix[i, k] = factor
            if factor != 0.0:
                for c in range(k + 1, size):
                    matrix[i, c] -= factor * matrix[k, c]


@compiled
def substitute(matrix: Series, pivots: Whole, right: Series, size: int) -> None:
    """Overwrite a right side with the solution."""
    for k in range(size):
        if pivots[k] != k:
            right[k], right[pivots[k]] = right[pivots[k]], right[k]
    for i in range(size):
        total = right[i]
        for k in range(i):
            total = total - matrix[i, k] * right[k]
        right[i] = total
    for i in range(size - 1, -1, -1):
        total = right[i]
        for k in range(i + 1, size):
            total = total - matrix[i, k] * right[k]
        right[i] = total / matrix[i, i]
