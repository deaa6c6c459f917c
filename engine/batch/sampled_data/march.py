"""The response of one system with samplers as pieces: from instant to instant, and cut where the command breaks.

Behind the last change of a command that settles, what is followed is how far the states still are from rest.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.linear.channels import Channels
from engine.batch.linear.ladder import Ladder, begin, climb
from engine.batch.linear.pieces import Pieces, Plan
from engine.batch.linear.series import DEGREE, PARTS, SIZE
from engine.batch.linear.short_piece import shorter_piece
from engine.batch.sampled_data.compiled import compiled
from engine.batch.sampled_data.maps import norm_of
from engine.elements._limiting import Shape

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

LEVELS: Final = 16
ANGLE: Final = 4.0
"""Norm times width up to which a series of degree 16 holds every mode."""
_EVEN: Final = 4
"""A time between instants that takes no more pieces is cut evenly; else the first is as short as that, and each as long as all before it."""
_HELD: Final = 1e-12
"""Of a response's largest value: what the last coefficients of a longer piece may be."""
_NOISE: Final = 1e-15
"""Of what a piece begins with: what rounding may leave in its last coefficients."""
_ROUNDING: Final = 1e-18
"""Of the largest: a smaller coefficient of a piece is none."""
_AT_REST: Final = 1e-15
_GRAIN: Final = 1e-9
"""Of the period: instants that are nearer are one."""
_MOST_BETWEEN: Final = 64
_WAITING, _BEYOND, _LEVELS = int(Shape.WAITING), int(Shape.BEYOND), int(Shape.LEVELS)
_EDGE: Final = 1e-9
"""Of a level: nearer to the edge between two, rounding tells which it is."""
_TIE: Final = 1e-12
"""Of the output: nearer to a limit, rounding tells whether that acts."""


class Beat(NamedTuple):
    """The period of one candidate: ``instants`` (g,), ``widths`` (K,), ``kinds`` (g,), its ``length``, s, and how many states flow.

    ``jumps`` (g, n, n), ``entering`` (g, n, w) what the command's states enter by, ``rows`` (g, n + 1) which states jump, ended by -1.
    ``levels`` (K,) tells how many levels of pieces a width takes: 0 for even ones, of which there are ``counts`` (K,). ``sizes`` (K, LEVELS)
    is how many coefficients of a piece are not rounding. ``limited`` (g,) tells which limit follows a jump, -1: none, of those of which
    ``bounded`` (L, 4) has the rows of the output computed, of the output and of the integral part that follow at once (-1: none), and
    the `Shape`; ``limits`` (L, 4) are lower, upper, reach and share.
    """

    instants: Real
    widths: Real
    kinds: Whole
    length: float
    flowing: int
    jumps: Series
    entering: Series
    rows: Whole
    levels: Whole
    counts: Whole
    sizes: Whole
    limited: Whole
    bounded: Whole
    limits: Series


@compiled
def prepare(beat: Beat, ladders: Ladder, m: Series, rows: Series, rate: float) -> bool:
    """Make what leads over each width; ``ladders`` have an axis of the widths in front. Whether that can be."""
    n, size, count = beat.jumps.shape[1], m.shape[0], rows.shape[0]
    fastest = max(norm_of(m, beat.flowing), rate)
    for kind in range(beat.widths.shape[0]):
        ladder = Ladder(ladders.growth[kind], ladders.rows[kind], ladders.maps[kind], ladders.work[0], ladders.sums[0])
        needed = fastest * beat.widths[kind] / ANGLE
        if not needed < 2.0 ** (LEVELS - 1):
            return False
        if needed <= _EVEN:
            beat.levels[kind], beat.counts[kind] = 0, max(1, math.ceil(needed))
            begin(ladder, m, rows, n, beat.widths[kind] / (beat.counts[kind] * PARTS))
        else:
            levels = math.ceil(math.log2(needed))
            beat.levels[kind], beat.counts[kind] = levels, levels + 1
            begin(ladder, m, rows, n, beat.widths[kind] / (2.0**levels * PARTS))
            for level in range(1, levels):
                climb(ladder, level, n, size, count)
        for level in range(max(1, beat.levels[kind])):
            beat.sizes[kind, level] = _size_of(ladder.maps[level], count, size)
    return True


@compiled
def _size_of(maps: Series, count: int, size: int) -> int:
    """Return how many coefficients are more than rounding of the largest, whatever the state is."""
    found = 2
    for r in range(count):
        for j in range(size):
            largest = 0.0
            for k in range(SIZE):
                largest = max(largest, abs(maps[r, k, j].real))
            for k in range(SIZE - 1, found - 1, -1):
                if abs(maps[r, k, j].real) > _ROUNDING * largest:
                    found = k + 1
                    break
    return found


