"""The response of one system to one command as pieces: as wide as a series of degree 16 holds, cut where the command breaks.

Behind the last change of a command that settles, what is followed is how far the states still are from rest: then a tail keeps its digits
and ends where nothing is left of it.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.linear.breaking_points import bends, go_on, strike
from engine.batch.linear.channel_maps import prepare, widen
from engine.batch.linear.channels import Channels, arrive, join
from engine.batch.linear.compiled import compiled
from engine.batch.linear.ladder import LEVELS, Ladder, begin, climb
from engine.batch.linear.pieces import Pieces, Plan
from engine.batch.linear.series import DEGREE, PARTS, SIZE
from engine.batch.linear.short_piece import shorter_piece

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

_HELD: Final = 2e-14
"""Of a response's largest value: what its last coefficients may be."""
_ROUNDING: Final = 4e-16
"""Of the size of the terms that a coefficient is the sum of."""
_GROWS: Final = 0.2
"""A wider piece is tried where its last coefficients are expected below this part of what is allowed."""
_NOISE: Final = 2e-15
"""Of the size of the terms that a coefficient is the sum of: what rounding leaves in those in the middle."""
_AT_REST: Final = 2e-16
_COARSE: Final = 1e3
"""The shortest piece may exceed what is allowed by this, to 1e-11 of the response."""
_DAMPED: Final = 1e-3
"""Of what arrives through a delay: were its last coefficients larger, a wide piece would not let it decay."""
_NOTHING: Final = 1e-13
"""Of an instant: what is left of a gap by rounding."""


@compiled
def follow(
    plan: Plan, ladder: Ladder, pieces: Pieces, channels: Channels, m: Series, rows: Series, x0: Series, rest_x: Series,
    rest_y: Series, unit: float, n: int, end: float, jumps: Real,
) -> int:  # fmt: skip
    """Write the pieces of a response and return how many; -1 where it cannot be followed.

    Parameters
    ----------
    m : ndarray, shape (N, N)
        Of states and command together.
    rows : ndarray, shape (R, N)
        What is watched; the last rows are what goes into delay channels.
    x0, rest_x : ndarray, shape (n,)
        States at the beginning, and at rest.
    rest_y : ndarray, shape (R,)
        What is watched, at rest.
    unit : float
        Of the ladder's first level, s.
    end : float
        Where to stop, s; infinite: where everything is at rest.
    jumps : ndarray, shape (corners, w)
        By how much the command's states jump at each corner.
    """
    size, corners, delayed = m.shape[0], plan.times.shape[0], channels.delays.shape[0] > 0
    begin(ladder, m, rows, n, unit)
    if delayed:
        prepare(channels, m, rows, n, PARTS * unit)
    for k in range(3):
        pieces.progress[k] = 0
    z = pieces.state
    for i in range(n):
        z[i] = x0[i]
        pieces.largest[i] = 0.0
    for r in range(rows.shape[0]):
        pieces.scale[r] = 0.0
    pieces.times[0] = pieces.moving[0] = plan.times[0]
    pieces.shifts[0] = 0.0 * x0[0]
    for corner in range(corners):
        now = plan.times[corner]
        pieces.marks[corner] = pieces.progress[2]
        if now >= end:
            continue
        finish = min(plan.times[corner + 1], end) if corner + 1 < corners else end
        resting = 0 <= plan.last <= corner
        if plan.last < 0 or corner <= plan.last:
            for k in range(n, size):
                z[k] = plan.states[corner, k - n]
        if corner == plan.last:
            for i in range(n):
                z[i] -= rest_x[i]
            for k in range(n, size):
                z[k] = 0.0 * z[k]
        struck, jumped = 0, False
        for k in range(plan.impulses.shape[0]):
            struck = 1 if corner == 0 and plan.impulses[k] != 0.0 else struck
        for k in range(jumps.shape[1]):
            jumped = jumped or jumps[corner, k] != 0.0
        if jumped and pieces.shifts[pieces.progress[2]] != 0.0:
            return -1  # two kinks at one instant that move apart
        if delayed and (struck > 0 or jumped):
            for k in range(channels.first.shape[0]):
                channels.steps[0, k] = max(channels.first[k] - struck, 0)
            if not go_on(channels, now + 0.0 * z[0], channels.steps[0], channels.steps[1]):
                return -1
        while now < finish:
            target = finish
            if delayed and channels.waiting[0] > 0:
                target = min(finish, channels.kinks[0].real)
            reached = _stretch(ladder, pieces, channels, m, rows, rest_y, unit, n, now, target, resting)
            if reached < 0:
                return -1
            if reached == 0:
                break
            now = target
            if delayed and not _come_back(pieces, channels, now):
                return -1
    pieces.marks[corners] = pieces.progress[2]
    return int(pieces.progress[2])


