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

from engine.batch.kernels.compiled import LANES, compiled
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
_AHEAD: Final = 2.5
"""A peak is hidden at an end of the axis if it lies at less than a little more than the first frequency, by the parabola."""
_SLIGHT: Final = 1e-9
_STEEPEST: Final = 6
"""Curves rise and fall with the sixth power of frequency at most; what is steeper is left to the exact path."""
_NOTHING: Final = 1e-12
"""What has fallen so far below 1 (a loop) or the tallest (a path), by its square, decides nothing beyond."""
_ASKEW: Final = 0.3
"""What leads to an end of the axis has come to one of the axes of the plane up to this."""
_ON_THE_WAY: Final = 0.1
"""By so much the power may differ from a whole number: what lies beyond is at least four times as far away."""


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
    crossings, peaks = wants & (GAIN | PHASE | DELAY), wants & (SENSITIVITY | COMPLEMENTARY | PEAK)
    for k in range(READINGS):
        readings[c, k] = math.inf
    first_re, first_im = load2(store_re, c, 0), load2(store_im, c, 0)
    next_re, next_im = load2(store_re, c, 1), load2(store_im, c, 1)
    beside = next_re * next_re + next_im * next_im
    static = first_re * first_re + first_im * first_im
    # What still falls with frequency down there has no gain at rest at all.
    static = select(static < 1e-6 * beside, 0.0, static)
    store2(readings, root_of(static, first_re), c, AT_REST)
    reference = static * FALL
    store(level, reference, c)
    full = 0
    falls, tallest = spread(0.0), static
    doubt, phase_doubt, gain_doubt = spread(0.0), spread(0.0), spread(0.0)
    peak_doubt, level_doubt, high_doubt = spread(0.0), spread(0.0), spread(0.0)
    x2, y2 = first_re, first_im
    x1, y1 = first_re, first_im
    m1, m2 = static, static
    best, second, where, runner_up = marks[0:3], marks[3:6], marks[6:9], marks[9:12]
    for p in range(3):
        for mark, content in ((best, -1.0), (second, -1.0), (where, 0.0), (runner_up, 0.0)):
            store(mark, content, p)
    # whether the loop is larger than 1, counts, lies left and above at the sample before
    over1, counts1, left1, above1 = m1 > 1.0, m1 > SMALLEST * SMALLEST, x1 < 0.0, y1 > 0.0
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
            if anywhere(abrupt & (m1 > SMALLEST * SMALLEST * select(static < 1.0, static, 1.0))):
                # Only where something could hide between two samples: the way from one to the next, twice, reaches it.
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
                    gap = size - root(reference)
                    level_doubt = select(abrupt & (falls == 0.0) & (gap * gap < way), float(BANDWIDTH), level_doubt)
                if wants & PEAK:
                    high_doubt = select(abrupt & (m1 > 0.25 * static), float(PEAK), high_doubt)
        if 2 < k < last:
            if wants & (PHASE | DELAY | BANDWIDTH):
                bend = magnitude(m - 2.0 * m1 + m2)
                if wants & (PHASE | DELAY) and anywhere(magnitude(m1 - 1.0) < bend):
                    unseen = _hidden(m2, m1, m, 1.0)
                    if anywhere(unseen):
                        full |= _note(kinds, at, counts, of, lanes_of(unseen), TURN_UNIT, k - 1, c)
                if wants & BANDWIDTH and anywhere(magnitude(m1 - reference) < bend):
                    unseen = _hidden(m2, m1, m, reference) & (falls == 0.0)
                    if anywhere(unseen):
                        full |= _note(kinds, at, counts, of, lanes_of(unseen), TURN_LEVEL, k - 1, c)
            if wants & GAIN and anywhere(magnitude(y1) < magnitude(y - 2.0 * y1 + y2)):
                twice = _hidden(y2, y1, y, 0.0) & left1 & counts1
                gain_doubt = select(twice, float(GAIN), gain_doubt)
        if crossings:
            over = m > 1.0
            passes = over ^ over1
            over1 = over
            if k in (1, last):
                doubt = select(passes, ALL, doubt)
            elif wants & (PHASE | DELAY) and anywhere(passes):
                full |= _note(kinds, at, counts, of, lanes_of(passes), CROSS_UNIT, k, c)
            if wants & GAIN:
                above, left, large = y > 0.0, x < 0.0, m > SMALLEST * SMALLEST
                passes_left = (above ^ above1) & (left | left1)
                changes = passes_left & (large | counts1)
                faint = (
                    passes_left & (m <= SMALLEST * SMALLEST) & (m1 > FAINTEST * FAINTEST) & (m1 <= SMALLEST * SMALLEST)
                )
                if 1 < k < last and anywhere(faint):
                    store2(readings, select(faint, FAINT, load2(readings, c, GAIN_AT)), c, GAIN_AT)
                above1, left1, counts1 = above, left, large
                if k in (1, last):
                    doubt = select(changes & (magnitude(y1) > 1e-3 * magnitude(x1)), ALL, doubt)
                elif anywhere(changes):
                    full |= _note(kinds, at, counts, of, lanes_of(changes), CROSS_AXIS, k, c)
        tallest = select(m > tallest, m, tallest)
        if wants & BANDWIDTH:
            below = (m < reference) & (falls == 0.0)
            if anywhere(below):
                if k in (1, last):
                    doubt = select(below, ALL, doubt)
                else:
                    full |= _note(kinds, at, counts, of, lanes_of(below), CROSS_LEVEL, k, c)
                falls = select(below, 1.0, falls)
        if peaks:
            distance = (1.0 + x) * (1.0 + x) + y * y
            for p in range(3):
                if k == 1 or not wants & (SENSITIVITY << p if p < 2 else PEAK):
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
                    place = load(runner_up, p)
                    store(runner_up, select(wins, load(where, p), select(next_best, float(k - 1), place)), p)
                    store(best, select(wins, top, highest), p)
                    store(where, select(wins, float(k - 1), load(where, p)), p)
            distance2, distance1 = distance1, distance
        x2, y2, m2, x1, y1, m1 = x1, y1, m1, x, y, m
    store2(readings, root(tallest), c, HIGHEST)
    for end, beside, next_, third in ((0, 1, 2, 3), (last, last - 1, last - 2, last - 3)):
        ratio = program.frequencies[next_] / program.frequencies[beside]
        ratio = ratio * ratio if end == 0 else 1.0 / (ratio * ratio)
        distance = program.frequencies[end] / program.frequencies[beside]
        distance = distance * distance if end == 0 else 1.0 / (distance * distance)
        near = _squared(store_re, store_im, c, beside, 2)
        x, y = load2(store_re, c, end), load2(store_im, c, end)
        arrived = _arrived(x, y, near, _squared(store_re, store_im, c, next_, 2), ratio, distance)
        if end > 0:
            arrived = arrived | (near <= _NOTHING * (tallest if wants & (BANDWIDTH | PEAK) else spread(1.0)))
        doubt = select(arrived, doubt, ALL)
        for p in range(3):
            if not wants & (SENSITIVITY << p if p < 2 else PEAK | PHASE | DELAY):
                continue
            rest, near = _squared(store_re, store_im, c, end, p), _squared(store_re, store_im, c, beside, p)
            beyond = _squared(store_re, store_im, c, next_, p), _squared(store_re, store_im, c, third, p)
            excess = _excess(rest, near, beyond, ratio)
            if p < 2:
                peak_doubt = select(excess > 0.0, float(SENSITIVITY + COMPLEMENTARY), peak_doubt)
            else:
                high_doubt = select(excess > 0.0, float(PEAK), high_doubt)
                passes = (rest < 1.0) & (rest * (1.0 + 2.0 * excess) > 1.0)
                phase_doubt = select(passes & (excess > 0.0), float(PHASE + DELAY), phase_doubt)
    some = phase_doubt + gain_doubt + peak_doubt + level_doubt + high_doubt
    store2(readings, select(doubt > 0.0, doubt, some), c, DOUBT)
    for lane in range(LANES):
        if (full >> lane) & 1:
            readings[c, DOUBT, lane] = ALL
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
        for p in range(3):
            if not wants & (SENSITIVITY << p if p < 2 else PEAK):
                continue
            to = MS + p if p < 2 else HIGHEST
            at_rest = size_of(PEAK_S + p, store_re[c, 0, lane], store_im[c, 0, lane])
            ends = max(at_rest, size_of(PEAK_S + p, store_re[c, last, lane], store_im[c, last, lane]))
            k = int(where[p, lane])
            # a peak that may be as high as an end of the axis is polished, and counts if it is higher
            inside = best[p, lane] > ends * (1.0 - _RIVAL)
            readings[c, to, lane] = math.sqrt(ends)
            readings[c, MS_AT + p, lane] = program.frequencies[0 if ends == at_rest else last]
            if not inside:
                continue
            bit = float(SENSITIVITY << p if p < 2 else PEAK)
            full = _note(kinds, at, counts, of, 1 << lane, PEAK_S + p, k, c)
            rival = second[p, lane] > best[p, lane] * (1.0 - _RIVAL)
            if rival:
                full |= _note(kinds, at, counts, of, 1 << lane, PEAK_S + p, int(runner_up[p, lane]), c)
            if full or k < 2 or k > last - 2:
                suspect(readings, c, lane, bit)


