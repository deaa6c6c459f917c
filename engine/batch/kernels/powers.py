"""Powers of the matrix exponential, e^(A h 2^k) for k = 0, 1, 2 ... until nothing moves any more.

    e^X = T8(X) for ‖X⁸‖ <= 0.08⁸,   then squared;   ∫ likewise, which gives the state at rest after a step

Every candidate has its own h, so that ‖(A h)⁸‖ = 0.64⁸ resolves its fastest mode; ‖A h‖ itself is often several times as
large. The stored powers serve all that follows: sampling, and walking to any instant by its binary digits.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, apply, compiled, multiply
from engine.batch.kernels.vector import anywhere, copy, load, load2, magnitude, root, select, spread, store, store2

Real = npt.NDArray[np.float64]

LEVELS: Final = 48
"""At most so many doublings: the slowest mode may be 10^13 times slower than the fastest."""
STIFF: Final = 3e-8
"""Decay of the slowest mode in a step of the fastest, below which powers are not exact enough."""
_SMALL: Final = 0.08
_NON_NORMAL: Final = 4.0
"""The norm of a step's matrix may be so much larger than its eighth power suggests, so that series still end soon."""
EXTRA: Final = 3
RESOLVED: Final = _SMALL * 2.0**EXTRA
"""Angle by which the fastest mode turns in a step at most, rad."""
_REST: Final = 1e-13
_DECAYED: Final = 1e-3
_HUGE: Final = 1e30
_OVERSIZED: Final = 1e200

# P. Bader, S. Blanes, F. Casas, Computing the matrix exponential with an optimized Taylor polynomial approximation,
# Mathematics 7 (2019) 1174, eq. (12): degree 8 with three products.
_ROOT: Final = math.sqrt(177.0)
C3: Final = 2.0 / 3.0
C1: Final = C3 * (1.0 + _ROOT) / 88.0
C2: Final = C3 * (1.0 + _ROOT) / 352.0
C4: Final = (-271.0 + 29.0 * _ROOT) / (315.0 * C3)
C5: Final = 11.0 * (-1.0 + _ROOT) / (1260.0 * C3)
C6: Final = 11.0 * (-9.0 + _ROOT) / (5040.0 * C3)
C7: Final = (89.0 - _ROOT) / (5040.0 * C3**2)
D2: Final = (857.0 - 58.0 * _ROOT) / 630.0


@compiled
def unit(a: Real, n: int, nn: int, alive: Real, step: Real, x: Real) -> None:
    """Write the time 1/‖A‖ (LANES,) and X, the matrix A (nn, nn, LANES) over it; what does not exist gets -1, which disturbs nobody."""
    by_row, by_column = spread(0.0), spread(0.0)
    finite = by_row == 0.0
    for i in range(n):
        row, column = spread(0.0), spread(0.0)
        for j in range(n):
            row = row + magnitude(load2(a, i, j))
            column = column + magnitude(load2(a, j, i))
        finite = finite & (row < _OVERSIZED) & (column < _OVERSIZED)
        by_row = select(row > by_row, row, by_row)
        by_column = select(column > by_column, column, by_column)
    usable = finite & (by_row > 0.0) & (load(alive, 0) > 0.0)
    store(alive, select(usable, 1.0, 0.0), 0)
    for i in range(n):
        for j in range(n):
            store2(a, select(usable, load2(a, i, j), -1.0 if i == j else 0.0), i, j)
    time = 1.0 / select(usable, select(by_row < by_column, by_row, by_column), 1.0)
    store(step, time, 0)
    for k in range(nn * nn):
        store(x, load(a, k) * time, k)


@compiled
def _shrink(x: Real, x2: Real, x8: Real, n: int, nn: int, step: Real, extra: int) -> None:
    """Choose the step by the eighth power, which is as large as the fastest mode says, over 2^extra; scale X and X² to it."""
    largest = spread(0.0)
    for i in range(n):
        row = spread(0.0)
        for j in range(n):
            row = row + magnitude(load2(x8, i, j))
        largest = select(row > largest, row, largest)
    speed = root(root(root(largest)))
    factor = (_SMALL * 0.5**extra) / select(speed > 1.0 / _NON_NORMAL, speed, 1.0 / _NON_NORMAL)
    square = factor * factor
    store(step, load(step, 0) * factor, 0)
    for k in range(nn * nn):
        store(x, load(x, k) * factor, k)
        store(x2, load(x2, k) * square, k)


@compiled
def _largest_row(p: Real, n: int, nn: int, norm: Real) -> None:
    largest = spread(0.0)
    known = largest == 0.0
    for i in range(n):
        row = spread(0.0)
        for j in range(n):
            row = row + magnitude(load(p, i * nn + j))
        known = known & (row < math.inf)
        largest = select(row > largest, row, largest)
    store(norm, select(known, largest, math.nan), 0)