@compiled
def _come_back(pieces: Pieces, channels: Channels, now: float) -> bool:
    """Take over what comes back through delays at an instant; whether that is told."""
    count, kinked = pieces.progress[2], False
    while channels.waiting[0] > 0 and channels.kinks[0].real <= now * (1.0 + _NOTHING):
        if bends(channels):
            shift = channels.kinks[0] - channels.kinks[0].real
            if kinked and pieces.shifts[count] != shift:
                return False
            pieces.shifts[count], kinked = shift, True
        if not strike(channels, pieces.times, pieces.series, pieces.base, count, pieces.state, pieces.scale):
            return False
    return True


@compiled
def _stretch(
    ladder: Ladder, pieces: Pieces, channels: Channels, m: Series, rows: Series, rest_y: Series, unit: float, n: int,
    now: float, finish: float, resting: bool,
) -> int:  # fmt: skip
    """Follow a response to an instant through which everything is smooth: 1 there, 0 at rest before it, -1 where it cannot be followed."""
    z, size, watched = pieces.state, m.shape[0], rows.shape[0]
    level, top, count = pieces.progress[0], pieces.progress[1], pieces.progress[2]
    shortest, longest = math.inf, 0.0
    for j in range(channels.delays.shape[0]):
        shortest, longest = min(shortest, channels.delays[j].real), max(longest, channels.delays[j].real)
    left = finish - now
    while left > 0.0:
        if count + 1 >= pieces.times.shape[0]:
            return -1
        decayed = resting
        for i in range(n):
            here = abs(z[i].real)
            if not here < math.inf:
                return -1
            pieces.largest[i] = max(pieces.largest[i], here)
            decayed = decayed and here <= _AT_REST * pieces.largest[i]
        if longest > 0.0:
            if not (decayed and count > 0 and _still(pieces, watched - channels.delays.shape[0], watched, count - 1)):
                pieces.moving[0] = now
            decayed = now - pieces.moving[0] > longest
        if decayed and finish == math.inf:
            pieces.progress[2] = count
            return 0
        if decayed:
            for r in range(watched):
                pieces.base[r, count] = rest_y[r]
                for k in range(SIZE):
                    pieces.series[r, count, k] = 0.0 * z[0]
            for i in range(n):
                z[i] = 0.0 * z[i]
            count += 1
            break
        width = PARTS * unit
        if width > left:
            width = min(left, shortest)
            _arrive(pieces, channels, count, width, rest_y, resting)
            shorter_piece(pieces, channels, m, rows, width, n, PARTS * unit)
            _accept(pieces, rows, rest_y, resting, count)
        else:
            while level > 0 and width * 2.0**level > left:
                level -= 1
            excess = _tried(ladder, pieces, channels, rows, rest_y, resting, level, count, width * 2.0**level)
            while excess > 1.0 and level > 0:
                level -= 1
                excess = _tried(ladder, pieces, channels, rows, rest_y, resting, level, count, width * 2.0**level)
            if not excess < _COARSE:
                return -1
            _accept(pieces, rows, rest_y, resting, count)
            width *= 2.0**level
            _move(ladder.growth[level], pieces, channels, level, n, size)
            if level + 1 < LEVELS and width * 2.0 <= left - width and _roomy(pieces, watched):
                level += 1
                if level > top:
                    climb(ladder, level, n, size, watched)
                    if longest > 0.0:
                        widen(channels, ladder, level, n, watched, width * 2.0)
                    top = level
        now, left = now + width, left - width
        if finish < math.inf and left <= _NOTHING * finish:
            left, now = 0.0, finish
        count += 1
        pieces.times[count], pieces.shifts[count] = now, 0.0 * z[0]
    if left > 0.0 and finish < math.inf:
        pieces.times[count], pieces.shifts[count] = finish, 0.0 * z[0]
    pieces.progress[0], pieces.progress[1], pieces.progress[2] = level, top, count
    return 1


@compiled
def _still(pieces: Pieces, first: int, stop: int, piece: int) -> bool:
    """Whether nothing moves any more in what goes into channels on a piece."""
    for r in range(first, stop):
        moved = 0.0
        for k in range(SIZE):
            moved += abs(pieces.series[r, piece, k].real)
        if moved > _AT_REST * pieces.scale[r]:
            return False
    return True


@compiled
def _arrive(pieces: Pieces, channels: Channels, count: int, width: float, rest_y: Series, resting: bool) -> None:
    """Write what arrives through channels on a piece."""
    if channels.delays.shape[0] == 0:
        return
    for r in range(rest_y.shape[0]):
        pieces.other[r] = rest_y[r] if resting else 0.0 * rest_y[r]
    arrive(channels, pieces.times, pieces.series, pieces.base, count, width, pieces.other)


