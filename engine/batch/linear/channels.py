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

from engine.batch.linear.compiled import allocating, compiled
from engine.batch.linear.ladder import LEVELS, Ladder
from engine.batch.linear.series import DEGREE, NODES, PARTS, SIZE, to_series
from engine.batch.linear.small_matrices import substitute

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

TERMS: Final = 32
MOST_KINKS: Final = 600
SAME: Final = 1e-12
"""Of an instant: what is nearer is the same instant."""


class Channels(NamedTuple):
    """Delay channels of one system and their work space.

    ``delays`` (m,), ``drive`` (n, m) is B₂, ``through`` (R, m) from w to what is watched; the last m of R rows are z. ``powers`` (TERMS, n, m)
    are (A h)ᵏ B₂ for the width h of the first level, ``markov`` (TERMS, R, m) its rows. ``order`` (m, m) is the relative degree from w to
    z, ``first`` (m,) that from the command. ``kinks`` (MOST_KINKS,) are instants yet to come, rising, ``jumps`` (MOST_KINKS, 2, m) the lowest derivative
    that jumps there, of z and of w, ``waiting`` (1,) how many there are. ``ends`` (LEVELS, n, m, 17) is G, ``maps`` (LEVELS, R, m, 17, 17) F, ``shift``
    (LEVELS, m, 17, 17) S, ``factors`` and ``pivots`` the decomposition of 1 - F S; ``wide`` (LEVELS,) tells where it is needed.
    ``like`` and ``sign`` (R,) are the first row that is the same or its opposite, ``inflow`` (m, 17) the series of what arrives on a piece.
    The others are work space.
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


@allocating
def work_space(m: int, n: int, count: int, like: Series) -> Channels:
    """Return work space for m channels of a system of n states of which ``count`` rows are watched."""
    kind, levels = like.dtype, LEVELS if m else 0
    return Channels(
        np.zeros(m, kind), np.zeros((n, m), kind), np.zeros((count, m), kind), np.zeros((TERMS, n, m), kind),
        np.zeros((TERMS, count, m), kind), np.zeros((m, m), np.int64), np.zeros(m, np.int64),
        np.zeros(MOST_KINKS if m else 0, kind), np.zeros((MOST_KINKS if m else 0, 2, m), np.int64), np.zeros(1, np.int64),
        np.zeros((levels, n, m, SIZE), kind), np.zeros((2, count, m, PARTS + 1, SIZE), kind),
        np.zeros((levels, count, m, SIZE, SIZE), kind),
        np.zeros((levels, m, SIZE, SIZE), kind), np.zeros((levels, m * SIZE, m * SIZE), kind),
        np.zeros((levels, m * SIZE), np.int64), np.zeros(levels, np.int64), np.zeros((m, SIZE), kind),
        np.zeros(SIZE, kind), np.zeros((3, SIZE, max(SIZE, like.shape[0])), kind), np.zeros((n, SIZE), kind),
        np.zeros(SIZE + TERMS + 1, kind), np.zeros(m * SIZE, kind), np.zeros((2, m), np.int64),
        np.zeros(SIZE, np.int64), np.zeros(count, np.int64), np.ones(count), np.zeros((n + m, n + m), kind),
    )  # fmt: skip


@compiled
def piece_at(times: Real, count: int, start: int, instant: float, near: float, right: bool) -> int:
    """Return the piece on which an instant is, from ``start`` on; ``right``: that behind it where it is between two."""
    piece = start
    while piece + 1 < count and (times[piece + 1] <= instant + near if right else times[piece + 1] < instant - near):
        piece += 1
    return piece


@compiled
def first_at(times: Real, count: int, instant: float) -> int:
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
    nodes, near, places = channels.nodes, SAME * (now + width), channels.places
    above, behind, u = channels.work[0, 0], channels.work[0, 1], channels.work[0, 2]
    for j in range(own):
        row = series.shape[0] - own + j
        piece = first_at(times, count, now - channels.delays[j].real - near)
        first, stop = SIZE, 0
        for node in range(SIZE):
            since = NODES[node] / PARTS * width
            instant = now + since - channels.delays[j]
            nodes[node] = 0.0 * instant
            if since > channels.delays[j].real * (1.0 + SAME):
                continue
            if instant.real < times[0] - near or (node == SIZE - 1 and instant.real <= times[0] + near):
                nodes[node] = nodes[node] - rest[row]
                continue
            piece = piece_at(times, count, piece, instant.real, near, node == 0)
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
        to_series(nodes, channels.inflow[j])


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
    substitute(channels.factors[level], channels.pivots[level], right, own * SIZE)
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
