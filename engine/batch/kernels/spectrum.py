"""Loop and path metrics of eight candidates at a time: a scan over frequency, and every crossing and peak polished.

    gain margin: Im L = 0, Re L < 0;  phase margin: |L| = 1;  peaks of |1/(1 + L)|, |L/(1 + L)|, |T|;  bandwidth: |T| = level

The scan is as fine as its table of frequencies; a response that changes too much from one to the next, as at a resonance
narrower than the table resolves, makes its readings doubtful.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.axis_ends import Doubts, doubt_ends
from engine.batch.kernels.compiled import LANES, compiled, merged
from engine.batch.kernels.curves import run_program
from engine.batch.kernels.polishing import (
    ALL,
    CROSS_AXIS,
    CROSS_LEVEL,
    CROSS_UNIT,
    EVENTS,
    NO_EVENT,
    PEAK_S,
    TURN_LEVEL,
    TURN_UNIT,
    polish,
    size_of,
    suspect,
)
from engine.batch.kernels.spectrum_program import (
    AT_REST,
    BANDWIDTH,
    CHUNK,
    COMPLEMENTARY,
    DELAY,
    DOUBT,
    FAINT,
    FAINTEST,
    FALL,
    GAIN,
    GAIN_AT,
    GAIN_MARGIN,
    HIGHEST,
    MS,
    MS_AT,
    PEAK,
    PHASE,
    READINGS,
    SENSITIVITY,
    SMALLEST,
    SpectrumProgram,
)
from engine.batch.kernels.vector import anywhere, lanes_of, load, load2, magnitude, root, select, spread, store, store2

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]


MARKS: Final = 12
_ABRUPT: Final = 0.3
_BEND: Final = 0.1
"""A curve may turn so much further than the parabola through three samples, by their second difference."""
_RIVAL: Final = 0.1


@compiled
def _note(kinds: Real, places: Real, counts: Whole, curves: Real, bits: int, kind: int, place: int, curve: int) -> int:
    """Enter an event for the lanes of ``bits``; return the lanes whose list is full."""
    full = 0
    for lane in range(LANES):
        if (bits >> lane) & 1:
            if counts[lane] < EVENTS:
                kinds[counts[lane], lane], places[counts[lane], lane], curves[counts[lane], lane] = kind, place, curve
                counts[lane] += 1
            else:
                full |= 1 << lane
    return full


@compiled
def spectrum(
    program: SpectrumProgram, registers: Real, readings: Real, store_re: Real, store_im: Real, room: Real, events: Real,
    counts: Whole, omega: Real, marks: Real, levels: Real, points: Real, slots: Real, bracket: Real,
) -> None:  # fmt: skip
    """Fill ``readings`` (curves, READINGS, LANES).

    ``store_re``, ``store_im`` (curves, frequencies, LANES) are room for the curves, ``room`` (2, places, CHUNK, LANES) for
    their calculation, ``events`` (3, EVENTS, LANES) and ``counts`` (LANES,) for what is found, ``omega`` (CHUNK, LANES),
    ``marks`` (MARKS, LANES) and ``levels`` (curves, LANES) for the scan, and the others for `polish`. Where the loop is
    unstable the readings mean nothing.
    """
    total, curves = program.frequencies.shape[0], program.wants.shape[0]
    re, im = room[0], room[1]
    for first in range(0, total, CHUNK):
        for w in range(CHUNK):
            store(omega, program.frequencies[first + w], w)
        run_program(program.scan, registers, omega, program.tables_re, program.tables_im, first, re, im)
        for c in range(curves):
            place = program.scan.targets[c]
            for w in range(CHUNK):
                store2(store_re, load2(re, place, w), c, first + w)
                store2(store_im, load2(im, place, w), c, first + w)
    kinds, at, of = events[0], events[1], events[2]
    most = 0
    for lane in range(LANES):
        counts[lane] = 0
    for c in range(curves):
        _look(program, c, store_re, store_im, readings, levels, kinds, at, counts, of, marks)
    for lane in range(LANES):
        most = max(most, counts[lane])
    for lane in range(LANES):
        for slot in range(counts[lane], most):
            kinds[slot, lane], at[slot, lane], of[slot, lane] = NO_EVENT, 2.0, 0.0
    polish(program, registers, store_re, store_im, readings, levels, events, most, omega, points, slots, bracket)
    for c in range(curves):
        for lane in range(LANES):
            # only fainter crossings: the exact path finds the nearest of them
            if readings[c, GAIN_AT, lane] == FAINT:
                readings[c, GAIN_MARGIN, lane] = math.nan
                suspect(readings, c, lane, float(GAIN))


@compiled
def _look(
    program: SpectrumProgram, c: int, store_re: Real, store_im: Real, readings: Real, level: Real, kinds: Real,
    at: Real, counts: Whole, of: Real, marks: Real,
) -> None:  # fmt: skip
    """Go along one curve and take down its crossings and peaks."""
    wants, last = program.wants[c], program.frequencies.shape[0] - 1
    for k in range(READINGS):
        readings[c, k] = math.inf
    first_re, first_im = load2(store_re, c, 0), load2(store_im, c, 0)
    next_re, next_im = load2(store_re, c, 1), load2(store_im, c, 1)
    static = first_re * first_re + first_im * first_im
    # What still falls with frequency down there has no gain at rest at all.
    static = select(static < 1e-6 * (next_re * next_re + next_im * next_im), 0.0, static)
    store2(readings, root_of(static, first_re), c, AT_REST)
    store(level, static * FALL, c)
    for p in range(3):
        for mark, content in ((0, -1.0), (3, -1.0), (6, 0.0), (9, 0.0)):
            store(marks, content, mark + p)
    full, tallest, doubts = _along(
        wants, last, c, store_re, store_im, readings, static, kinds, at, counts, of, marks
    )  # fmt: skip
    store2(readings, root(tallest), c, HIGHEST)
    doubts = doubt_ends(program, wants, last, c, store_re, store_im, tallest, doubts)
    doubt, phase_doubt, gain_doubt, peak_doubt, level_doubt, high_doubt = doubts
    some = phase_doubt + gain_doubt + peak_doubt + level_doubt + high_doubt
    store2(readings, select(doubt > 0.0, doubt, some), c, DOUBT)
    for lane in range(LANES):
        if (full >> lane) & 1:
            readings[c, DOUBT, lane] = ALL
        _enter_ends(program, wants, last, c, lane, store_re, store_im, readings)
        for p in range(3):
            if wants & (SENSITIVITY << p if p < 2 else PEAK):
                _enter_peak(program, last, c, lane, p, store_re, store_im, readings, kinds, at, counts, of, marks)


@compiled
def _along(
    wants: int, last: int, c: int, store_re: Real, store_im: Real, readings: Real, static: Any, kinds: Real, at: Real,
    counts: Whole, of: Real, marks: Real,
) -> tuple[int, Any, Doubts]:  # fmt: skip
    """Return who has no room for all events, the largest square, and what is doubtful about the samples of one curve."""
    none, reference = spread(0.0), static * FALL
    full, falls, tallest = 0, none, static
    doubts: Doubts = none, none, none, none, none, none
    x1, y1 = load2(store_re, c, 0), load2(store_im, c, 0)
    x2, y2, m1, m2 = x1, y1, static, static
    # whether the loop is larger than 1, counts, lies left and above at the sample before
    before = m1 > 1.0, m1 > SMALLEST * SMALLEST, x1 < 0.0, y1 > 0.0
    distance1 = (1.0 + x1) * (1.0 + x1) + y1 * y1
    distance2 = distance1
    for k in range(1, last + 1):
        x, y = load2(store_re, c, k), load2(store_im, c, k)
        m = x * x + y * y
        if 2 < k < last:
            # |L(k) L(k-2) - L(k-1)²| beside |L(k-1)|², and a turn of more than a quarter
            u = x * x2 - y * y2 - (x1 * x1 - y1 * y1)
            v = x * y2 + y * x2 - 2.0 * x1 * y1
            abrupt = (u * u + v * v > _ABRUPT * _ABRUPT * m1 * m1) | (x * x1 + y * y1 < 0.0)
            abrupt = abrupt & (m1 > SMALLEST * SMALLEST * select(static < 1.0, static, 1.0))
            if anywhere(abrupt):
                doubts = _abruptly(wants, abrupt, (x, y), (x1, y1), m1, static, falls, doubts)
            full |= _turns(wants, k - 1, c, m2, m1, m, reference, falls, kinds, at, counts, of)
            near = magnitude(y1) < magnitude(y - 2.0 * y1 + y2)
            if wants & GAIN and anywhere(near):
                twice = _hidden(y2, y1, y, 0.0) & near & before[2] & before[1]
                doubt, phase, gain, peak, level, high = doubts
                doubts = doubt, phase, select(twice, float(GAIN), gain), peak, level, high
        if wants & (GAIN | PHASE | DELAY):
            here = m > 1.0, m > SMALLEST * SMALLEST, x < 0.0, y > 0.0
            doubt, phase, gain, peak, level, high = doubts
            more, doubt = _crosses(
                wants, k, last, c, before, here, (m1, m), magnitude(y1) > 1e-3 * magnitude(x1), doubt, readings, kinds, at,
                counts, of,
            )  # fmt: skip
            full, before, doubts = full | more, here, (doubt, phase, gain, peak, level, high)
        tallest = select(m > tallest, m, tallest)
        if wants & BANDWIDTH:
            below = (m < reference) & (falls == 0.0)
            if anywhere(below):
                if k in (1, last):
                    doubt, phase, gain, peak, level, high = doubts
                    doubts = select(below, ALL, doubt), phase, gain, peak, level, high
                else:
                    full |= _note(kinds, at, counts, of, lanes_of(below), CROSS_LEVEL, k, c)
                falls = select(below, 1.0, falls)
        if wants & (SENSITIVITY | COMPLEMENTARY | PEAK):
            distance = (1.0 + x) * (1.0 + x) + y * y
            if k > 1:
                _peaks(wants, k - 1, (distance2, distance1, distance), (m2, m1, m), marks)
            distance2, distance1 = distance1, distance
        x2, y2, m2, x1, y1, m1 = x1, y1, m1, x, y, m
    return full, tallest, doubts


@compiled
def _abruptly(
    wants: int, abrupt: Any, here: tuple[Any, Any], before: tuple[Any, Any], m1: Any, static: Any, falls: Any, doubts: Doubts
) -> Doubts:  # fmt: skip
    """Doubt what could hide between two samples that are far apart: the way from one to the next, twice, reaches it."""
    (x, y), (x1, y1) = here, before
    doubt, phase_doubt, gain_doubt, peak_doubt, level_doubt, high_doubt = doubts
    dx, dy = x - x1, y - y1
    way = 4.0 * (dx * dx + dy * dy)
    size = root(m1)
    if wants & (PHASE | DELAY):
        near = abrupt & ((size - 1.0) * (size - 1.0) < way)
        phase_doubt = select(near, float(PHASE + DELAY), phase_doubt)
    if wants & GAIN:
        near = abrupt & (y1 * y1 < way) & ((x1 < 0.0) | (m1 < way)) & (m1 > SMALLEST * SMALLEST)
        gain_doubt = select(near, float(GAIN), gain_doubt)
    if wants & (SENSITIVITY | COMPLEMENTARY):
        distance = (1.0 + x1) * (1.0 + x1) + y1 * y1
        near = abrupt & ((distance < 4.0) | (distance < way))
        peak_doubt = select(near, float(SENSITIVITY + COMPLEMENTARY), peak_doubt)
    if wants & BANDWIDTH:
        gap = size - root(static * FALL)
        level_doubt = select(abrupt & (falls == 0.0) & (gap * gap < way), float(BANDWIDTH), level_doubt)
    if wants & PEAK:
        high_doubt = select(abrupt & (m1 > 0.25 * static), float(PEAK), high_doubt)
    return doubt, phase_doubt, gain_doubt, peak_doubt, level_doubt, high_doubt


@compiled
def _turns(
    wants: int, place: int, c: int, m2: Any, m1: Any, m: Any, reference: Any, falls: Any, kinds: Real, at: Real,
    counts: Whole, of: Real,
) -> int:  # fmt: skip
    """Enter where a square of size turns so near to 1, or to what a bandwidth ends at, that it may pass it twice; return whose list is full."""
    merged()
    full = 0
    if wants & (PHASE | DELAY | BANDWIDTH):
        bend = magnitude(m - 2.0 * m1 + m2)
        near = magnitude(m1 - 1.0) < bend
        if wants & (PHASE | DELAY) and anywhere(near):
            unseen = _hidden(m2, m1, m, 1.0) & near
            if anywhere(unseen):
                full |= _note(kinds, at, counts, of, lanes_of(unseen), TURN_UNIT, place, c)
        near = magnitude(m1 - reference) < bend
        if wants & BANDWIDTH and anywhere(near):
            unseen = _hidden(m2, m1, m, reference) & near & (falls == 0.0)
            if anywhere(unseen):
                full |= _note(kinds, at, counts, of, lanes_of(unseen), TURN_LEVEL, place, c)
    return full


@compiled
def _crosses(
    wants: int, k: int, last: int, c: int, before: tuple[Any, Any, Any, Any], here: tuple[Any, Any, Any, Any],
    squares: tuple[Any, Any], off_axis: Any, doubt: Any, readings: Real, kinds: Real, at: Real, counts: Whole, of: Real,
) -> tuple[int, Any]:  # fmt: skip
    """Enter where a loop passes the unit circle and the negative axis; return whose list is full, and doubt of who does so at the ends.

    ``before`` and ``here`` say whether it is larger than 1, counts, lies left and above.
    """
    merged()
    (over1, counts1, left1, above1), (over, large, left, above), (m1, m) = before, here, squares
    full, passes = 0, over ^ over1
    if k in (1, last):
        doubt = select(passes, ALL, doubt)
    elif wants & (PHASE | DELAY) and anywhere(passes):
        full |= _note(kinds, at, counts, of, lanes_of(passes), CROSS_UNIT, k, c)
    if wants & GAIN:
        passes_left = (above ^ above1) & (left | left1)
        changes = passes_left & (large | counts1)
        faint = passes_left & (m <= SMALLEST * SMALLEST) & (m1 > FAINTEST * FAINTEST) & (m1 <= SMALLEST * SMALLEST)
        if 1 < k < last and anywhere(faint):
            store2(readings, select(faint, FAINT, load2(readings, c, GAIN_AT)), c, GAIN_AT)
        if k in (1, last):
            doubt = select(changes & off_axis, ALL, doubt)
        elif anywhere(changes):
            full |= _note(kinds, at, counts, of, lanes_of(changes), CROSS_AXIS, k, c)
    return full, doubt


@compiled
def _peaks(wants: int, place: int, distances: tuple[Any, Any, Any], squares: tuple[Any, Any, Any], marks: Real) -> None:
    """Keep the two highest peaks of each kind in ``marks``, by three samples around ``place``."""
    merged()
    (distance2, distance1, distance), (m2, m1, m) = distances, squares
    best, second, where, runner_up = marks[0:3], marks[3:6], marks[6:9], marks[9:12]
    for p in range(3):
        if not wants & (SENSITIVITY << p if p < 2 else PEAK):
            continue
        local = (m < m1) & (m2 <= m1)
        if p == 0:
            local = (distance > distance1) & (distance2 >= distance1)
        elif p == 1:
            local = (distance * m1 > distance1 * m) & (distance2 * m1 >= distance1 * m2)
        if anywhere(local):
            # the height of the peak between the samples, from the parabola through the inverse of what peaks
            f0, f1, f2 = _inverse(p, distance2, m2), _inverse(p, distance1, m1), _inverse(p, distance, m)
            vertex = f1 - (f0 - f2) * (f0 - f2) / (8.0 * (f0 - 2.0 * f1 + f2))
            top = select(vertex > 0.0, 1.0 / vertex, 1e300)
            highest, runner = load(best, p), load(second, p)
            wins = local & (top > highest)
            next_best = local & (top > runner) & (top <= highest)
            store(second, select(wins, highest, select(next_best, top, runner)), p)
            behind = select(next_best, float(place), load(runner_up, p))
            store(runner_up, select(wins, load(where, p), behind), p)
            store(best, select(wins, top, highest), p)
            store(where, select(wins, float(place), load(where, p)), p)


@compiled
def _enter_ends(
    program: SpectrumProgram, wants: int, last: int, c: int, lane: int, store_re: Real, store_im: Real, readings: Real
) -> None:  # fmt: skip
    """Enter the gain margin at an end of the axis on which a loop ends at a negative number."""
    for end, beside in ((0, 1), (last, last - 1)):
        if (
            wants & GAIN
            and store_re[c, end, lane] < -SMALLEST
            and store_re[c, end, lane] > 2.0 * store_re[c, beside, lane]  # it is finite there
            and abs(store_im[c, end, lane]) < 1e-3 * abs(store_re[c, end, lane])
            and not abs(math.log(-store_re[c, end, lane])) > abs(math.log(readings[c, GAIN_MARGIN, lane]))
        ):
            readings[c, GAIN_MARGIN, lane] = -1.0 / store_re[c, end, lane]
            readings[c, GAIN_AT, lane] = program.frequencies[end]


@compiled
def _enter_peak(
    program: SpectrumProgram, last: int, c: int, lane: int, p: int, store_re: Real, store_im: Real, readings: Real,
    kinds: Real, at: Real, counts: Whole, of: Real, marks: Real,
) -> None:  # fmt: skip
    """Enter the higher end of the axis, and as events the peaks that may be as high and are polished: those count if they are higher."""
    best, second, where, runner_up = marks[0:3], marks[3:6], marks[6:9], marks[9:12]
    at_rest = size_of(PEAK_S + p, store_re[c, 0, lane], store_im[c, 0, lane])
    ends = max(at_rest, size_of(PEAK_S + p, store_re[c, last, lane], store_im[c, last, lane]))
    k = int(where[p, lane])
    readings[c, MS + p if p < 2 else HIGHEST, lane] = math.sqrt(ends)
    readings[c, MS_AT + p, lane] = program.frequencies[0 if ends == at_rest else last]
    if not best[p, lane] > ends * (1.0 - _RIVAL):
        return
    full = _note(kinds, at, counts, of, 1 << lane, PEAK_S + p, k, c)
    if second[p, lane] > best[p, lane] * (1.0 - _RIVAL):
        full |= _note(kinds, at, counts, of, 1 << lane, PEAK_S + p, int(runner_up[p, lane]), c)
    if full or k < 2 or k > last - 2:
        suspect(readings, c, lane, float(SENSITIVITY << p if p < 2 else PEAK))


@compiled
def _inverse(p: int, distance: Any, square: Any) -> Any:
    """Return the inverse of the square of what peaks, which is a parabola also where a peak is sharp."""
    if p == 0:
        return distance
    return (distance if p == 1 else spread(1.0)) / square


@compiled
def _hidden(left: Any, middle: Any, right: Any, goal: Any) -> Any:
    """Where a curve turns at one of three samples or between them, so near to a level that it may cross it twice unseen.

    The parabola through the samples, half as much again and a tenth of its bend reaches the level; the samples are all on
    one side of it. That can only be where the middle one is nearer to the level than the bend.
    """
    side, bend, way = middle - goal, left - 2.0 * middle + right, right - left
    turns = (magnitude(way) <= 2.0 * magnitude(bend)) & (side * (left - goal) > 0.0) & (side * (right - goal) > 0.0)
    if not anywhere(turns):
        return turns
    beyond = side - 1.5 * (way * way) / (8.0 * bend) - _BEND * bend
    return turns & (side * beyond <= 0.0)


@compiled
def root_of(square: Any, sign: Any) -> Any:
    """Return the root of a square with the sign of a number."""
    return select(sign < 0.0, -1.0, 1.0) * root(square)
