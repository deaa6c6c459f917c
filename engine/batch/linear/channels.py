"""What delays bring in, by the method of steps: on each piece a delay channel is the series of what went into it before.

    x' = A x + B u + B₂ w,  z = C₂ x + D₂₁ u + D₂₂ w,  w_j(t) = z_j(t - τ_j)
    a piece as wide as h:   y = maps z(0) + F w,   x(h) = e^{A h} x(0) + G w,   w in coefficients of its series

Where a piece is wider than a delay, part of w is what goes in on the piece itself, w = W + S z, and z solves (1 - F S) z = maps z(0) + F W.
A jump of the command comes back after every round, smoother by the relative degree of the way around. Pieces end there as long as it is
rougher than the series of a piece can hold.

References
----------
A. Bellen, M. Zennaro, Numerical Methods for Delay Differential Equations, Oxford 2003, chapters 3-4 (breaking points, method of steps).
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from engine.batch.linear.compiled import compiled
from engine.batch.linear.ladder import NEEDED, Ladder
from engine.batch.linear.series import DEGREE, EVEN, HALVES, NODES, ODD, PARTS, SIZE, value_at

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

TERMS: Final = 32
SMOOTH: Final = 8
"""A jump of this derivative is smooth: the series of a piece holds it, or its last coefficients tell that they do not."""
MOST_KINKS: Final = 600
_SAME: Final = 1e-12
"""Of an instant: what is nearer is the same instant."""


class Channels(NamedTuple):
    """Delay channels of one system and their work space.

    ``delays`` (m,), ``drive`` (n, m) is B₂, ``through`` (R, m) from w to what is watched; the last m of R rows are z. ``powers`` (TERMS, n, m)
    are (A h)ᵏ B₂ for the width h of the first level, ``markov`` (TERMS, R, m) its rows. ``order`` (m, m) is the relative degree from w to
    z, ``first`` (m,) that from the command. ``kinks`` (MOST_KINKS,) are instants yet to come, rising, ``jumps`` (MOST_KINKS, 2, m) the lowest derivative
    that jumps there, of z and of w, ``waiting`` (1,) how many there are. ``ends`` (LEVELS, n, m, 17) is G, ``maps`` (LEVELS, R, m, 17, 17) F, ``shift``
    (LEVELS, m, 17, 17) S, ``factors`` and ``pivots`` the decomposition of 1 - F S; ``wide`` (LEVELS,) tells where it is needed.
    """

    delays: Series
    drive: Series
    through: Series
    powers: Series
    markov: Series
    order: Whole
    first: Whole
    kinks: Series
    jumps: Whole
    waiting: Whole
    ends: Series
    parts: Series
    maps: Series
    shift: Series
    factors: Series
    pivots: Whole
    wide: Whole
    inflow: Series
    nodes: Series
    work: Series
    own: Series
    integral: Series
    before: Series
    steps: Whole
    places: Whole
    like: Whole
    sign: Real
    closed: Series


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
    """Enter for each row that is watched the first that is the same or its opposite: F serves both."""
    watched = rows.shape[0] - channels.delays.shape[0]
    for r in range(rows.shape[0]):
        channels.like[r], channels.sign[r] = r, 1.0
        for other in range(r - 1 if r < watched else -1, -1, -1):
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
            _map(own, channels.maps[0, r, j])


@compiled
def _map(parts: Series, out: Series) -> None:
    """Write the matrix (from, to) from series to series of that from series to values at the parts of a piece."""
    for a in range(SIZE):
        for c in range(SIZE):
            out[a, c] = 0.0 * parts[0, 0]
    for node in range(SIZE):
        row = parts[NODES[node]]
        for c in range(SIZE):
            factor = row[c]
            for a in range(SIZE):
                out[c, a] += SERIES[node, a] * factor


@compiled
def _halved(row: Series, half: Real, out: Series) -> None:
    """Write a row times the matrix that gives the series on a half; four terms at once stay in registers."""
    for c in range(SIZE):
        out[c] = row[DEGREE] * half[DEGREE, c]
    for k in range(0, DEGREE, 4):
        one, two, three, four = row[k], row[k + 1], row[k + 2], row[k + 3]
        for c in range(SIZE):
            first = one * half[k, c] + two * half[k + 1, c]
            out[c] += first + (three * half[k + 2, c] + four * half[k + 3, c])


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
            _map(out, channels.maps[level, r, j])
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
            if theta <= back.real * (1.0 + _SAME):
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
    _decompose(matrix, channels.pivots[level], size)


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


@compiled
def _decompose(matrix: Series, pivots: Whole, size: int) -> None:
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
def _substitute(matrix: Series, pivots: Whole, right: Series, size: int) -> None:
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


@compiled
def _piece_at(times: Real, count: int, start: int, instant: float, near: float, right: bool) -> int:
    """Return the piece on which an instant is, from ``start`` on; ``right``: that behind it where it is between two."""
    piece = start
    while piece + 1 < count and (times[piece + 1] <= instant + near if right else times[piece + 1] < instant - near):
        piece += 1
    return piece


@compiled
def _first_at(times: Real, count: int, instant: float) -> int:
    """Return the last piece that begins before an instant."""
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= instant:
            low = middle
        else:
            high = middle
    return low


@compiled
def arrive(
    channels: Channels, times: Real, series: Series, base: Series, count: int, width: float, rest: Series
) -> None:
    """Write what arrives on a piece of ``width`` (s) behind ``count`` pieces, above ``rest`` (R,), so far as it went in before the piece."""
    own, now = channels.delays.shape[0], times[count]
    nodes, near, places = channels.nodes, _SAME * (now + width), channels.places
    above, behind, u = channels.work[0, 0], channels.work[0, 1], channels.work[0, 2]
    for j in range(own):
        row = series.shape[0] - own + j
        piece = _first_at(times, count, now - channels.delays[j].real - near)
        first, stop = SIZE, 0
        for node in range(SIZE):
            since = NODES[node] / PARTS * width
            instant = now + since - channels.delays[j]
            nodes[node] = 0.0 * instant
            if since > channels.delays[j].real * (1.0 + _SAME):
                continue
            if instant.real < times[0] - near or (node == SIZE - 1 and instant.real <= times[0] + near):
                nodes[node] = nodes[node] - rest[row]
                continue
            piece = _piece_at(times, count, piece, instant.real, near, node == 0)
            places[node] = piece
            u[node] = 2.0 * (2.0 * (instant - times[piece]) / (times[piece + 1] - times[piece]) - 1.0)
            above[node], behind[node] = 0.0 * instant, 0.0 * instant
            first, stop = min(first, node), node + 1
        for k in range(DEGREE, 0, -1):  # Clenshaw, all nodes at once
            for node in range(first, stop):
                here = u[node] * above[node] - behind[node] + series[row, places[node], k]
                behind[node] = above[node]
                above[node] = here
        for node in range(first, stop):
            piece = places[node]
            nodes[node] = 0.5 * u[node] * above[node] - behind[node] + series[row, piece, 0]
            # What is left of a response must not be the difference of two large numbers, and sums may be reordered.
            if base[row, piece] != rest[row]:
                nodes[node] = nodes[node] + (base[row, piece] - rest[row])
        _to_series(nodes, channels.inflow[j])


@compiled
def _to_series(nodes: Series, out: Series) -> None:
    """Write the coefficients of the series through values at the nodes."""
    half = DEGREE // 2
    for i in range(half + 1):
        total = 0.0 * nodes[0]
        for k in range(half + 1):
            total = total + EVEN[i, k] * (nodes[k] + nodes[DEGREE - k])
        out[2 * i] = total
    for i in range(half):
        total = 0.0 * nodes[0]
        for k in range(half):
            total = total + ODD[i, k] * (nodes[k] - nodes[DEGREE - k])
        out[2 * i + 1] = total


@compiled
def join(channels: Channels, ladder: Ladder, level: int, z: Series, count: int) -> None:
    """Add what goes in on the piece itself, where it is wider than a delay; z is the state at its beginning."""
    if channels.wide[level] == 0:
        return
    own, size = channels.delays.shape[0], z.shape[0]
    first, right = count - own, channels.before
    for k in range(own):
        for a in range(SIZE):
            total = 0.0 * z[0]
            for i in range(size):
                total = total + ladder.maps[level, first + k, a, i] * z[i]
            for j in range(own):
                total = total + channels.through[first + k, j] * channels.inflow[j, a]
            right[k * SIZE + a] = total
        for j in range(own):
            for c in range(SIZE):
                factor = channels.inflow[j, c]
                for a in range(SIZE):
                    right[k * SIZE + a] += factor * channels.maps[level, first + k, j, c, a]
    _substitute(channels.factors[level], channels.pivots[level], right, own * SIZE)
    for j in range(own):
        for c in range(SIZE):
            factor = right[j * SIZE + c]
            for a in range(SIZE):
                channels.inflow[j, a] += factor * channels.shift[level, j, c, a]


@compiled
def integrate(out: Series, shrink: float) -> None:
    """Overwrite a series of 17 + TERMS coefficients with its integral, times ``shrink``."""
    size = out.shape[0]
    first = 0.0 * out[0]
    before = out[0] * 2.0
    for k in range(1, size):
        after = out[k + 1] if k + 1 < size else 0.0 * out[0]
        here = out[k]
        out[k] = (before - after) / (2.0 * k) * shrink
        before = here
        first = first + (out[k] if k % 2 else -out[k])
    out[0] = first


@compiled
def announce(channels: Channels, instant: Any, round_: Whole, inflow: int, order: int) -> bool:
    """Enter an instant at which derivatives of what goes into channels jump, ``round_`` (m,); False where there is no place left.

    ``inflow`` is the channel that brings it and ``order`` the derivative of what arrives that jumps.
    """
    own, count = channels.delays.shape[0], channels.waiting[0]
    near = _SAME * abs(instant.real)
    place = count
    while place > 0 and channels.kinks[place - 1].real > instant.real - near:
        place -= 1
    if place < count and abs(channels.kinks[place].real - instant.real) <= near:
        rough = order == 0
        for k in range(own):
            rough = rough or channels.jumps[place, 1, k] == 0
        if rough and channels.kinks[place].imag != instant.imag:
            return False  # two jumps at one instant that move apart
        for k in range(own):
            channels.jumps[place, 0, k] = min(channels.jumps[place, 0, k], round_[k])
        channels.jumps[place, 1, inflow] = min(channels.jumps[place, 1, inflow], order)
        return True
    if count == channels.kinks.shape[0]:
        return False
    for i in range(count, place, -1):
        channels.kinks[i] = channels.kinks[i - 1]
        for k in range(own):
            channels.jumps[i, 0, k] = channels.jumps[i - 1, 0, k]
            channels.jumps[i, 1, k] = channels.jumps[i - 1, 1, k]
    channels.kinks[place] = instant
    for k in range(own):
        channels.jumps[place, 0, k], channels.jumps[place, 1, k] = round_[k], SMOOTH
    channels.jumps[place, 1, inflow] = order
    channels.waiting[0] = count + 1
    return True


@compiled
def go_on(channels: Channels, instant: Any, went_in: Whole, round_: Whole) -> bool:
    """Announce where jumps of derivatives ``went_in`` (m,) of what goes into channels at an instant come out."""
    own = channels.delays.shape[0]
    for j in range(own):
        if went_in[j] >= SMOOTH:
            continue
        for k in range(own):
            round_[k] = min(SMOOTH, went_in[j] + channels.order[k, j])
        if not announce(channels, instant + channels.delays[j], round_, j, went_in[j]):
            return False
    return True


@compiled
def _went_in(times: Real, series: Series, base: Series, count: int, instant: float, near: float, right: bool) -> float:
    """Return what went into a channel at an instant; ``right``: behind it where it jumps."""
    piece = _piece_at(times, count, _first_at(times, count, instant - near), instant, near, right)
    u = 2.0 * (instant - times[piece]) / (times[piece + 1] - times[piece]) - 1.0
    return (value_at(series[piece], SIZE, u) + base[piece]).real  # type: ignore[no-any-return]


@compiled
def forget(channels: Channels) -> None:
    """Drop the earliest instant."""
    own, count = channels.delays.shape[0], channels.waiting[0] - 1
    for i in range(count):
        channels.kinks[i] = channels.kinks[i + 1]
        for k in range(own):
            channels.jumps[i, 0, k] = channels.jumps[i + 1, 0, k]
            channels.jumps[i, 1, k] = channels.jumps[i + 1, 1, k]
    channels.waiting[0] = count


@compiled
def strike(channels: Channels, times: Real, series: Series, base: Series, count: int, z: Series, scale: Real) -> bool:
    """Take the earliest instant: what arrives there jumps, and if the instant moves with a parameter the states move by -B₂ jump dt.

    Its rounds are announced. False where what is watched jumps as well, so that no derivative exists, or where there are too many.
    """
    own = channels.delays.shape[0]
    first, instant = series.shape[0] - own, channels.kinks[0]
    near = _SAME * instant.real
    for k in range(own):
        channels.steps[0, k] = channels.jumps[0, 0, k]
    shift = instant - instant.real
    for j in range(own):
        if instant.imag == 0.0 or channels.jumps[0, 1, j] != 0:
            continue
        row = first + j
        source = instant.real - channels.delays[j]
        behind = _went_in(times, series[row], base[row], count, source.real, near, True)
        ahead = 0.0 * behind
        if source.real > times[0] + near:
            ahead = _went_in(times, series[row], base[row], count, source.real, near, False)
        jump = behind - ahead
        for r in range(series.shape[0]):
            if abs(channels.through[r, j].real * jump) > _SAME * scale[r]:
                return False
        for i in range(channels.drive.shape[0]):
            z[i] = z[i] - channels.drive[i, j] * (jump * shift)
    forget(channels)
    return go_on(channels, instant, channels.steps[0], channels.steps[1])