@compiled
def _decide(here: Real, n: int, experiments: int, rest: Real, norm: Real, step: Real, growth: Real, level: int) -> None:
    """Say of every lane that has decayed or diverges how fast; what diverges is forgotten, so that its overflow touches nobody."""
    for lane in range(LANES):
        wide, time = norm[lane], step[lane] * 2.0**level
        if not (wide <= _HUGE):
            if not (growth[lane] > 0.0):
                growth[lane] = math.log(wide) / time if wide > 0.0 else math.inf
            for i in range(n):
                for j in range(n):
                    here[i, j, lane] = 0.0
                for e in range(experiments):
                    rest[i, e, lane] = 0.0
            norm[lane] = 0.0
        elif wide < _DECAYED and math.isnan(growth[lane]):
            growth[lane] = math.log(max(wide, 1e-300)) / time


@compiled
def raise_powers(
    a: Real, b: Real, n: int, nn: int, experiments: int, alive: Real, step: Real, powers: Real, norms: Real,
    rest: Real, growth: Real, work: Real, room: Real, extra: int,
) -> int:  # fmt: skip
    """Fill ``powers`` (LEVELS, nn, nn, LANES) and return how many there are.

    On return ``step`` is the time step of the first, ``norms`` (LEVELS, LANES) their row norms, ``rest`` (nn, experiments,
    LANES) the states at rest, ``growth`` (LANES,) the rate of the slowest mode, about, in 1/s: positive where it diverges,
    NaN where neither was seen. Sizes are ``nn``, a multiple of 4; ``work`` is (6, nn, nn, LANES), ``room`` (2, nn,
    experiments, LANES). The step is 2^extra times as short as usual.
    """
    x, x2, t1, t2, p, q = work[0], work[1], work[2], work[3], work[4], work[5]
    unit(a, n, nn, alive, step, x)
    multiply(x2, x, x, nn, nn, nn, nn, nn, nn)
    multiply(p, x2, x2, nn, nn, nn, nn, nn, nn)
    multiply(q, p, p, nn, nn, nn, nn, nn, nn)
    _shrink(x, x2, q, n, nn, step, extra)
    size, h = nn * nn, load(step, 0)
    for k in range(size):
        store(t1, C1 * load(x, k) + C2 * load(x2, k), k)
    multiply(t2, x2, t1, nn, nn, nn, nn, nn, nn)
    for k in range(size):
        third = load(t2, k)
        store(t1, C5 * load(x, k) + C6 * load(x2, k) + C7 * third, k)
        store(t2, third + C3 * load(x2, k), k)
    for i in range(nn):
        store(t1, load(t1, i * nn + i) + C4, i * nn + i)
    multiply(p, t2, t1, nn, nn, nn, nn, nn, nn)
    for k in range(size):
        store(p, load(p, k) + load(x, k) + D2 * load(x2, k), k)
    for i in range(nn):
        store(p, load(p, i * nn + i) + 1.0, i * nn + i)
    # ∫ e^(A s) ds B over one step: Horner's rule, nine terms
    forcing, moved = room[0], room[1]
    entries = nn * experiments
    for k in range(entries):
        forced = load(b, k) * h
        store(forcing, forced, k)
        store(rest, forced, k)
    for term in range(9, 1, -1):
        apply(moved, x, rest, nn, experiments, nn, nn, experiments, experiments)
        for k in range(entries):
            store(rest, load(forcing, k) + load(moved, k) * (1.0 / term), k)
    for _ in range(EXTRA):
        apply(moved, p, rest, nn, experiments, nn, nn, experiments, experiments)
        for k in range(entries):
            store(rest, load(rest, k) + load(moved, k), k)
        multiply(q, p, p, nn, nn, nn, nn, nn, nn)
        p, q = q, p
    copy(powers, 0, p, 0, size)
    for lane in range(LANES):
        step[lane] *= 2.0**EXTRA
        growth[lane] = math.nan
    level = 0
    norm = x[0, 0]
    while True:
        here = powers[level]
        _largest_row(here, n, nn, norm)
        wide, known = load(norm, 0), load(growth, 0)
        bounded, decayed, said = wide <= _HUGE, wide < _DECAYED, (known < 0.0) | (known >= 0.0)
        news = select(decayed, select(said, 0.0, 1.0), select(bounded, 0.0, 1.0))
        if anywhere(news > 0.0):
            _decide(here, n, experiments, rest, norm, step, growth, level)
            wide = load(norm, 0)
        store(norms, wide, level)
        busy = wide > _REST
        if not anywhere(busy) or level + 1 == LEVELS:
            break
        apply(moved, here, rest, nn, experiments, nn, nn, experiments, experiments)
        for k in range(entries):
            # who rests already keeps what is known, however long others move
            store(rest, select(busy, load(rest, k) + load(moved, k), load(rest, k)), k)
        multiply(powers[level + 1], here, here, nn, nn, nn, nn, nn, nn)
        level += 1
    return level + 1
