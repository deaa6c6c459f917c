"""Butterworth's low-pass of any order, as sections in series.

y/u = 1 / Π (1 + 2 d_k s/w + s²/w²),   d_k = sin((2k - 1) π/(2 order)),   with a factor 1 + s/w where the order is odd
"""

from __future__ import annotations

import math

from engine.elements._base import Realization, matrix
from engine.model.parameters import Scalar


def butterworth(w: Scalar, order: int, damping_ratio: Scalar | None = None) -> Realization:
    """Return sections in series, the least damped last; every state is of the size of the input.

    ``damping_ratio`` is that of the one pair of poles of order 2, in place of Butterworth's.
    """
    dampings: list[Scalar] = [math.sin((2 * k - 1) * math.pi / (2 * order)) for k in range(order // 2, 0, -1)]
    if damping_ratio is not None:
        dampings = [damping_ratio]
    sections: list[Scalar | None] = [*[None] * (order % 2), *dampings]
    rows: list[list[Scalar]] = [[0.0] * order for _ in range(order)]
    column: list[list[Scalar]] = [[0.0] for _ in range(order)]
    first, output = 0, -1
    for damping in sections:
        # x1' = w (v - x1), or x1' = w x2 and x2' = w (v - x1 - 2 d x2), with v the output of the section before.
        entry = first
        if damping is None:
            rows[first][first] = -w
        else:
            entry = first + 1
            rows[first][entry] = w
            rows[entry][first], rows[entry][entry] = -w, -2.0 * damping * w
        if first == 0:
            column[entry][0] = w
        else:
            rows[entry][output] = w
        first, output = entry + 1, first
    read = [1.0 if state == output else 0.0 for state in range(order)]
    return Realization(a=matrix(rows), b=matrix(column), c=matrix([read]), d=matrix([[0.0]]))
