"""Loop and path metrics of eight candidates at a time: a scan over frequency, and every crossing and peak polished.

    gain margin: Im L = 0, Re L < 0;  phase margin: |L| = 1;  peaks of |1/(1 + L)|, |L/(1 + L)|, |T|;  bandwidth: |T| = level

The scan is as fine as its table of frequencies; a response that changes too much from one to the next, as at a resonance
narrower than the table resolves, makes its readings doubtful.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.kernels.compiled import LANES, compiled
from engine.kernels.curves import run_point, run_program
from engine.kernels.transfer import FrequencyProgram
from engine.kernels.vector import anywhere, lanes_of, load, load2, magnitude, root, select, spread, store, store2

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]

GAIN: Final = 1
PHASE: Final = 2
DELAY: Final = 4
SENSITIVITY: Final = 8
COMPLEMENTARY: Final = 16
BANDWIDTH: Final = 32
PEAK: Final = 64

(
    GAIN_MARGIN, PHASE_MARGIN, DELAY_MARGIN, MS, MT, FIRST_FALL, HIGHEST, AT_REST, DOUBT,
    GAIN_AT, PHASE_AT, DELAY_AT, MS_AT, MT_AT, HIGHEST_AT,
) = range(15)  # fmt: skip
READINGS: Final = 15
"""What is read off one curve, and at which frequency it is, rad/s; DOUBT is the sum of the bits above that are not vouched for.
Infinite where nothing crosses."""

CHUNK: Final = 16
MARKS: Final = CHUNK + 11 + 18
"""Frequencies are done so many at a time, so that all functions of a program stay in the nearest cache."""
FALL: Final = 10.0**-0.3
_SMALLEST: Final = 1e-3
_ABRUPT: Final = 0.3
_BEND: Final = 0.1
"""A curve may turn so much further than the parabola through three samples, by their second difference."""
_RIVAL: Final = 0.1
EVENTS: Final = 12
_TURNS: Final = 9
_AGREED: Final = 1e-6
"""Relative step after which the next point is final; the value at a peak depends on the square of what is left."""
_ALL: Final = 127.0
_CROSS_UNIT, _CROSS_AXIS, _CROSS_LEVEL, _PEAK_S, _PEAK_T, _PEAK_H, _NO_EVENT = range(7)
_BRACKET: Final = 11


class SpectrumProgram(NamedTuple):
    """The scan with its tables (tables, frequencies) and the same functions without them; ``wants`` (curves,) bits above.

    The first and last frequency stand for 0 and infinity.
    """

    scan: FrequencyProgram
    points: FrequencyProgram
    frequencies: Real
    tables_re: Real
    tables_im: Real
    wants: Whole


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
def _size(kind: int, x: float, y: float) -> float:
    """Return what a peak is a peak of: |1/(1 + L)|², |L/(1 + L)|² or |T|²."""
    square = x * x + y * y
    if kind == _PEAK_H:
        return square
    distance = (1.0 + x) * (1.0 + x) + y * y
    return 1.0 / distance if kind == _PEAK_S else square / distance


@compiled
def spectrum(
    program: SpectrumProgram, registers: Real, readings: Real, store_re: Real, store_im: Real, room: Real, events: Real,
    counts: Whole, aside: Real, point: Real,
) -> None:  # fmt: skip
    """Fill ``readings`` (curves, READINGS, LANES).

    ``store_re``, ``store_im`` (curves, frequencies, LANES) are room for the curves, ``room`` (2, places, CHUNK, LANES) for
    their calculation, ``events`` (3, EVENTS, LANES) and ``counts`` (LANES,) for what is found,
    ``aside`` (MARKS + curves, LANES) and ``point`` (4, places, LANES) for the rest. Where the loop is unstable
    the readings mean nothing.
    """
    total, curves = program.frequencies.shape[0], program.wants.shape[0]
    re, im = room[0], room[1]
    omega, bracket, marks, level = aside[:CHUNK], aside[CHUNK:], aside[CHUNK + _BRACKET :], aside[MARKS:]
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
        _look(program, c, store_re, store_im, readings, level, kinds, at, counts, of, marks)
    for lane in range(LANES):
        most = max(most, counts[lane])
    for lane in range(LANES):
        for slot in range(counts[lane], most):
            kinds[slot, lane], at[slot, lane], of[slot, lane] = _NO_EVENT, 2.0, 0.0
    for slot in range(most):
        _polish(
            program, registers, store_re, store_im, readings, level, kinds[slot], at[slot], of[slot], point, bracket
        )


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
    before1, before2 = marks[12:15], marks[15:18]
    for p in range(3):
        for lane in range(LANES):
            best[p, lane], second[p, lane], before2[p, lane] = -1.0, -1.0, -1.0
            where[p, lane], runner_up[p, lane] = 0.0, 0.0
            before1[p, lane] = 1.0 / _size(_PEAK_S + p, store_re[c, 0, lane], store_im[c, 0, lane])
    for k in range(1, last + 1):
        x, y = load2(store_re, c, k), load2(store_im, c, k)
        m = x * x + y * y
        if 2 < k < last:
            # |L(k) L(k-2) - L(k-1)²| beside |L(k-1)|², and a turn of more than a quarter
            u = x * x2 - y * y2 - (x1 * x1 - y1 * y1)
            v = x * y2 + y * x2 - 2.0 * x1 * y1
            abrupt = (u * u + v * v > _ABRUPT * _ABRUPT * m1 * m1) | (x * x1 + y * y1 < 0.0)
            if anywhere(abrupt & (m1 > _SMALLEST * _SMALLEST * select(static < 1.0, static, 1.0))):
                # Only where something could hide between two samples: the way from one to the next, twice, reaches it.
                dx, dy = x - x1, y - y1
                way = 4.0 * (dx * dx + dy * dy)
                size = root(m1)
                if wants & (PHASE | DELAY):
                    near = abrupt & ((size - 1.0) * (size - 1.0) < way)
                    phase_doubt = select(near, float(PHASE + DELAY), phase_doubt)
                if wants & GAIN:
                    near = abrupt & (y1 * y1 < way) & ((x1 < 0.0) | (m1 < way)) & (m1 > _SMALLEST * _SMALLEST)
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
            if wants & (PHASE | DELAY):
                phase_doubt = select(_hidden(m2, m1, m, 1.0), float(PHASE + DELAY), phase_doubt)
            if wants & GAIN:
                twice = _hidden(y2, y1, y, 0.0) & (x1 < 0.0) & (m1 > _SMALLEST * _SMALLEST)
                gain_doubt = select(twice, float(GAIN), gain_doubt)
            if wants & BANDWIDTH:
                level_doubt = select(_hidden(m2, m1, m, reference) & (falls == 0.0), float(BANDWIDTH), level_doubt)
        if crossings:
            passes = ((m > 1.0) & (m1 <= 1.0)) | ((m <= 1.0) & (m1 > 1.0))
            if k in (1, last):
                doubt = select(passes, _ALL, doubt)
            elif wants & (PHASE | DELAY) and anywhere(passes):
                full |= _note(kinds, at, counts, of, lanes_of(passes), _CROSS_UNIT, k, c)
            if wants & GAIN:
                changes = ((y > 0.0) & (y1 <= 0.0)) | ((y <= 0.0) & (y1 > 0.0))
                changes = (
                    changes & ((x < 0.0) | (x1 < 0.0)) & ((m > _SMALLEST * _SMALLEST) | (m1 > _SMALLEST * _SMALLEST))
                )
                if k in (1, last):
                    doubt = select(changes & (magnitude(y1) > 1e-3 * magnitude(x1)), _ALL, doubt)
                elif anywhere(changes):
                    full |= _note(kinds, at, counts, of, lanes_of(changes), _CROSS_AXIS, k, c)
        if wants & BANDWIDTH:
            tallest = select(m > tallest, m, tallest)
            below = (m < reference) & (falls == 0.0)
            if anywhere(below):
                if k in (1, last):
                    doubt = select(below, _ALL, doubt)
                else:
                    full |= _note(kinds, at, counts, of, lanes_of(below), _CROSS_LEVEL, k, c)
                falls = select(below, 1.0, falls)
        if peaks:
            distance = (1.0 + x) * (1.0 + x) + y * y
            for p in range(3):
                if not wants & (SENSITIVITY << p if p < 2 else PEAK):
                    continue
                # the inverse of what peaks, a parabola also where a peak is sharp
                inverse = distance if p == 0 else (distance if p == 1 else spread(1.0)) / m
                highest, runner, f1, f0 = load(best, p), load(second, p), load(before1, p), load(before2, p)
                local = (inverse > f1) & (f0 >= f1)
                if anywhere(local):
                    # the height of the peak between the samples, from the parabola
                    vertex = f1 - (f0 - inverse) * (f0 - inverse) / (8.0 * (f0 - 2.0 * f1 + inverse))
                    top = select(vertex > 0.0, 1.0 / vertex, 1e300)
                    wins = local & (top > highest)
                    next_best = local & (top > runner) & (top <= highest)
                    store(second, select(wins, highest, select(next_best, top, runner)), p)
                    place = load(runner_up, p)
                    store(runner_up, select(wins, load(where, p), select(next_best, float(k - 1), place)), p)
                    store(best, select(wins, top, highest), p)
                    store(where, select(wins, float(k - 1), load(where, p)), p)
                store(before2, f1, p)
                store(before1, inverse, p)
        x2, y2, m2, x1, y1, m1 = x1, y1, m1, x, y, m
    store2(readings, root(tallest), c, HIGHEST)
    some = phase_doubt + gain_doubt + peak_doubt + level_doubt + high_doubt
    store2(readings, select(doubt > 0.0, doubt, some), c, DOUBT)
    for lane in range(LANES):
        if (full >> lane) & 1:
            readings[c, DOUBT, lane] = _ALL
        if (
            wants & GAIN
            and store_re[c, 0, lane] < -_SMALLEST
            and store_re[c, 0, lane] > 2.0 * store_re[c, 1, lane]  # it is finite at rest
            and abs(store_im[c, 0, lane]) < 1e-3 * abs(store_re[c, 0, lane])
        ):
            readings[c, GAIN_MARGIN, lane] = -1.0 / store_re[c, 0, lane]
            readings[c, GAIN_AT, lane] = program.frequencies[0]
        for p in range(3):
            if not wants & (SENSITIVITY << p if p < 2 else PEAK):
                continue
            to = MS + p if p < 2 else HIGHEST
            at_rest = _size(_PEAK_S + p, store_re[c, 0, lane], store_im[c, 0, lane])
            ends = max(at_rest, _size(_PEAK_S + p, store_re[c, last, lane], store_im[c, last, lane]))
            k = int(where[p, lane])
            # a peak that may be as high as an end of the axis is polished, and counts if it is higher
            inside = best[p, lane] > ends * (1.0 - _RIVAL)
            readings[c, to, lane] = math.sqrt(ends)
            readings[c, MS_AT + p, lane] = program.frequencies[0 if ends == at_rest else last]
            if not inside:
                continue
            bit = float(SENSITIVITY << p if p < 2 else PEAK)
            full = _note(kinds, at, counts, of, 1 << lane, _PEAK_S + p, k, c)
            rival = second[p, lane] > best[p, lane] * (1.0 - _RIVAL)
            if rival:
                full |= _note(kinds, at, counts, of, 1 << lane, _PEAK_S + p, int(runner_up[p, lane]), c)
            if full or k < 2 or k > last - 2:
                _suspect(readings, c, lane, bit)


@compiled
def _suspect(readings: Real, c: int, lane: int, bit: float) -> None:
    """Mark one kind of reading as doubtful."""
    if readings[c, DOUBT, lane] < _ALL and int(readings[c, DOUBT, lane]) & int(bit) == 0:
        readings[c, DOUBT, lane] += bit


@compiled
def _hidden(left: Any, middle: Any, right: Any, goal: Any) -> Any:
    """Where a curve turns at the middle of three samples, so near to a level that it may cross it twice unseen.

    The parabola through the samples, half as much again and a tenth of its bend reaches the level; the samples are all on
    one side of it.
    """
    bend = left - 2.0 * middle + right
    tip = middle - (right - left) * (right - left) / (8.0 * bend)
    beyond = tip + 0.5 * (tip - middle) - _BEND * bend
    turns = (middle - left) * (middle - right) > 0.0
    side = middle - goal
    return turns & (side * (left - goal) > 0.0) & (side * (right - goal) > 0.0) & (side * (beyond - goal) <= 0.0)


@compiled
def root_of(square: Any, sign: Any) -> Any:
    """Return the root of a square with the sign of a number."""
    return select(sign < 0.0, -1.0, 1.0) * root(square)


@compiled
def _inverse(kind: Any, x: Any, y: Any, level: Any) -> Any:
    """Return what is 0 at a crossing, or smallest at a peak: there the inverse, a parabola also where a peak is sharp."""
    square = x * x + y * y
    distance = square + 2.0 * x + 1.0
    mark = select(kind == float(_CROSS_UNIT), 1.0, level)
    found = (square - mark) / (square + mark)
    found = select(kind == float(_CROSS_AXIS), y, found)
    found = select(kind == float(_PEAK_S), distance, found)
    found = select(kind == float(_PEAK_T), distance / square, found)
    return select(kind == float(_PEAK_H), 1.0 / square, found)


@compiled
def _polish(
    program: SpectrumProgram, registers: Real, store_re: Real, store_im: Real, readings: Real, levels: Real, kinds: Real,
    at: Real, of: Real, room: Real, bracket: Real,
) -> None:  # fmt: skip
    """Polish one event of every lane and enter what it says into its readings.

    ``kinds``, ``at``, ``of`` (LANES,) say what lies behind which frequency of which curve; crossings are found by Newton's
    method, peaks by the secant method on the slope of the inverse, which begins with the curvature of three samples.
    """
    for lane in range(LANES):
        k, c = int(at[lane]), int(of[lane])
        ahead = 1 if kinds[lane] >= _PEAK_S else 0
        for row in range(3):
            there = k - 1 + row if row < 2 else k + ahead
            bracket[row, lane] = program.frequencies[there]
            bracket[3 + row, lane] = store_re[c, there, lane]
            bracket[6 + row, lane] = store_im[c, there, lane]
        bracket[9, lane] = levels[c, lane]
    kind, curve, level = load(kinds, 0), load(of, 0), load(bracket, 9)
    w0, w1, w2 = load(bracket, 0), load(bracket, 1), load(bracket, 2)
    f0 = _inverse(kind, load(bracket, 3), load(bracket, 6), level)
    f1 = _inverse(kind, load(bracket, 4), load(bracket, 7), level)
    f2 = _inverse(kind, load(bracket, 5), load(bracket, 8), level)
    peak = (kind >= float(_PEAK_S)) & (kind <= float(_PEAK_H))
    # between two samples the straight line, between three the parabola; there also the curvature
    line = w0 - f0 * (w1 - w0) / (f1 - f0)
    before, after = (f1 - f0) / (w1 - w0), (f2 - f1) / select(peak, w2 - w1, 1.0)
    second = 2.0 * (after - before) / select(peak, w2 - w0, 1.0)
    vertex = 0.5 * (w0 + w1) - before / second
    low, high = w0, w2
    here = select(peak, vertex, line)
    here = select((here > low) & (here < high), here, 0.5 * (low + high))
    # at a peak of |T| the slope of the square is followed, which falls; elsewhere what rises if the samples do
    height = load(bracket, 4) * load(bracket, 4) + load(bracket, 7) * load(bracket, 7)
    steep = select(
        kind == float(_PEAK_S),
        second,
        select(kind == float(_PEAK_T), height * height * second, -(height * height * second)),
    )
    rising = select(kind == float(_PEAK_H), -1.0, select(peak, 1.0, select(f1 > f0, 1.0, -1.0)))
    omega = bracket[_BRACKET - 1 : _BRACKET]
    store(omega, here, 0)
    moving = select(kind == float(_NO_EVENT), 0.0, 1.0)
    last, f_last = here, spread(0.0)
    re, im, dre, dim = room[0], room[1], room[2], room[3]
    turn = 0
    while True:
        run_point(program.points, registers, omega, re, im, dre, dim)
        x, y, dx, dy = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
        for c in range(program.wants.shape[0]):
            place, mine = program.points.targets[c], curve == float(c)
            x, y = select(mine, load(re, place), x), select(mine, load(im, place), y)
            dx, dy = select(mine, load(dre, place), dx), select(mine, load(dim, place), dy)
        if not anywhere(moving > 0.0):
            break
        if turn == _TURNS:
            store(bracket, moving, 0)
            for lane in range(LANES):
                if bracket[0, lane] > 0.0:
                    readings[int(of[lane]), DOUBT, lane] = _ALL
            break
        square, slope = x * x + y * y, 2.0 * (x * dx + y * dy)
        nearness, distance = slope + 2.0 * dx, square + 2.0 * x + 1.0
        f = square - select(kind == float(_CROSS_UNIT), 1.0, level)
        f = select(kind == float(_CROSS_AXIS), y, f)
        f = select(kind == float(_PEAK_S), nearness, f)
        f = select(kind == float(_PEAK_T), nearness * square - distance * slope, f)
        f = select(kind == float(_PEAK_H), slope, f)
        if turn > 0:
            apart = here - last
            secant = (f - f_last) / select(apart == 0.0, 1.0, apart)
            steep = select((apart == 0.0) | (secant == 0.0), steep, secant)
        slope = select(peak, steep, select(kind == float(_CROSS_AXIS), dy, slope))
        beyond = f * rising > 0.0
        high = select(beyond & (here < high), here, high)
        low = select(beyond | (here < low), low, here)
        to = here - f / slope
        inside = (to >= low) & (to <= high)
        to = select(inside, to, 0.5 * (low + high))
        # The next point is the last where it is so near: it is nearer than the step to it by about the square of the step.
        arrives = inside & (magnitude(to - here) <= _AGREED * here)
        last, f_last = here, f
        here = select(moving > 0.0, to, here)
        moving = select(arrives, 0.0, moving)
        store(omega, here, 0)
        turn += 1
    store(bracket, x, 0)
    store(bracket, y, 1)
    for lane in range(LANES):
        _enter(readings[int(of[lane])], int(kinds[lane]), lane, omega[0, lane], bracket[0, lane], bracket[1, lane])


@compiled
def _enter(reading: Real, kind: int, lane: int, omega: float, x: float, y: float) -> None:
    """Enter what a polished event says, L or T being x + jy there."""
    if kind == _CROSS_UNIT:
        margin = math.atan2(-y, -x)
        if abs(margin) < abs(reading[PHASE_MARGIN, lane]):
            reading[PHASE_MARGIN, lane], reading[PHASE_AT, lane] = margin, omega
        turn_left = margin if margin >= -1e-12 else margin + 2.0 * math.pi
        if turn_left / omega < reading[DELAY_MARGIN, lane]:
            reading[DELAY_MARGIN, lane], reading[DELAY_AT, lane] = turn_left / omega, omega
    elif kind == _CROSS_AXIS:
        if x < -_SMALLEST and abs(math.log(-x)) < abs(math.log(reading[GAIN_MARGIN, lane])):
            reading[GAIN_MARGIN, lane], reading[GAIN_AT, lane] = -1.0 / x, omega
    elif kind == _CROSS_LEVEL:
        reading[FIRST_FALL, lane] = omega
    elif kind != _NO_EVENT:
        to, height = HIGHEST if kind == _PEAK_H else MS + kind - _PEAK_S, math.sqrt(_size(kind, x, y))
        if height > reading[to, lane]:
            reading[to, lane], reading[MS_AT + kind - _PEAK_S, lane] = height, omega