@compiled
def _tried(
    ladder: Ladder, pieces: Pieces, channels: Channels, rows: Series, rest_y: Series, resting: bool, level: int,
    count: int, width: float,
) -> float:  # fmt: skip
    """Write the series of a piece into the trial and return the last coefficients over what they may be."""
    if channels.delays.shape[0] > 0:
        _arrive(pieces, channels, count, width, rest_y, resting)
        join(channels, ladder, level, pieces.state, rows.shape[0])
    return _excess(ladder, pieces, channels, rows, rest_y, resting, level)


@compiled
def _excess(
    ladder: Ladder, pieces: Pieces, channels: Channels, rows: Series, rest_y: Series, resting: bool, level: int
) -> float:  # fmt: skip
    """Write the series of a piece into the trial and return the last coefficients over what they may be."""
    size, z = rows.shape[1], pieces.state
    worst = 0.0
    for r in range(rows.shape[0]):
        series = pieces.trial[r]
        terms = 0.0
        for k in range(SIZE):
            row = ladder.maps[level, r, k]
            total = row[0] * z[0]
            for j in range(1, size):
                total = total + row[j] * z[j]
            series[k] = total
            if k < 2:
                whole = 0.0
                for j in range(size):
                    whole += abs(row[j].real) * abs(z[j].real)
                terms = max(terms, whole)
        for j in range(channels.delays.shape[0]):
            inflow = channels.inflow[j]
            before = abs(series[0].real) + abs(series[1].real)
            for k in range(SIZE):
                series[k] = series[k] + channels.through[r, j] * inflow[k]
            for c in range(SIZE):
                factor = channels.sign[r] * inflow[c]
                for k in range(SIZE):
                    series[k] += channels.maps[level, channels.like[r], j, c, k] * factor
            terms = max(terms, before)
        spread = 0.0
        for k in range(1, SIZE):
            spread += abs(series[k].real)
        base = rest_y[r].real if resting else 0.0
        scale = max(pieces.scale[r], abs(series[0].real + base) + spread)
        last = max(abs(series[DEGREE].real), abs(series[DEGREE - 1].real))
        pieces.terms[r] = terms
        allowed = _HELD * scale + _ROUNDING * terms
        worst = max(worst, last / allowed) if allowed > 0.0 else worst
    first = rows.shape[0] - channels.delays.shape[0]
    for j in range(channels.delays.shape[0]):
        inflow = channels.inflow[j]
        whole = 0.0
        for k in range(SIZE):
            whole += abs(inflow[k].real)
        last = max(abs(inflow[DEGREE].real), abs(inflow[DEGREE - 1].real))
        allowed = _HELD * max(pieces.scale[first + j], whole)
        worst = max(worst, last / allowed) if allowed > 0.0 else worst
        if level > 0 and last > _DAMPED * whole:
            worst = max(worst, 2.0)
    return worst


@compiled
def _roomy(pieces: Pieces, count: int) -> bool:
    """Whether a piece of twice the width may be held: c'_16 is about 5 c_8² / Σ|c| of an exponential."""
    for r in range(count):
        series = pieces.trial[r]
        spread = 0.0
        for k in range(1, SIZE):
            spread += abs(series[k].real)
        middle = max(abs(series[8].real), abs(series[7].real)) - _NOISE * pieces.terms[r]
        if middle > 0.0 and 5.0 * middle * middle > _GROWS * _HELD * max(pieces.scale[r], 1e-300) * spread:
            return False
    return True


@compiled
def _accept(pieces: Pieces, rows: Series, rest_y: Series, resting: bool, count: int) -> None:
    """Take the trial over as a piece."""
    for r in range(rows.shape[0]):
        series = pieces.trial[r]
        spread = 0.0
        for k in range(SIZE):
            pieces.series[r, count, k] = series[k]
            spread += abs(series[k].real) if k else 0.0
        base = rest_y[r] if resting else 0.0 * rest_y[r]
        pieces.base[r, count] = base
        pieces.scale[r] = max(pieces.scale[r], abs(series[0].real + base.real) + spread)


@compiled
def _move(growth: Series, pieces: Pieces, channels: Channels, level: int, n: int, size: int) -> None:
    """Move the state over a piece."""
    z, moved = pieces.state, pieces.other
    for i in range(size):
        total = 0.0 * z[0]
        for j in range(0 if i < n else n, size):
            total = total + growth[i, j] * z[j]
        moved[i] = total
    for j in range(channels.delays.shape[0]):
        inflow = channels.inflow[j]
        for i in range(n):
            total = 0.0 * z[0]
            for c in range(SIZE):
                total = total + channels.ends[level, i, j, c] * inflow[c]
            moved[i] += total
    for i in range(size):
        z[i] = z[i] + moved[i]