@compiled
def _inverse(p: int, distance: Any, square: Any) -> Any:
    """Return the inverse of the square of what peaks, which is a parabola also where a peak is sharp."""
    if p == 0:
        return distance
    return (distance if p == 1 else spread(1.0)) / square


@compiled
def _squared(store_re: Real, store_im: Real, c: int, k: int, p: int) -> Any:
    """Return |1/(1 + L)|², |L/(1 + L)|² or |T|² at one frequency."""
    x, y = load2(store_re, c, k), load2(store_im, c, k)
    square, distance = x * x + y * y, (1.0 + x) * (1.0 + x) + y * y
    if p == 2:
        return square
    return (square if p == 1 else spread(1.0)) / distance


@compiled
def _arrived(x: Any, y: Any, near: Any, next_: Any, ratio: float, distance: float) -> Any:
    """Whether the samples beside an end of the axis follow the power of frequency that leads to x + jy at the end.

    A square w^n, w = ω² (at the other end 1/ω²), grows by ratio^n from the sample beside the end to the next, and by
    distance^n to the end, where the curve is real if n is even and imaginary if it is odd. One that does not has poles or
    zeros between them.
    """
    rest, steepness = x * x + y * y, (next_ - near) / (next_ + near)
    found = rest < 0.0
    to_next, to_end = ratio ** float(-_STEEPEST), distance ** float(-_STEEPEST)
    for power in range(-_STEEPEST, _STEEPEST + 1):
        matches = magnitude(steepness - (to_next - 1.0) / (to_next + 1.0)) < _ON_THE_WAY * (ratio - 1.0) / (ratio + 1.0)
        across, along = (x, y) if power & 1 else (y, x)
        straight = magnitude(across) < _ASKEW * magnitude(along)
        found = found | (matches & straight & (rest > 0.8 * to_end * near) & (rest < 1.25 * to_end * near))
        to_next, to_end = to_next * ratio, to_end * distance
    return found


@compiled
def _excess(rest: Any, near: Any, beyond: tuple[Any, Any], ratio: float) -> Any:
    """Return by which part a curve may rise above an end of the axis before the first sample beside it; 0 where it does not.

    With w = ω² in units of the sample's (at the other end 1/ω²) the square is rest (1 + a w + b w² + c w³), through the
    samples at 1, ratio and ratio². Without c a peak far before the first of them, where a is small beside b, would be lost.
    """
    first, second = near / rest - 1.0, (beyond[0] / rest - 1.0) / ratio
    third = (beyond[1] / rest - 1.0) / (ratio * ratio)
    near_slope, far_slope = (second - first) / (ratio - 1.0), (third - second) / (ratio * (ratio - 1.0))
    c = (far_slope - near_slope) / (ratio * ratio - 1.0)
    b = near_slope - c * (1.0 + ratio)
    a = first - b - c
    return select((a > 0.0) & (b < 0.0) & (a < -_AHEAD * b), a * a / (-4.0 * b), 0.0) - _SLIGHT


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
