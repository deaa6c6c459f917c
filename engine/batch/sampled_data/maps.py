"""The map of a period of many systems: Φ = Π e^{M h} J, all as what they differ from 1 by, so that slow modes keep their digits.

(1 + a)(1 + X) - 1 = a + X + a X
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.linear.ladder import doubled, product
from engine.batch.sampled_data.compiled import allocating, compiled

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

_TERMS: Final = 9
_SHORT: Final = 1.0 / 16.0
"""Norm times width up to which nine terms of the exponential are exact."""


@compiled
def norm_of(m: Series, n: int) -> float:
    """Return a norm of the first n rows and columns."""
    by_row, by_column = 0.0, 0.0
    for i in range(n):
        row, column = 0.0, 0.0
        for j in range(n):
            row += abs(m[i, j].real)
            column += abs(m[j, i].real)
        by_row, by_column = max(by_row, row), max(by_column, column)
    return min(by_row, by_column)


@compiled
def grown(m: Series, n: int, width: float, work: Series, out: Series) -> None:
    """Write e^{M h} - 1 of a matrix whose rows from n on are 0; ``work`` is (3, N, N)."""
    size = m.shape[0]
    x, e, f = work[0], work[1], work[2]
    turns = norm_of(m, n) * width / _SHORT
    doublings = math.ceil(math.log2(turns)) if turns > 1.0 else 0
    unit = width / 2.0**doublings
    for i in range(size):
        for j in range(size):
            x[i, j] = m[i, j] * unit
            e[i, j] = x[i, j] / _TERMS
        e[i, i] += 1.0
    for k in range(_TERMS - 1, 1, -1):
        product(x, e, f, n, size)
        for i in range(size):
            for j in range(size):
                e[i, j] = f[i, j] / k
            e[i, i] += 1.0
    product(x, e, f, n, size)
    for _ in range(doublings):
        doubled(f, e, n, size)
        f, e = e, f
    for i in range(size):
        for j in range(size):
            out[i, j] = f[i, j]


@compiled
def _behind(step: Series, so_far: Series, out: Series, minus: float) -> None:
    """Write step + X + step X over X, where ``minus`` is taken from the step's diagonal; ``out`` is work space."""
    size = step.shape[0]
    for i in range(size):
        for j in range(size):
            out[i, j] = so_far[i, j]
        for k in range(size):
            factor = step[i, k] - (minus if k == i else 0.0)
            if factor != 0.0:
                out[i, k] += factor
                for j in range(size):
                    out[i, j] += factor * so_far[k, j]
    for i in range(size):
        for j in range(size):
            so_far[i, j] = out[i, j]


@allocating
def period_maps(flow: Series, flowing: int, jumps: Series, widths: Real, kinds: Whole, first: int, out: Series) -> None:
    """Write Φ - 1 of each system: jump and flow, instant by instant from the ``first`` on.

    Parameters
    ----------
    flow : ndarray, shape (B, n, n)
        Rows from ``flowing`` on are 0.
    jumps : ndarray, shape (B, g, n, n)
    widths, kinds : ndarray, shapes (K,), (g,)
        Which width follows each instant.
    out : ndarray, shape (B, n, n)
        Written.
    """
    members, size, count = flow.shape[0], flow.shape[1], kinds.shape[0]
    work = np.zeros((3, size, size), flow.dtype)
    growths = np.zeros((widths.shape[0], size, size), flow.dtype)
    for member in range(members):
        for k in range(widths.shape[0]):
            grown(flow[member], flowing, widths[k], work, growths[k])
        so_far = out[member]
        for i in range(size):
            for j in range(size):
                so_far[i, j] = 0.0 * flow[member, 0, 0]
        for step in range(count):
            instant = (first + step) % count
            _behind(jumps[member, instant], so_far, work[0], 1.0)
            _behind(growths[kinds[instant]], so_far, work[0], 0.0)
