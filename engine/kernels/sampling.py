"""Step responses of eight candidates at a time, sampled where something happens.

    y(t) = y∞ + C e^(A t) (-x∞):   16 samples for every octave of time, from the fastest mode until nothing moves

Each sample comes with its slope. Where slopes do not add up to what happened between two samples, or a cubic through them
leaves open whether a level is reached, that octave is sampled again twice as finely, and again; what stays open at the finest
is marked doubtful. The state of a scan holds in which interval the last or highest event of every kind lies.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.kernels.compiled import LANES, apart, apply, apply_two, compiled, merged, multiply
from engine.kernels.time_program import TimeProgram
from engine.kernels.vector import anywhere, copy, lanes_of, load, load2, magnitude, select, spread, store, store2

Real = npt.NDArray[np.float64]

RISE: Final = 1
SETTLE_2: Final = 2
SETTLE_5: Final = 4
HIGHEST: Final = 8
LOWEST: Final = 16
WHEN: Final = 32
"""What a metric needs of a response; HIGHEST is the furthest in the direction of the final value, WHEN also asks for its instant,
however little it stands out."""

SETTLED: Final = 1e-8
"""A response is followed until its slowest mode has decayed to this."""
ROWS: Final = 4
COLUMNS: Final = 4
PER_PASS: Final = 16
FINEST: Final = 9
"""How often the samples of an octave are doubled at most."""
_SWING: Final = 0.2
"""The trapezoidal rule misses by s²/12 of the steepest slope where a swing goes on by s rad between samples."""
_GRAZE: Final = 1e-6
"""A tip so near to the edge of a band, by the band, or as near as the interpolation error, is not decided here."""
SURE: Final = 4.0
"""How much larger than estimated an error of interpolation may be."""
_NOISE: Final = 1e-12
_RIPPLE: Final = 1e-8
"""What slips by less than this part of the largest value changes no metric that is read here."""
_FAR: Final = 1e-2
"""A turning point that is sure to stay so much below the furthest is no rival of it."""
_FAR_BELOW: Final = 5.0
"""What a pass could hide reaches at most so much further than its samples with half a step of their slopes: see `_hides`."""
SLIGHT: Final = 1e-7
"""An overshoot below this part of the final value counts as none, where its instant does not matter."""

# Fields of the state of a scan, each with LANES entries. A reading's bracket is the step at which it begins and its level:
# it is 2^level steps long. The lists of tops and lows hold the three furthest.
(
    Y, D, Y2, D2, BIG, N10, L10, N90, L90,
    N2, L2, POKE2, SIDE2, GRAZE2, N5, L5, POKE5, SIDE5, GRAZE5,
    TOP, TOP_N, TOP_L, TOP_E, TOP2, TOP2_N, TOP2_L, TOP2_E, TOP3, TOP3_N, TOP3_L, TOP3_E, TOP4,
    LOW, LOW_N, LOW_L, LOW_E, LOW2, LOW2_N, LOW2_L, LOW2_E, LOW3, LOW3_N, LOW3_L, LOW3_E, LOW4,
    ERROR, MIXED, UP, DOWN,
) = range(49)  # fmt: skip
FIELDS: Final = 49
RUN_TOP, RUN_LOW, RUN_STIR, RUN_N2, RUN_Y2, RUN_N5, RUN_Y5, RUN_ABOVE, RUN_BELOW = range(9)
RUN: Final = 9
"""What a pass has come across so far: extremes, the largest swing, the last samples outside of the bands; and what can matter."""
RANKS: Final = 3
ENTRY: Final = 4
"""Fields of an entry: height, step, level, error of the height. Behind the entries is the most that any other tip reaches."""
NONE: Final = -1.0
EDGE: Final = -2.0
_NOWHERE: Final = -1e300


@compiled
def passes(norms: Real, levels: int, alive: Real, growth: Real) -> int:
    """Return how many passes of 16 samples follow every candidate of the block until it rests."""
    last = 0
    for lane in range(LANES):
        if alive[lane] > 0.0 and growth[lane] < 0.0:
            level = 0
            while level + 1 < levels and norms[level, lane] > SETTLED:
                level += 1
            last = max(last, level)
    # the pass number k ends after 16 * 2^k steps
    return min(max(last - 5, 0), max(levels - 4, 0)) + 2


@compiled
def begin(state: Real, start: Real, slope: Real, final: Real) -> None:
    """Start a scan at t = 0+, where the output is ``start`` below its final value (all LANES,)."""
    for field in range(FIELDS):
        store(state, 0.0, field)
    away, goal = load(start, 0), load(final, 0)
    size, value = magnitude(goal), away + goal
    way = select(goal >= 0.0, 1.0, -1.0)
    progress = way * value
    store(state, away, Y)
    store(state, away, Y2)
    store(state, load(slope, 0), D)
    store(state, load(slope, 0), D2)
    store(state, magnitude(value), BIG)
    store(state, select(progress >= 0.1 * size, EDGE, NONE), L10)
    store(state, select(progress >= 0.9 * size, EDGE, NONE), L90)
    store(state, select(magnitude(away) > 0.02 * size, 0.0, NONE), L2)
    store(state, select(magnitude(away) > 0.05 * size, 0.0, NONE), L5)
    side = select(away > 0.0, -1.0, 1.0)
    store(state, side, SIDE2)
    store(state, side, SIDE5)
    for first in (TOP, LOW):
        for rank in range(RANKS):
            store(state, _NOWHERE, first + ENTRY * rank)
            store(state, NONE, first + ENTRY * rank + 2)
        store(state, _NOWHERE, first + ENTRY * RANKS)
        store(state, way * away if first == TOP else -(way * away), first)
        store(state, EDGE, first + 2)


@compiled
def _enter(state: Real, first: int, lane: int, height: float, n: float, level: float, error: float) -> None:
    """Enter a turning point into the list of the furthest."""
    rank, beyond = RANKS, first + ENTRY * RANKS
    while rank > 0 and height > state[first + ENTRY * (rank - 1), lane]:
        rank -= 1
    if rank == RANKS:
        state[beyond, lane] = max(state[beyond, lane], height + SURE * error)
        return
    pushed = beyond - ENTRY
    if state[pushed + 2, lane] != NONE:
        state[beyond, lane] = max(state[beyond, lane], state[pushed, lane] + SURE * state[pushed + 3, lane])
    for field in range(beyond - 1, first + ENTRY * (rank + 1) - 1, -1):
        state[field, lane] = state[field - ENTRY, lane]
    at = first + ENTRY * rank
    state[at, lane], state[at + 1, lane], state[at + 2, lane], state[at + 3, lane] = height, n, level, error


@compiled
def _turn(
    state: Real, lane: int, before: float, rising: float, y: float, d: float, final: float, h: float, n: float,
    level: float, wants: int,
) -> bool:  # fmt: skip
    """Take down a turning point in the interval that begins at ``n``, from a deviation and its slope to those at its end.

    Return whether finer samples would tell more.
    """
    error = state[ERROR, lane]
    # the turning point of the cubic through both values with both slopes
    m0, m1, climb = h * rising, h * d, y - before
    c2, c3 = 3.0 * climb - 2.0 * m0 - m1, m0 + m1 - 2.0 * climb
    bend = math.sqrt(max(c2 * c2 - 3.0 * c3 * m0, 0.0))
    below = -c2 + bend if rising > 0.0 else -c2 - bend
    share = min(max(m0 / below, 0.0), 1.0) if below != 0.0 else 0.5
    tip = before + share * (m0 + share * (c2 + share * c3))
    size, way = abs(final), 1.0 if final >= 0.0 else -1.0
    unsure = False
    if way * rising > 0.0:
        if wants & HIGHEST:
            _enter(state, TOP, lane, way * tip, n, level, error)
    elif wants & LOWEST:
        _enter(state, LOW, lane, -way * tip, n, level, error)
    if wants & RISE:
        highest, reached = way * (tip + final), way * (y + final)
        for f, part in ((L10, 0.1), (L90, 0.9)):
            # A level that is reached between two samples only: the bracket has no change of sign.
            if state[f, lane] == NONE and reached < part * size and highest + error >= part * size:
                state[MIXED, lane] = 1.0
                unsure = True
    for bit, f, part in ((SETTLE_2, N2, 0.02), (SETTLE_5, N5, 0.05)):
        band = part * size
        margin = _GRAZE * band + 3.0 * error
        if wants & bit and abs(tip) > band - margin and abs(y) <= band:
            state[f, lane], state[f + 1, lane], state[f + 2, lane] = n, level, 1.0
            state[f + 3, lane] = -1.0 if tip > 0.0 else 1.0
            state[f + 4, lane] = 1.0 if abs(tip) < band + margin else 0.0
            unsure = unsure or (abs(tip) < band + margin and 3.0 * error > _GRAZE * band)
    return unsure


@compiled
def scan(
    state: Real, run: Real, samples: Real, row: int, stride: int, final: Real, step: Real, level: int, before: int,
    start: float, wants: int, least: bool,
) -> bool:  # fmt: skip
    """Go through the 16 samples of a pass: ``samples`` (4 * stride, 4, LANES), deviation in ``row``, slope in ``row + 1``.

    They are ``2**level`` steps apart, the first so much after sample number ``start``; those before were ``2**before`` steps
    apart. Return whether finer samples would tell more; unless ``least``, which are the finest, the rest is left out then.
    ``run`` (RUN, LANES) is room.
    """
    unit = float(1 << level)
    goal, h = load(final, 0), load(step, 0)
    size = magnitude(goal)
    first90 = load(state, L90)
    rising = bool(wants & RISE) and anywhere(first90 == NONE)
    up, down = _limits(state, size, wants, rising)
    if not rising and _rests(state, samples, row, stride, goal, (0.5 * unit) * h, up, down):
        return False
    if level != before:
        # what was outside its band last begins an interval of the new length
        for bit, f in ((SETTLE_2, N2), (SETTLE_5, N5)):
            if wants & bit:
                first = (load(state, f) == start * unit) & (load(state, f + 1) >= 0.0)
                store(state, select(first, float(level), load(state, f + 1)), f + 1)
    unrisen = select(first90 == NONE, 1.0, 0.0)
    y1 = load(state, Y)
    for field, content in ((RUN_TOP, y1), (RUN_LOW, y1), (RUN_Y2, y1), (RUN_Y5, y1)):
        store(run, content, field)
    for field, number in ((RUN_STIR, 0.0), (RUN_N2, NONE), (RUN_N5, NONE)):
        store(run, number, field)
    unsure, index = False, 0
    while True:
        above, below = _walls(goal, up, down)
        store(run, above, RUN_ABOVE)
        store(run, below, RUN_BELOW)
        index = _sweep(state, run, samples, row, stride, goal, h, level, start, wants, index)
        if index == PER_PASS:
            break
        if _turns(state, run, samples, row, stride, index, final, step, level, before, start, wants):
            unsure = True
            if not least:
                return True
        up, down = _limits(state, size, wants, bool(wants & RISE) and anywhere(load(state, L90) == NONE))
        index += 1
    _outside(state, N2, load(run, RUN_N2), load(run, RUN_Y2), float(level))
    _outside(state, N5, load(run, RUN_N5), load(run, RUN_Y5), float(level))
    top, low, stir = load(run, RUN_TOP), load(run, RUN_LOW), load(run, RUN_STIR)
    big = _biggest(load(state, BIG), top, low, goal)
    _end(state, samples, row, stride)
    store(state, big, BIG)
    if anywhere(stir > _RIPPLE * big):
        highest, lowest = select(goal >= 0.0, top, -low), select(goal >= 0.0, low, -top)
        unsure = _hides(state, highest, lowest, stir, size, unrisen, wants, least) or unsure
    return unsure


@compiled
def _sweep(
    state: Real, run: Real, samples: Real, row: int, stride: int, goal: Any, h: Any, level: int, start: float, wants: int,
    first: int,
) -> int:  # fmt: skip
    """Go on through a pass, from sample ``first`` to the next at which some response has turned that may matter.

    Return the number of that sample, PER_PASS where there is none. What was found by then is in ``run`` (RUN, LANES), but the
    sample itself is not yet looked at for levels. No other function is called here: everything stays in registers.
    """
    apart()
    unit = float(1 << level)
    ahead, size, sign = unit * h, magnitude(goal), select(goal >= 0.0, 1.0, -1.0)
    half, swing = 0.5 * ahead, _SWING * ahead
    low10, low90 = -0.9 * size, -0.1 * size
    first10, first90 = load(state, L10), load(state, L90)
    rising = bool(wants & RISE) and anywhere(first90 == NONE)
    band2, band5 = 0.02 * size, 0.05 * size
    top, low, stir = load(run, RUN_TOP), load(run, RUN_LOW), load(run, RUN_STIR)
    above, below = load(run, RUN_ABOVE), load(run, RUN_BELOW)
    n_2, y_2, n_5, y_5 = load(run, RUN_N2), load(run, RUN_Y2), load(run, RUN_N5), load(run, RUN_Y5)
    y1, d1 = load(state, Y), load(state, D)
    if first > 0:
        at = row + ((first - 1) % ROWS) * stride
        y1, d1 = load2(samples, at, (first - 1) // ROWS), load2(samples, at + 1, (first - 1) // ROWS)
    steep1 = magnitude(d1)
    index = first
    while True:
        if index > 0:
            # the levels that were passed, or not yet reached, at the sample before this
            n = (start + index) * unit
            if rising:
                climbed = sign * y1
                passes10 = (climbed >= low10) & (first10 == NONE)
                passes90 = (climbed >= low90) & (first90 == NONE)
                if anywhere(passes10 | passes90):
                    first10, first90 = select(passes10, float(level), first10), select(passes90, float(level), first90)
                    store(state, select(passes10, n - unit, load(state, N10)), N10)
                    store(state, first10, L10)
                    store(state, select(passes90, n - unit, load(state, N90)), N90)
                    store(state, first90, L90)
                    rising = anywhere(first90 == NONE)
            if wants & SETTLE_2:
                outside = magnitude(y1) > band2
                n_2, y_2 = select(outside, n, n_2), select(outside, y1, y_2)
            if wants & SETTLE_5:
                outside = magnitude(y1) > band5
                n_5, y_5 = select(outside, n, n_5), select(outside, y1, y_5)
        if index == PER_PASS:
            break
        at, column = row + (index % ROWS) * stride, index // ROWS
        y, d = load2(samples, at, column), load2(samples, at + 1, column)
        steep = magnitude(d)
        steepest = select(steep > steep1, steep, steep1)
        slip = magnitude(y - y1 - half * (d + d1))
        swings = select(slip > swing * steepest, slip, 0.0)
        stir = select(swings > stir, swings, stir)
        top, low = select(y > top, y, top), select(y < low, y, low)
        # how far a tip can be at most; most ripples cannot matter any more
        if anywhere(_may_matter(y1, d1, y, d, half, above, below)):
            break
        y1, d1, steep1 = y, d, steep
        index += 1
    for field, content in (
        (RUN_TOP, top), (RUN_LOW, low), (RUN_STIR, stir), (RUN_N2, n_2), (RUN_Y2, y_2), (RUN_N5, n_5), (RUN_Y5, y_5)
    ):  # fmt: skip
        store(run, content, field)
    return index


@compiled
def _turns(
    state: Real, run: Real, samples: Real, row: int, stride: int, index: int, final: Real, step: Real, level: int,
    before: int, start: float, wants: int,
) -> bool:  # fmt: skip
    """Take down the turning points in the interval that ends with sample ``index``; return whether finer samples would tell more."""
    unit, h, goal = float(1 << level), load(step, 0), load(final, 0)
    at, column = row + (index % ROWS) * stride, index // ROWS
    at_before, column_before = row + ((index - 1) % ROWS) * stride, (index - 1) // ROWS
    y, d, y1, d1 = load2(samples, at, column), load2(samples, at + 1, column), load(state, Y), load(state, D)
    if index > 0:
        y1, d1 = load2(samples, at_before, column_before), load2(samples, at_before + 1, column_before)
    turning = _may_matter(y1, d1, y, d, (0.5 * unit) * h, load(run, RUN_ABOVE), load(run, RUN_BELOW))
    # a response at rest turns at every sample, by rounding
    big = _biggest(load(state, BIG), load(run, RUN_TOP), load(run, RUN_LOW), goal)
    turning = turning & (unit * h * magnitude(d1 - d) > _NOISE * big)
    if not anywhere(turning):
        return False
    if start + index == 0.0:
        # in the first step of all, how slopes add up must do
        store(state, magnitude(y - y1 - (0.5 * unit) * h * (d + d1)) * (1.0 / 16.0), ERROR)
    else:
        _miss(state, samples, row, stride, index, y1, y, d, unit, before, h)
    # a tip comes after the samples that were outside until then
    _outside(state, N2, load(run, RUN_N2), load(run, RUN_Y2), float(level))
    _outside(state, N5, load(run, RUN_N5), load(run, RUN_Y5), float(level))
    store(run, NONE, RUN_N2)
    store(run, NONE, RUN_N5)
    bits, unsure = lanes_of(turning), False
    for lane in range(LANES):
        if (bits >> lane) & 1:
            y_before, d_before = state[Y, lane], state[D, lane]
            if index > 0:
                y_before = samples[at_before, column_before, lane]
                d_before = samples[at_before + 1, column_before, lane]
            if _turn(
                state, lane, y_before, d_before, samples[at, column, lane], samples[at + 1, column, lane], final[lane],
                unit * step[lane], (start + index) * unit, float(level), wants,
            ):  # fmt: skip
                unsure = True
    return unsure


@compiled
def _miss(
    state: Real, samples: Real, row: int, stride: int, index: int, y1: Any, y: Any, d: Any, unit: float,
    before: int, h: Any,
) -> None:  # fmt: skip
    """Put down by how much interpolation errs over the step that ends with sample ``index``, where y1 was before it.

    Cubic interpolation over the two steps to both sides of the sample before errs so much more than that over one.
    """
    y2, d2 = load(state, Y2), load(state, D2)
    if index == 1:
        y2, d2 = load(state, Y), load(state, D)
    elif index > 1:
        at = row + ((index - 2) % ROWS) * stride
        y2, d2 = load2(samples, at, (index - 2) // ROWS), load2(samples, at + 1, (index - 2) // ROWS)
    w2 = float(1 << before) if index == 0 else unit
    theta, ratio = w2 / (w2 + unit), unit / w2
    rest = 1.0 - theta
    wide = (w2 + unit) * h
    middle = (
        (1.0 + 2.0 * theta) * rest * rest * y2 + theta * rest * rest * wide * d2
        + theta * theta * (3.0 - 2.0 * theta) * y - theta * theta * rest * wide * d
    )  # fmt: skip
    store(state, (ratio * ratio / 16.0) * magnitude(middle - y1), ERROR)


@compiled
def _end(state: Real, samples: Real, row: int, stride: int) -> None:
    """Take down the last two samples of a pass."""
    last, before = row + (ROWS - 1) * stride, row + (ROWS - 2) * stride
    store(state, load2(samples, last, COLUMNS - 1), Y)
    store(state, load2(samples, last + 1, COLUMNS - 1), D)
    store(state, load2(samples, before, COLUMNS - 1), Y2)
    store(state, load2(samples, before + 1, COLUMNS - 1), D2)


@compiled
def _rests(state: Real, samples: Real, row: int, stride: int, goal: Any, half: Any, up: Any, down: Any) -> bool:
    """Whether nothing in a pass reaches what could change a reading, by far; then take down how it ends."""
    y1, d1 = load(state, Y), load(state, D)
    limit = select(up < down, up, down) * (1.0 / _FAR_BELOW)
    if anywhere(magnitude(y1) > limit):
        return False
    top, low, steepest = y1, y1, magnitude(d1)
    for column in range(COLUMNS):
        for j in range(ROWS):
            at = row + j * stride
            y, steep = load2(samples, at, column), magnitude(load2(samples, at + 1, column))
            top, low = select(y > top, y, top), select(y < low, y, low)
            steepest = select(steep > steepest, steep, steepest)
    if anywhere(select(top > -low, top, -low) + half * steepest > limit):
        return False
    _end(state, samples, row, stride)
    store(state, _biggest(load(state, BIG), top, low, goal), BIG)
    return True


@compiled
def _limits(state: Real, size: Any, wants: int, rising: bool) -> Any:
    """Return how far a turning point must be able to reach to change a reading: up, towards the final value and beyond, and down."""
    limit = spread(1e300)
    if wants & SETTLE_2:
        limit = 0.015 * size
    elif wants & SETTLE_5:
        limit = 0.04 * size
    up, down = limit, limit
    if wants & HIGHEST:
        # what does not exceed the final value is not the furthest
        rival, least = _rival(state, TOP), 0.5e-9 * size
        rival = select(rival > least, rival, least)
        up = select(rival < up, rival, up)
    if rising:
        up = select(load(state, L10) == NONE, -0.95, -0.15) * size
    if wants & LOWEST:
        rival = _rival(state, LOW)
        down = select(rival < down, rival, down)
    return up, down


@compiled
def _may_matter(y1: Any, d1: Any, y: Any, d: Any, half: Any, above: Any, below: Any) -> Any:
    """Whether a response turns between two samples so far up, or down, that it may matter: the deviation rises, or falls, first."""
    merged()
    steep1, steep = magnitude(d1), magnitude(d)
    further = half * select(steep > steep1, steep, steep1)
    high, low = select(y > y1, y, y1) + further, select(y < y1, y, y1) - further
    return (d1 * d < 0.0) & (((d1 > 0.0) & (high > above)) | ((d > 0.0) & (low < below)))


@compiled
def _walls(goal: Any, up: Any, down: Any) -> Any:
    """Return the deviations above and below which a turning point may matter."""
    onwards = goal >= 0.0
    return select(onwards, up, down), -select(onwards, down, up)


@compiled
def _rival(state: Real, first: int) -> Any:
    """Return how far a tip must be able to reach to be a rival of the furthest."""
    height = load(state, first)
    return height - _FAR * magnitude(height) - SURE * load(state, first + 3)


@compiled
def _biggest(big: Any, top: Any, low: Any, goal: Any) -> Any:
    """Return the largest absolute value so far, from the extremes of the deviation."""
    above, below = magnitude(top + goal), magnitude(low + goal)
    larger = select(above > below, above, below)
    return select(larger > big, larger, big)


@compiled
def _hides(state: Real, highest: Any, lowest: Any, stir: Any, size: Any, unrisen: Any, wants: int, least: bool) -> bool:
    """Return whether swings that nobody saw may change a reading, in a pass from ``lowest`` to ``highest``.

    Where there are no finer samples than these, say so in the state.
    """
    # a swing of more than 2 rad slips by more than 0.6 of its size
    hidden = 2.0 * stir
    up, down = highest + hidden, hidden - lowest
    reach = select(up > down, up, down)
    there = stir > _RIPPLE * load(state, BIG)
    slight = (1e-9 if wants & WHEN else SLIGHT) * size
    higher = there & (up > load(state, TOP)) & (up > slight)
    lower = there & (down > load(state, LOW))
    wide, wider = there & (reach > 0.0195 * size), there & (reach > 0.049 * size)
    late = there & (unrisen > 0.0) & (hidden > 0.01 * size)
    if least:
        store(state, select(higher & (up > load(state, UP)), up, load(state, UP)), UP)
        store(state, select(lower & (down > load(state, DOWN)), down, load(state, DOWN)), DOWN)
        store(state, select(wide, 1.0, load(state, GRAZE2)), GRAZE2)
        store(state, select(wider, 1.0, load(state, GRAZE5)), GRAZE5)
        store(state, select(late, 1.0, load(state, MIXED)), MIXED)
    matters = reach < -1e300
    if wants & HIGHEST:
        matters = matters | higher
    if wants & LOWEST:
        matters = matters | lower
    if wants & SETTLE_2:
        matters = matters | wide
    if wants & SETTLE_5:
        matters = matters | wider
    if wants & RISE:
        matters = matters | late
    return bool(anywhere(matters))


@compiled
def _outside(state: Real, f: int, n: Any, y: Any, level: float) -> None:
    """Take down the last samples that lay outside a band: where, and the deviation there; nowhere is no place."""
    out = n >= 0.0
    if anywhere(out):
        store(state, select(out, n, load(state, f)), f)
        store(state, select(out, level, load(state, f + 1)), f + 1)
        store(state, select(out, 0.0, load(state, f + 2)), f + 2)
        store(state, select(out, select(y > 0.0, -1.0, 1.0), load(state, f + 3)), f + 3)
        store(state, select(out, 0.0, load(state, f + 4)), f + 4)


@compiled
def _keep(program: TimeProgram, experiment: int, to: Real, states: Real) -> None:
    """Copy what the scans of the responses to one command have found, of the kinds that they are asked for."""
    for t in range(program.traces.shape[0]):
        if program.traces[t, 1] == experiment:
            wants = program.traces[t, 2]
            copy(to[t], 0, states[t], 0, N2)
            if wants & SETTLE_2:
                copy(to[t], N2, states[t], N2, N5 - N2)
            if wants & SETTLE_5:
                copy(to[t], N5, states[t], N5, TOP - N5)
            if wants & HIGHEST:
                copy(to[t], TOP, states[t], TOP, LOW - TOP)
            if wants & LOWEST:
                copy(to[t], LOW, states[t], LOW, ERROR - LOW)
            copy(to[t], ERROR, states[t], ERROR, FIELDS - ERROR)


@compiled
def _watch(watched: Real, rows: Real, powers: Real, level: int, count: int, nn: int) -> None:
    """Fill ``watched`` with the rows C P^j, j = 1 ... 4, where P leads over 2^level steps."""
    multiply(watched, rows, powers[level], count, nn, nn, nn, nn, nn)
    multiply(watched[count:], watched, powers[level], count, nn, nn, nn, nn, nn)
    multiply(watched[2 * count :], watched, powers[level + 1], 2 * count, nn, nn, nn, nn, nn)


@compiled
def follow(
    program: TimeProgram, experiment: int, powers: Real, rows: Real, start: Real, final: Real, step: Real, last: int,
    extra: int, states: Real, saved: Real, watched: Real, columns: Real, samples: Real, moving: Real, run: Real,
) -> None:  # fmt: skip
    """Sample the responses to one command in ``last`` passes, and scan them; with 2^extra times as many samples at least.

    Parameters
    ----------
    program, experiment
        Whose traces, and which of them; their scans have begun.
    powers, rows
        Of the exponential (levels, nn, nn, LANES); of every output and its slope (rows, nn, LANES).
    start : ndarray, shape (nn, LANES)
        The deviation of the states at t = 0+ from their values at rest.
    final : ndarray, shape (traces, LANES)
    step : ndarray, shape (LANES,)
    states : ndarray, shape (traces, FIELDS, LANES)
        Of the scans.
    saved, watched, columns, samples, moving, run
        Room: as ``states``; (2, ROWS * rows, nn, LANES); (nn, COLUMNS, LANES); (ROWS * rows, COLUMNS, LANES);
        (1, nn, 1, LANES); (RUN, LANES).
    """
    nn, count, traces = program.padded, program.rows, program.traces.shape[0]
    origin = moving[0]
    copy(origin, 0, start, 0, nn)
    main, fine = watched[0], watched[1]
    _watch(main, rows, powers, 0, count, nn)
    doubled, before = 0, 0
    for number in range(last):
        level = max(0, number - 1)
        first = 0 if number == 0 else PER_PASS
        if level > 0:
            copy(main, 0, main, count * nn, count * nn)
            copy(main, count * nn, main, 3 * count * nn, count * nn)
            multiply(main[2 * count :], main, powers[level + 1], 2 * count, nn, nn, nn, nn, nn)
        # where the octave before needed finer samples, this one may, too
        doubled = min(max(doubled - 1, extra), level)
        if level > 0:
            _keep(program, experiment, saved, states)
        while True:
            deep = level - doubled
            least = deep == 0 or doubled == FINEST
            seen = main
            if doubled:
                seen = fine
                _watch(fine, rows, powers, deep, count, nn)
            for i in range(nn):
                store2(columns, load(origin, i), i, 0)
            unsure = False
            for part in range(1 << doubled):
                # the state, and how it is after four, eight and twelve samples
                if part:
                    apply(columns[0], powers[deep + 2], columns[0, 3:], nn, 1, nn, nn, COLUMNS, COLUMNS)
                apply(columns[0, 1:], powers[deep + 2], columns[0], nn, 1, nn, nn, COLUMNS, COLUMNS)
                apply_two(columns[0, 2:], powers[deep + 3], columns[0], nn, 2, nn, nn, COLUMNS, COLUMNS)
                multiply(samples, seen, columns, ROWS * count, COLUMNS, nn, nn, COLUMNS, COLUMNS)
                begin_at = float((first << doubled) + PER_PASS * part)
                for t in range(traces):
                    if program.traces[t, 1] == experiment:
                        open_ = scan(states[t], run, samples, 2 * program.traces[t, 0], count, final[t], step, deep,
                                     before if part == 0 else deep, begin_at, program.traces[t, 2], least)  # fmt: skip
                        if open_ and not least:
                            unsure = True
                            break
                if unsure:
                    break
            if not unsure:
                break
            doubled += 1
            _keep(program, experiment, states, saved)
        apply(origin, powers[level - doubled + 2], columns[0, 3:], nn, 1, nn, nn, COLUMNS, 1)
        before = level - doubled
