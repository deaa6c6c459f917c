"""What leads a linear system over pieces of width h, 2 h, 4 h ...: its growth e^{M h} - 1, and the series of its outputs.

    z' = M z,  z = [x; w],  y = c z  =>  y on a piece is (c e^{M h θ}) z,  θ in [0, 1]

A piece twice as wide needs no new exponential: its rows at θ are those of the half at 2 θ, or those at 2 θ - 1 behind one more half.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.linear.compiled import compiled
from engine.batch.linear.series import DEGREE, EVEN, NODES, ODD, PARTS, SIZE

Real = npt.NDArray[np.float64]
Series = npt.NDArray[Any]

LEVELS: Final = 44
_ANGLE: Final = 4.0 / PARTS
"""The first piece is so short that degree 16 holds every mode: norm times width is 4."""
_TERMS: Final = 9
_DOUBLINGS: Final = 6  # from a part to a piece


def _closed() -> npt.NDArray[np.int64]:
    """Return the parts whose rows are needed: nodes, and what nodes of wider pieces are made of."""
    needed = set(NODES.tolist())
    while True:
        more = needed | {2 * j if 2 * j <= PARTS else 2 * j - PARTS for j in needed}
        if more == needed:
            return np.array(sorted(needed))
        needed = more


NEEDED: Final = _closed()
_HALF: Final = DEGREE // 2


class Ladder(NamedTuple):
    """``growth`` (LEVELS, N, N), ``rows`` (LEVELS, R, PARTS + 1, N), ``maps`` (LEVELS, R, 17, N), ``work`` (4, N, N), ``sums`` (17, N)."""

    growth: Series
    rows: Series
    maps: Series
    work: Series
    sums: Series


@compiled
def product(a: Series, b: Series, c: Series, n: int, size: int) -> None:
    """Write C = A B of matrices whose lower left block, (size - n, n), is 0."""
    for i in range(size):
        for j in range(size):
            c[i, j] = 0.0 * a[0, 0]
        for k in range(0 if i < n else n, size):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(0 if k < n else n, size):
                    c[i, j] += factor * b[k, j]


@compiled
def begin(ladder: Ladder, m: Series, rows: Series, n: int, unit: float) -> None:
    """Make the first level, whose parts last ``unit`` (s); M is (N, N), rows (R, N)."""
    size, count = m.shape[0], rows.shape[0]
    x, e, f = ladder.work[0], ladder.work[1], ladder.work[2]
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
    for r in range(count):
        own = ladder.rows[0, r]
        for j in range(size):
            own[0, j] = rows[r, j]
        for part in range(PARTS):
            _moved(own[part], f, own[part + 1], n, size)
    for _ in range(_DOUBLINGS):
        doubled(f, e, n, size)
        f, e = e, f
    for i in range(size):
        for j in range(size):
            ladder.growth[0, i, j] = f[i, j]
    for r in range(count):
        to_coefficients(ladder.rows[0, r], ladder.maps[0, r], ladder.sums, size)


@compiled
def climb(ladder: Ladder, level: int, n: int, size: int, count: int) -> None:
    """Make ``level`` of the one below it."""
    below = ladder.growth[level - 1]
    doubled(below, ladder.growth[level], n, size)
    for r in range(count):
        half, own = ladder.rows[level - 1, r], ladder.rows[level, r]
        for part in NEEDED:
            if 2 * part <= PARTS:
                for j in range(size):
                    own[part, j] = half[2 * part, j]
            else:
                _moved(half[2 * part - PARTS], below, own[part], n, size)
        to_coefficients(own, ladder.maps[level, r], ladder.sums, size)


@compiled
def doubled(g: Series, out: Series, n: int, size: int) -> None:
    """Write e^2M - 1 = g² + 2 g of g = e^M - 1."""
    product(g, g, out, n, size)
    for i in range(size):
        for j in range(size):
            out[i, j] += 2.0 * g[i, j]


@compiled
def _moved(row: Series, growth: Series, out: Series, n: int, size: int) -> None:
    """Write row (1 + growth)."""
    for j in range(size):
        out[j] = row[j]
    for k in range(size):
        factor = row[k]
        if factor != 0.0:
            for j in range(0 if k < n else n, size):
                out[j] += factor * growth[k, j]


@compiled
def to_coefficients(rows: Series, out: Series, sums: Series, size: int) -> None:
    """Write the map to the coefficients of a series, (17, size), from that to the values at the parts of a piece, (PARTS + 1, size)."""
    for k in range(_HALF + 1):
        first, second = rows[NODES[k]], rows[NODES[DEGREE - k]]
        for j in range(size):
            sums[k, j] = first[j] + second[j]
    for i in range(_HALF + 1):
        for j in range(size):
            out[2 * i, j] = 0.0 * rows[0, 0]
        for k in range(_HALF + 1):
            factor = EVEN[i, k]
            for j in range(size):
                out[2 * i, j] += factor * sums[k, j]
    for k in range(_HALF):
        first, second = rows[NODES[k]], rows[NODES[DEGREE - k]]
        for j in range(size):
            sums[k, j] = first[j] - second[j]
    for i in range(_HALF):
        for j in range(size):
            out[2 * i + 1, j] = 0.0 * rows[0, 0]
        for k in range(_HALF):
            factor = ODD[i, k]
            for j in range(size):
                out[2 * i + 1, j] += factor * sums[k, j]


@compiled
def unit_of(a: Series, n: int, rate: float) -> float:
    """Return how long a part may last, s; 0 where nothing moves by itself."""
    by_row, by_column = 0.0, 0.0
    for i in range(n):
        row, column = 0.0, 0.0
        for j in range(n):
            row += abs(a[i, j].real)
            column += abs(a[j, i].real)
        by_row, by_column = max(by_row, row), max(by_column, column)
    fastest = max(min(by_row, by_column), rate)
    return _ANGLE / fastest if fastest > 0.0 else 0.0


__all__ = ["LEVELS", "SIZE", "Ladder", "begin", "climb", "product", "to_coefficients", "unit_of"]
