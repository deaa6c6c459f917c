"""The turning points of a response between its samples: which may matter, and those that do, taken down with their error.

A tip lies where the cubic through two samples and their slopes turns; over two steps at once the cubic misses the sample between
them by 16 times what it errs over one.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, compiled, merged
from engine.batch.kernels.scan_state import (
    BIG,
    D2,
    ENTRY,
    ERROR,
    HIGHEST,
    L10,
    L90,
    LOW,
    LOWEST,
    MIXED,
    N2,
    N5,
    NEVER,
    NONE,
    RANKS,
    RISE,
    ROWS,
    SETTLE_2,
    SETTLE_5,
    SURE,
    TOP,
    Y2,
    D,
    Y,
)
from engine.batch.kernels.vector import anywhere, lanes_of, load, load2, magnitude, select, spread, store

Real = npt.NDArray[np.float64]

_GRAZE: Final = 1e-6
"""A tip so near to the edge of a band, by the band, or as near as the interpolation error, is not decided here."""
_NOISE: Final = 1e-12
_BY_SLOPE: Final = 2.0
"""How many steps a missed slope counts for: it must tell alone where a step is 1 rad and more, in less than that the sample does."""
_FOLD: Final = 16.0
"""Over two steps a cubic misses so many times what it does over one."""
_FAR: Final = 1e-2
"""A turning point that is sure to stay so much below the furthest is no rival of it."""
RUN_TOP, RUN_LOW, RUN_STIR, RUN_N2, RUN_Y2, RUN_N5, RUN_Y5, RUN_ABOVE, RUN_BELOW = range(9)
RUN: Final = 9
"""What a pass has come across so far: extremes, the largest swing, the last samples outside of the bands; and what can matter."""


@compiled
def limits(state: Real, size: Any, wants: int, rising: bool) -> Any:
    """Return how far a turning point must be able to reach to change a reading: up, towards the final value and beyond, and down."""
    limit = spread(NEVER)
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
        up = select(load(state, L90) == NONE, select(load(state, L10) == NONE, -0.95, -0.15) * size, up)
    if wants & LOWEST:
        rival = _rival(state, LOW)
        down = select(rival < down, rival, down)
    return up, down


@compiled
def _rival(state: Real, first: int) -> Any:
    """Return how far a tip must be able to reach to be a rival of the furthest."""
    height = load(state, first)
    return height - _FAR * magnitude(height) - SURE * load(state, first + 3)


@compiled
def walls(goal: Any, up: Any, down: Any) -> Any:
    """Return the deviations above and below which a turning point may matter."""
    onwards = goal >= 0.0
    return select(onwards, up, down), -select(onwards, down, up)


@compiled
def may_matter(y1: Any, d1: Any, y: Any, d: Any, half: Any, above: Any, below: Any) -> Any:
    """Whether a response turns between two samples so far up, or down, that it may matter: the deviation rises, or falls, first."""
    merged()
    steep1, steep = magnitude(d1), magnitude(d)
    further = half * select(steep > steep1, steep, steep1)
    high, low = select(y > y1, y, y1) + further, select(y < y1, y, y1) - further
    return (d1 * d < 0.0) & (((d1 > 0.0) & (high > above)) | ((d > 0.0) & (low < below)))


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
            if state[f, lane] == NONE and reached < part * size and highest + SURE * error >= part * size:
                state[MIXED, lane] = 1.0
                unsure = True
    for bit, f, part in ((SETTLE_2, N2, 0.02), (SETTLE_5, N5, 0.05)):
        band = part * size
        margin = _GRAZE * band + SURE * error
        if wants & bit and abs(tip) > band - margin and abs(y) <= band:
            state[f, lane], state[f + 1, lane], state[f + 2, lane] = n, level, 1.0
            state[f + 3, lane] = -1.0 if tip > 0.0 else 1.0
            state[f + 4, lane] = 1.0 if abs(tip) < band + margin else 0.0
            unsure = unsure or (abs(tip) < band + margin and SURE * error > _GRAZE * band)
    return unsure


@compiled
def turns(
    state: Real, run: Real, samples: Real, row: int, stride: int, index: int, final: Real, step: Real, level: int,
    before: Any, start: float, wants: int,
) -> int:  # fmt: skip
    """Take down the turning points in the interval that ends with sample ``index``; return whose finer samples would tell more, lane k in bit k.

    From there on only turning points matter that are rivals of these.
    """
    unit, h, goal = float(1 << level), load(step, 0), load(final, 0)
    at, column = row + (index % ROWS) * stride, index // ROWS
    at_before, column_before = row + ((index - 1) % ROWS) * stride, (index - 1) // ROWS
    y, d, y1, d1 = load2(samples, at, column), load2(samples, at + 1, column), load(state, Y), load(state, D)
    if index > 0:
        y1, d1 = load2(samples, at_before, column_before), load2(samples, at_before + 1, column_before)
    turning = may_matter(y1, d1, y, d, (0.5 * unit) * h, load(run, RUN_ABOVE), load(run, RUN_BELOW))
    # a response at rest turns at every sample, by rounding
    big = biggest(load(state, BIG), load(run, RUN_TOP), load(run, RUN_LOW), goal)
    turning = turning & (unit * h * magnitude(d1 - d) > _NOISE * big)
    if not anywhere(turning):
        return 0
    if start + index == 0.0:
        # in the first step of all, how slopes add up must do
        store(state, magnitude(y - y1 - (0.5 * unit) * h * (d + d1)) * (1.0 / 16.0), ERROR)
    else:
        _miss(state, samples, row, stride, index, y1, d1, y, d, unit, before, h)
    # a tip comes after the samples that were outside until then
    outside(state, N2, load(run, RUN_N2), load(run, RUN_Y2), float(level))
    outside(state, N5, load(run, RUN_N5), load(run, RUN_Y5), float(level))
    store(run, NONE, RUN_N2)
    store(run, NONE, RUN_N5)
    bits, unsure = lanes_of(turning), 0
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
                unsure |= 1 << lane
    rising = bool(wants & RISE) and anywhere(turning & (load(state, L90) == NONE))
    up, down = limits(state, magnitude(goal), wants, rising)
    above, below = walls(goal, up, down)
    store(run, select(turning, above, load(run, RUN_ABOVE)), RUN_ABOVE)
    store(run, select(turning, below, load(run, RUN_BELOW)), RUN_BELOW)
    return unsure


@compiled
def _miss(
    state: Real, samples: Real, row: int, stride: int, index: int, y1: Any, d1: Any, y: Any, d: Any, unit: float,
    before: Any, h: Any,
) -> None:  # fmt: skip
    """Put down by how much interpolation errs over the step that ends with sample ``index``, where y1 was before it, with slope d1.

    Cubic interpolation over the two steps to both sides of the sample before errs so much more than that over one. Of a sine
    A sin(φ + ω t) it misses that sample by A s⁴/24 sin φ and its slope by A ω s⁴/120 cos φ, s = ω times a step: wherever in its swing
    the sample lies, one of them tells.
    """
    y2, d2 = load(state, Y2), load(state, D2)
    if index == 1:
        y2, d2 = load(state, Y), load(state, D)
    elif index > 1:
        at = row + ((index - 2) % ROWS) * stride
        y2, d2 = load2(samples, at, (index - 2) // ROWS), load2(samples, at + 1, (index - 2) // ROWS)
    w2 = before if index == 0 else spread(unit)
    theta, ratio = w2 / (w2 + unit), unit / w2
    rest = 1.0 - theta
    wide = (w2 + unit) * h
    middle = (
        (1.0 + 2.0 * theta) * rest * rest * y2 + theta * rest * rest * wide * d2
        + theta * theta * (3.0 - 2.0 * theta) * y - theta * theta * rest * wide * d
    )  # fmt: skip
    slope = 6.0 * theta * rest * (y - y2) / wide + rest * (1.0 - 3.0 * theta) * d2 + theta * (3.0 * theta - 2.0) * d
    missed = magnitude(middle - y1) + (_BY_SLOPE * unit) * h * magnitude(slope - d1)
    store(state, (ratio * ratio / _FOLD) * missed, ERROR)


@compiled
def outside(state: Real, f: int, n: Any, y: Any, level: float) -> None:
    """Take down the last samples that lay outside a band: where, and the deviation there; nowhere is no place."""
    out = n >= 0.0
    if anywhere(out):
        store(state, select(out, n, load(state, f)), f)
        store(state, select(out, level, load(state, f + 1)), f + 1)
        store(state, select(out, 0.0, load(state, f + 2)), f + 2)
        store(state, select(out, select(y > 0.0, -1.0, 1.0), load(state, f + 3)), f + 3)
        store(state, select(out, 0.0, load(state, f + 4)), f + 4)


@compiled
def biggest(big: Any, top: Any, low: Any, goal: Any) -> Any:
    """Return the largest absolute value so far, from the extremes of the deviation."""
    above, below = magnitude(top + goal), magnitude(low + goal)
    larger = select(above > below, above, below)
    return select(larger > big, larger, big)
