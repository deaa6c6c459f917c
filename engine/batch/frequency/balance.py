"""Powers of two by which the states of many systems are scaled, so that their rows and columns are of equal size."""

from __future__ import annotations

import numpy as np

from engine.model.linear_system import Array


def balance(a: Array) -> Array:
    """Return powers of two (B, n) that bring rows and columns of each matrix to equal size: a[i, j] s[j] / s[i]."""
    size = np.abs(a.real)
    n = size.shape[1]
    size[:, np.arange(n), np.arange(n)] = 0.0
    scale = np.ones(size.shape[:2])
    for _ in range(3):
        for i in range(n):
            row, column = size[:, i].sum(axis=1), size[:, :, i].sum(axis=1)
            usable = (row > 0) & (column > 0)
            factor = np.exp2(np.round(0.5 * np.log2(np.where(usable, row, 1.0) / np.where(usable, column, 1.0))))
            size[:, :, i] *= factor[:, None]
            size[:, i] /= factor[:, None]
            scale[:, i] *= factor
    return scale
