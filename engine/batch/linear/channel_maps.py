"""What a delay channel does to a piece, by the width of the piece: the matrices F, G and S of `engine.batch.linear.channels`."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from engine.batch.linear.channels import SAME, TERMS, Channels
from engine.batch.linear.compiled import compiled
from engine.batch.linear.ladder import NEEDED, Ladder, to_coefficients
from engine.batch.linear.series import DEGREE, HALVES, NODES, PARTS, SIZE
from engine.batch.linear.small_matrices import decompose

Real = npt.NDArray[np.float64]
Series = npt.NDArray[Any]

SMOOTH: Final = 8
"""A jump of this derivative is smooth: the series of a piece holds it, or its last coefficients tell that they do not."""


def _inverse() -> Real:
    """Return the matrix from values at the nodes of a piece to the coefficients of its series."""
    return np.asarray(np.linalg.inv(chebyshev.chebvander(2.0 * NODES / PARTS - 1.0, DEGREE)), dtype=float)


def _integrals() -> Real:
    """Return the k-fold integrals over [0, 1] of the 17 series at the 65 parts of a piece, (TERMS + 1, 65, 17)."""
    size = SIZE + TERMS + 1
    step = np.zeros((size, size))
    for k in range(size - 1):
        unit = np.zeros(size)
        unit[k] = 0.5
        step[:, k] = chebyshev.chebint(unit, lbnd=-1)[:size]
    values = chebyshev.chebvander(2.0 * np.arange(PARTS + 1) / PARTS - 1.0, size - 1)
    power, found = np.eye(size)[:, :SIZE], []
    for _ in range(TERMS + 1):
        found.append(values @ power)
        power = step @ power
    return np.array(found)


SERIES: Final = np.ascontiguousarray(_inverse().T)
INTEGRALS: Final = _integrals()


@compiled
def _alike(channels: Channels, rows: Series) -> None:
    """Enter for each row that is watched what goes into a channel, or the first row, that is the same or its opposite: F serves both."""
    count = rows.shape[0]
    watched = count - channels.delays.shape[0]
    for r in range(count):
        channels.like[r], channels.sign[r] = r, 1.0
        for back in range(count - 1 if r < watched else -1, -1, -1):
            other = (watched + back) % count  # what goes into channels comes last: every row like it is told so
            if r <= other < watched:
                continue
            for sign in (-1.0, 1.0):
                same = True
                for i in range(channels.drive.shape[0]):
                    same = same and rows[other, i] == sign * rows[r, i]
                for j in range(channels.delays.shape[0]):
                    same = same and channels.through[other, j] == sign * channels.through[r, j]
                if same:
                    channels.like[r], channels.sign[r] = other, sign


@compiled
def prepare(channels: Channels, m: Series, rows: Series, n: int, width: float) -> None:
    """Enter what does not depend on the piece; ``width`` (s) is that of the first level."""
    size, count, own = m.shape[0], rows.shape[0], channels.delays.shape[0]
    watched = count - own
    for k in range(TERMS):
        for j in range(own):
            for i in range(n):
                total = 0.0 * m[0, 0]
                if k == 0:
                    total = total + channels.drive[i, j]
                else:
                    for q in range(n):
                        total = total + m[i, q] * channels.powers[k - 1, q, j]
                    total = total * width
                channels.powers[k, i, j] = total
            for r in range(count):
                total = 0.0 * m[0, 0]
                for i in range(n):
                    total = total + rows[r, i] * channels.powers[k, i, j]
                channels.markov[k, r, j] = total
    for k in range(own):
        row = watched + k
        for j in range(own):
            channels.order[k, j] = SMOOTH
            for i in range(SMOOTH - 1, -1, -1):
                if channels.markov[i, row, j] != 0.0:
                    channels.order[k, j] = i + 1
            if channels.through[row, j] != 0.0:
                channels.order[k, j] = 0
        channels.first[k] = SMOOTH
        for i in range(size):
            channels.work[0, 0, i] = rows[row, i]
        for step in range(SMOOTH):
            jumps = False
            for i in range(n, size):
                jumps = jumps or channels.work[0, 0, i] != 0.0
            if jumps:
                channels.first[k] = step
                break
            for i in range(size):
                total = 0.0 * m[0, 0]
                for q in range(size):
                    total = total + channels.work[0, 0, q] * m[q, i]
                channels.work[1, 0, i] = total
            for i in range(size):
                channels.work[0, 0, i] = channels.work[1, 0, i]
    channels.waiting[0] = 0
    _alike(channels, rows)
    _first_level(channels, n, count, width)
    _close(channels, 0, count, width)


@compiled
def _first_level(channels: Channels, n: int, count: int, width: float) -> None:
    """Write F and G of the first level as sums of iterated integrals."""
    for j in range(channels.delays.shape[0]):
        for i in range(n):
            for c in range(SIZE):
                total = 0.0 * channels.drive[0, 0]
                for k in range(TERMS - 1, -1, -1):
                    total = total + channels.powers[k, i, j] * INTEGRALS[k + 1, PARTS, c]
                channels.ends[0, i, j, c] = total * width
        for r in range(count):
            if channels.like[r] != r:
                continue
            own = channels.parts[0, r, j]
            for part in NEEDED:
                for c in range(SIZE):
                    own[part, c] = 0.0 * channels.drive[0, 0]
            for k in range(TERMS - 1, -1, -1):
                factor = channels.markov[k, r, j] * width
                if factor != 0.0:
                    for part in NEEDED:
                        for c in range(SIZE):
                            own[part, c] += factor * INTEGRALS[k + 1, part, c]
            _map(own, channels.maps[0, r, j], channels)


@compiled
def _map(parts: Series, out: Series, channels: Channels) -> None:
    """Write the matrix (from, to) from series to series of that from series to values at the parts of a piece."""
    turned = channels.work[1]
    to_coefficients(parts, turned, channels.work[0], SIZE)
    for c in range(SIZE):
        for a in range(SIZE):
            out[c, a] = turned[a, c]


@compiled
def _halved(row: Series, half: Real, out: Series) -> None:
    """Write a row times the triangular matrix that gives the series on a half; four terms at once stay in registers."""
    for c in range(SIZE):
        out[c] = 0.0 * row[0]
    for k in range(0, DEGREE, 4):
        one, two, three, four = row[k], row[k + 1], row[k + 2], row[k + 3]
        for c in range(k, SIZE):
            first = one * half[k, c] + two * half[k + 1, c]
            out[c] += first + (three * half[k + 2, c] + four * half[k + 3, c])
    out[DEGREE] += row[DEGREE] * half[DEGREE, DEGREE]


@compiled
def widen(channels: Channels, ladder: Ladder, level: int, n: int, count: int, width: float) -> None:
    """Make F and G of ``level`` of those of the one below it; ``width`` (s) is the new one."""
    grown, before, after = ladder.growth[level - 1], (level - 1) % 2, level % 2
    for j in range(channels.delays.shape[0]):
        for i in range(n):
            below = channels.ends[level - 1, i, j]
            _halved(below, HALVES[0], channels.own[i])
            _halved(below, HALVES[1], channels.ends[level, i, j])
            for c in range(SIZE):
                channels.ends[level, i, j, c] += channels.own[i, c]
        for i in range(n):
            for k in range(n):
                factor = grown[i, k]
                if factor != 0.0:
                    for c in range(SIZE):
                        channels.ends[level, i, j, c] += factor * channels.own[k, c]
        for r in range(count):
            if channels.like[r] != r:
                continue
            below, states, out = channels.parts[before, r, j], ladder.rows[level - 1, r], channels.parts[after, r, j]
            for part in NEEDED:
                side = 0 if 2 * part <= PARTS else 1
                half = 2 * part - side * PARTS
                _halved(below[half], HALVES[side], out[part])
                if side == 1:
                    for i in range(n):
                        factor = states[half, i]
                        for c in range(SIZE):
                            out[part, c] += factor * channels.own[i, c]
            _map(out, channels.maps[level, r, j], channels)
    _close(channels, level, count, width)


@compiled
def _close(channels: Channels, level: int, count: int, width: float) -> None:
    """Write S (from, to) and decompose 1 - F S where a piece of this level is wider than a delay."""
    own = channels.delays.shape[0]
    first, size, values = count - own, own * SIZE, channels.nodes
    channels.wide[level] = 0
    for j in range(own):
        shift = channels.shift[level, j]
        back = channels.delays[j] / width
        for a in range(SIZE):
            for c in range(SIZE):
                shift[a, c] = 0.0 * channels.delays[0]
        for node in range(SIZE):
            theta = NODES[node] / PARTS
            if theta <= back.real * (1.0 + SAME):
                continue
            channels.wide[level] = 1
            u = 2.0 * (theta - back) - 1.0
            values[0], values[1] = 0.0 * u + 1.0, u
            for c in range(2, SIZE):
                values[c] = 2.0 * u * values[c - 1] - values[c - 2]
            for c in range(SIZE):
                factor = values[c]
                for a in range(SIZE):
                    shift[c, a] += SERIES[node, a] * factor
    if channels.wide[level] == 0:
        return
    matrix = channels.factors[level]
    for k in range(own):
        for j in range(own):
            _through(
                channels.maps[level, first + k, j], channels.shift[level, j], channels.through[first + k, j],
                matrix[k * SIZE : (k + 1) * SIZE], j * SIZE,
            )  # fmt: skip
        for a in range(SIZE):
            matrix[k * SIZE + a, k * SIZE + a] += 1.0
    decompose(matrix, channels.pivots[level], size)


@compiled
def _through(maps: Series, shift: Series, direct: Any, out: Series, column: int) -> None:
    """Write -(F + D) S into the columns of a matrix."""
    for a in range(SIZE):
        row = out[a]
        for c in range(SIZE):
            row[column + c] = -direct * shift[c, a]
    for c in range(SIZE):
        for k in range(SIZE):
            factor = shift[c, k]
            for a in range(SIZE):
                out[a, column + c] -= factor * maps[k, a]
