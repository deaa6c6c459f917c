"""A pass of samples of a response, searched for what a metric is read off: levels reached, turning points, ends of swings.

Each sample comes with its slope. Where slopes do not add up to what happened between two samples, or a cubic through them
leaves open whether a level is reached, finer samples are asked for; what stays open at the finest is in doubt.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import apart, compiled
from engine.batch.kernels.scan_state import (
    APART,
    BIG,
    COLUMNS,
    D2,
    DOWN,
    DUE,
    GRAZE2,
    GRAZE5,
    HIGHEST,
    L10,
    L90,
    LOW,
    LOWEST,
    MIXED,
    N2,
    N5,
    N10,
    N90,
    NEVER,
    NONE,
    PER_PASS,
    RISE,
    ROWS,
    SETTLE_2,
    SETTLE_5,
    SLIGHT,
    TOP,
    UP,
    WHEN,
    Y2,
    D,
    Y,
)
from engine.batch.kernels.turning import (
    RUN_ABOVE,
    RUN_BELOW,
    RUN_LOW,
    RUN_N2,
    RUN_N5,
    RUN_STIR,
    RUN_TOP,
    RUN_Y2,
    RUN_Y5,
    biggest,
    limits,
    may_matter,
    outside,
    turns,
    walls,
)
from engine.batch.kernels.vector import anywhere, lanes_of, load, load2, magnitude, select, spread, store

Real = npt.NDArray[np.float64]

_SWING: Final = 0.2
"""The trapezoidal rule misses by s²/12 of the steepest slope where a swing goes on by s rad between samples."""
_RIPPLE: Final = 1e-8
"""What slips by less than this part of the largest value changes no metric that is read here."""
_FAR_BELOW: Final = 5.0
"""What a pass could hide reaches at most so much further than its samples with half a step of their slopes: see `_hides`."""


@compiled
def scan(
    state: Real, run: Real, samples: Real, row: int, stride: int, final: Real, step: Real, level: int, pace: Real,
    begins: bool, start: float, wants: int, least: bool,
) -> int:  # fmt: skip
    """Go through the 16 samples of a pass: ``samples`` (4 * stride, 4, LANES), deviation in ``row``, slope in ``row + 1``.

    They are ``2**level`` steps apart, the first so much after sample number ``start``; those before, where the pass ``begins``
    an octave, as many as ``pace`` (PACES, LANES) says. Return whose finer samples would tell more, lane k in bit k, of those
    whose samples these are; unless ``least``, which are the finest, the rest is left out when that is said of all of them.
    ``run`` (RUN, LANES) is room.
    """
    unit = float(1 << level)
    goal, h = load(final, 0), load(step, 0)
    size, due = magnitude(goal), load(pace, DUE) > 0.0
    everyone, before = lanes_of(due), load(pace, APART) if begins else spread(unit)
    unrisen = select(due & (load(state, L90) == NONE), 1.0, 0.0)
    rising = bool(wants & RISE) and anywhere(unrisen > 0.0)
    up, down = limits(state, size, wants, rising)
    # nothing of the others matters, who have what they need
    up, down = select(due, up, NEVER), select(due, down, NEVER)
    if not rising and _rests(state, samples, row, stride, goal, (0.5 * unit) * h, up, down):
        return 0
    if begins:
        # what was outside its band last begins an interval of the new length
        for bit, f in ((SETTLE_2, N2), (SETTLE_5, N5)):
            if wants & bit:
                first = (load(state, f) == start * unit) & (load(state, f + 1) >= 0.0)
                store(state, select(first, float(level), load(state, f + 1)), f + 1)
    y1 = load(state, Y)
    for field, content in ((RUN_TOP, y1), (RUN_LOW, y1), (RUN_Y2, y1), (RUN_Y5, y1)):
        store(run, content, field)
    for field, number in ((RUN_STIR, 0.0), (RUN_N2, NONE), (RUN_N5, NONE)):
        store(run, number, field)
    above, below = walls(goal, up, down)
    store(run, above, RUN_ABOVE)
    store(run, below, RUN_BELOW)
    unsure, index = 0, 0
    while True:
        index = _sweep(state, run, samples, row, stride, goal, h, level, start, wants, index)
        if index == PER_PASS:
            break
        unsure |= turns(state, run, samples, row, stride, index, final, step, level, before, start, wants)
        if unsure == everyone and not least:
            return unsure
        index += 1
    outside(state, N2, load(run, RUN_N2), load(run, RUN_Y2), float(level))
    outside(state, N5, load(run, RUN_N5), load(run, RUN_Y5), float(level))
    top, low, stir = load(run, RUN_TOP), load(run, RUN_LOW), load(run, RUN_STIR)
    big = biggest(load(state, BIG), top, low, goal)
    _end(state, samples, row, stride)
    store(state, big, BIG)
    if anywhere(stir > _RIPPLE * big):
        highest, lowest = select(goal >= 0.0, top, -low), select(goal >= 0.0, low, -top)
        unsure |= everyone & _hides(state, highest, lowest, stir, size, unrisen, wants, least)
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
        if anywhere(may_matter(y1, d1, y, d, half, above, below)):
            break
        y1, d1, steep1 = y, d, steep
        index += 1
    for field, content in (
        (RUN_TOP, top), (RUN_LOW, low), (RUN_STIR, stir), (RUN_N2, n_2), (RUN_Y2, y_2), (RUN_N5, n_5), (RUN_Y5, y_5)
    ):  # fmt: skip
        store(run, content, field)
    return index


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
    store(state, biggest(load(state, BIG), top, low, goal), BIG)
    return True


@compiled
def _hides(state: Real, highest: Any, lowest: Any, stir: Any, size: Any, unrisen: Any, wants: int, least: bool) -> int:
    """Return in which lanes swings that nobody saw may change a reading, in a pass from ``lowest`` to ``highest``.

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
    return int(lanes_of(matters))