@compiled
def follow(
    plan: Plan, beat: Beat, ladders: Ladder, pieces: Pieces, channels: Channels, m: Series, rows: Series, rest_x: Series,
    rest_y: Series, unit: float, end: float,
) -> int:  # fmt: skip
    """Write the pieces of a response from rest and return how many; -1 where it cannot be followed.

    Parameters
    ----------
    m : ndarray, shape (N, N)
        Of states and command together.
    rows : ndarray, shape (R, N)
        What is watched.
    rest_x, rest_y : ndarray, shapes (n,), (R,)
        States and what is watched at rest.
    unit : float
        Up to how long a piece may be that is no whole time between instants, s.
    end : float
        Where to stop, s; infinite: where everything is at rest.
    """
    n, size, corners = beat.jumps.shape[1], m.shape[0], plan.times.shape[0]
    z = pieces.state
    for i in range(n):
        z[i], pieces.largest[i] = 0.0 * rest_x[i], 0.0
    for r in range(rows.shape[0]):
        pieces.scale[r] = 0.0
    pieces.times[0] = plan.times[0]
    pieces.progress[2] = 0
    turn, instant, whole = 0, 0, False  # which instant comes next, and whether the last one is where the time stands
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
                z[i], pieces.largest[i] = z[i] - rest_x[i], 0.0
            for k in range(n, size):
                z[k] = 0.0 * z[k]
        grain, whole = _GRAIN * beat.length, False
        while now < finish:
            following = turn * beat.length + beat.instants[instant]
            if following <= now + grain:
                if resting and instant == 0 and _still(pieces, n):
                    break
                if not _jump(beat, instant, pieces, rest_x, resting):
                    return -1
                instant += 1
                if instant == beat.instants.shape[0]:
                    turn, instant = turn + 1, 0
                whole = True
                continue
            target = following if following < finish - grain else finish
            reached = following <= finish + grain
            kind = beat.kinds[instant - 1 if instant > 0 else beat.kinds.shape[0] - 1]
            told = _between(
                beat, ladders, pieces, channels, m, rows, rest_y, resting, kind if whole and reached else -1, now, target, unit
            )  # fmt: skip
            if not told:
                return -1
            now, whole = target, whole and reached and target == following
        if now < finish < math.inf:  # at rest before
            if not _stands(pieces, rest_y, finish):
                return -1
            turn, instant = _next(beat, finish - _GRAIN * beat.length)
    pieces.marks[corners] = pieces.progress[2]
    return int(pieces.progress[2])


@compiled
def _next(beat: Beat, now: float) -> Any:
    """Return the turn and the number of the first instant behind a time."""
    turn = max(0, int(now / beat.length) - 1)
    while True:
        for instant in range(beat.instants.shape[0]):
            if turn * beat.length + beat.instants[instant] > now:
                return turn, instant
        turn += 1


@compiled
def _still(pieces: Pieces, n: int) -> bool:
    """Whether the states are at rest; takes note of the largest."""
    at_rest = True
    for i in range(n):
        here = abs(pieces.state[i].real)
        pieces.largest[i] = max(pieces.largest[i], here)
        at_rest = at_rest and here <= _AT_REST * pieces.largest[i]
    return at_rest and pieces.progress[2] > 0


@compiled
def _stands(pieces: Pieces, rest_y: Series, finish: float) -> bool:
    """Write a piece on which everything rests; whether there is room for it."""
    count = pieces.progress[2]
    if count + 1 >= pieces.times.shape[0]:
        return False
    for r in range(rest_y.shape[0]):
        pieces.base[r, count] = rest_y[r]
        for k in range(SIZE):
            pieces.series[r, count, k] = 0.0 * rest_y[0]
    pieces.times[count + 1], pieces.progress[2] = finish, count + 1
    return True


@compiled
def _jump(beat: Beat, instant: int, pieces: Pieces, rest_x: Series, resting: bool) -> bool:
    """Let the states jump; whether it is clear what a limit makes of them."""
    jump, entering, z, limit = beat.jumps[instant], beat.entering[instant], pieces.state, beat.limited[instant]
    n, extra = jump.shape[0], entering.shape[1]
    k = 0
    while beat.rows[instant, k] >= 0:
        i = beat.rows[instant, k]
        total = 0.0 * z[0]
        for j in range(n):
            total = total + jump[i, j] * z[j]
        for j in range(extra):
            total = total + entering[i, j] * z[n + j]
        pieces.other[k] = total
        k += 1
    before, taken = 0.0 * z[0], 0.0 * z[0]
    if limit >= 0:
        before, taken = z[beat.bounded[limit, 0]], z[beat.bounded[limit, 2]]
    for place in range(k):
        z[beat.rows[instant, place]] = pieces.other[place]
    return limit < 0 or _bound(beat.bounded[limit], beat.limits[limit], z, before, taken, rest_x, resting)


@compiled
def _bound(rows: Whole, limits: Series, z: Series, before: Any, taken: Any, rest_x: Series, resting: bool) -> bool:
    """Let a limit act on the states ``z`` behind a jump, ``before`` which these were its output and its integral part."""
    computed, output, integral, shape = rows
    asked = z[computed]
    offset = rest_x[computed] if resting else 0.0 * asked
    if shape >= _BEYOND:
        found, clear = _cut(asked + offset, limits, shape == _LEVELS)
        z[computed] = found - offset
        return bool(clear)
    found, side, near = asked, 0.0, math.inf
    for which in range(4):  # how far it gets, then how far it may
        sign = 1.0 if which % 2 == 0 else -1.0
        limit = before + sign * limits[2]
        if which >= 2:
            limit = (limits[1] if which == 2 else limits[0]) - offset
        near = min(near, abs((asked - limit).real))
        if sign * (found - limit).real > 0.0:
            found, side = limit, sign
    z[computed] = found
    if output >= 0:
        z[output] = found
    if integral < 0:
        return True
    change = z[integral] - taken
    if shape == _WAITING:
        if side * change.real > 0.0:
            z[integral] = taken
        # whether it waits tells by how much the next output differs
        size = abs(asked.real) + abs(offset.real) + abs(before.real)
        return bool(change.real == 0.0 or near > _TIE * size)
    z[integral] = z[integral] + limits[3] * (found - asked)
    return True


@compiled
def _cut(asked: Any, limits: Series, levels: bool) -> Any:
    """Return what is beyond two edges, or the nearest level, and whether that is clear."""
    if levels:
        ratio = (asked / limits[0]).real + 0.5
        level = math.floor(ratio)
        return level * limits[0] + 0.0 * asked, min(ratio - level, level + 1.0 - ratio) > _EDGE
    beyond = 0.0 * asked
    if (asked - limits[1]).real > 0.0:
        beyond = asked - limits[1]
    if (limits[0] - asked).real > 0.0:
        beyond = asked - limits[0]
    return beyond, True


@compiled
def _between(
    beat: Beat, ladders: Ladder, pieces: Pieces, channels: Channels, m: Series, rows: Series, rest_y: Series,
    resting: bool, kind: int, now: float, target: float, unit: float,
) -> bool:  # fmt: skip
    """Follow a response to an instant or corner: over a whole width of its ``kind``, or -1, by powers of time."""
    n, size = beat.jumps.shape[1], m.shape[0]
    if kind < 0:
        needed = max(1, math.ceil((target - now) / unit * (1.0 - 1e-12)))
        if needed > _MOST_BETWEEN or pieces.progress[2] + needed >= pieces.times.shape[0]:
            return False
        for part in range(needed):
            shorter_piece(pieces, channels, m, rows, (target - now) / needed, n, unit)
            if not _accept(pieces, rest_y, resting, False):
                return False
            until = target if part + 1 == needed else now + (part + 1) * (target - now) / needed
            pieces.times[pieces.progress[2]] = until
        return True
    levels, count = beat.levels[kind], beat.counts[kind]
    if pieces.progress[2] + count >= pieces.times.shape[0]:
        return False
    width, gone = beat.widths[kind], 0.0
    for part in range(count):
        level = max(part - 1, 0) if levels else 0
        _series(ladders.maps[kind, level], pieces, rows.shape[0], size, beat.sizes[kind, level])
        if not _accept(pieces, rest_y, resting, levels > 0):
            return False
        _move(ladders.growth[kind, level], pieces, n, size)
        gone += 2.0 ** (level - levels) if levels else 1.0 / count
        pieces.times[pieces.progress[2]] = target if part + 1 == count else now + gone * width
    return True


@compiled
def _series(maps: Series, pieces: Pieces, count: int, size: int, held: int) -> None:
    """Write the trial of a piece that takes ``held`` coefficients."""
    z = pieces.state
    for r in range(count):
        for k in range(held, SIZE):
            pieces.trial[r, k] = 0.0 * z[0]
        for k in range(held):
            row = maps[r, k]
            total = row[0] * z[0]
            for j in range(1, size):
                total = total + row[j] * z[j]
            pieces.trial[r, k] = total


@compiled
def _accept(pieces: Pieces, rest_y: Series, resting: bool, look: bool) -> bool:
    """Take the trial over as a piece; whether its numbers are, and its last coefficients are small where one looks."""
    count = pieces.progress[2]
    for r in range(rest_y.shape[0]):
        series = pieces.trial[r]
        spread = 0.0
        for k in range(SIZE):
            pieces.series[r, count, k] = series[k]
            spread += abs(series[k].real) if k else 0.0
        base = rest_y[r] if resting else 0.0 * rest_y[r]
        pieces.base[r, count] = base
        pieces.scale[r] = max(pieces.scale[r], abs(series[0].real + base.real) + spread)
        last = max(abs(series[DEGREE].real), abs(series[DEGREE - 1].real))
        allowed = _HELD * pieces.scale[r] + _NOISE * (abs(series[0].real) + abs(base.real))
        if not pieces.scale[r] < math.inf or (look and last > allowed):
            return False
    pieces.progress[2] = count + 1
    return True


@compiled
def _move(growth: Series, pieces: Pieces, n: int, size: int) -> None:
    """Move the state over a piece."""
    z, moved = pieces.state, pieces.other
    for i in range(size):
        total = 0.0 * z[0]
        for j in range(0 if i < n else n, size):
            total = total + growth[i, j] * z[j]
        moved[i] = total
    for i in range(size):
        z[i] = z[i] + moved[i]
