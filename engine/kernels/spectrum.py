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

GAIN_MARGIN, PHASE_MARGIN, DELAY_MARGIN, MS, MT, FIRST_FALL, HIGHEST, AT_REST, DOUBT = range(9)
READINGS: Final = 9
"""What is read off one curve; frequencies in rad/s, DOUBT the sum of the bits above
that are not vouched for. Infinite where nothing crosses."""

CHUNK: Final = 16
"""Frequencies are done so many at a time, so that all functions of a program stay in the nearest cache."""
FALL: Final = 10.0**-0.3
_SMALLEST: Final = 1e-3
_ABRUPT: Final = 0.3
_RIVAL: Final = 0.1
_EVENTS: Final = 12
_TURNS: Final = 9
_AGREED: Final = 1e-6
_AGREED_PEAK: Final = 1e-6
"""Relative step after which the next point is final; the value at a peak depends on the square of what is left."""
_ALL: Final = 127.0
_CROSS_UNIT, _CROSS_AXIS, _CROSS_LEVEL, _PEAK_S, _PEAK_T, _PEAK_H = range(6)


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
def run_program(
    program: FrequencyProgram, registers: Real, omega: Real, tables_re: Real, tables_im: Real, first: int, re: Real,
    im: Real,
) -> None:  # fmt: skip
    """Evaluate all functions at the frequencies ``omega`` (count, LANES); ``re``, ``im`` (places, count, LANES)."""
    count = omega.shape[0]
    for k in range(program.operations.shape[0]):
        code, to = program.operations[k, 0], program.operations[k, 1]
        a, b = program.operations[k, 2], program.operations[k, 3]
        if code == 0:
            for w in range(count):
                s = load(omega, w)
                square = -(s * s)
                even, odd = spread(0.0), spread(0.0)
                last = b - 1
                for j in range(last - (last & 1), -1, -2):
                    even = even * square + load(registers, program.coefficients[a + j])
                for j in range(last - 1 + (last & 1), 0, -2):
                    odd = odd * square + load(registers, program.coefficients[a + j])
                store2(re, even, to, w)
                store2(im, odd * s, to, w)
        elif code == 1:
            for w in range(count):
                store2(re, load2(re, a, w) + load2(re, b, w), to, w)
                store2(im, load2(im, a, w) + load2(im, b, w), to, w)
        elif code == 2:
            for w in range(count):
                store2(re, load2(re, a, w) - load2(re, b, w), to, w)
                store2(im, load2(im, a, w) - load2(im, b, w), to, w)
        elif code == 3:
            for w in range(count):
                x, y, u, v = load2(re, a, w), load2(im, a, w), load2(re, b, w), load2(im, b, w)
                store2(re, x * u - y * v, to, w)
                store2(im, x * v + y * u, to, w)
        elif code == 4:
            for w in range(count):
                x, y, u, v = load2(re, a, w), load2(im, a, w), load2(re, b, w), load2(im, b, w)
                inverse = 1.0 / (u * u + v * v)
                store2(re, (x * u + y * v) * inverse, to, w)
                store2(im, (y * u - x * v) * inverse, to, w)
        elif code == 5:
            factor = load(registers, b)
            for w in range(count):
                store2(re, load2(re, a, w) * factor, to, w)
                store2(im, load2(im, a, w) * factor, to, w)
        elif code == 6:
            shift = load(registers, b)
            for w in range(count):
                store2(re, load2(re, a, w) + shift, to, w)
                store2(im, load2(im, a, w), to, w)
        elif code == 7:
            for w in range(count):
                store2(re, -load2(re, a, w), to, w)
                store2(im, -load2(im, a, w), to, w)
        else:
            for w in range(count):
                store2(re, tables_re[a, first + w], to, w)
                store2(im, tables_im[a, first + w], to, w)


@compiled
def _note(
    kinds: Whole, places: Whole, counts: Whole, curves: Whole, bits: int, kind: int, place: int, curve: int
) -> int:
    """Enter an event for the lanes of ``bits``; return the lanes whose list is full."""
    full = 0
    for lane in range(LANES):
        if (bits >> lane) & 1:
            if counts[lane] < _EVENTS:
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
def spectrum(program: SpectrumProgram, registers: Real, readings: Real, store_re: Real, store_im: Real) -> None:
    """Fill ``readings`` (curves, READINGS, LANES).

    ``store_re``, ``store_im`` (curves, frequencies, LANES) are room for the curves. Where the loop is unstable the readings
    mean nothing.
    """
    total, curves = program.frequencies.shape[0], program.wants.shape[0]
    places = max(program.scan.places, program.points.places)
    re, im = np.empty((places, CHUNK, LANES)), np.empty((places, CHUNK, LANES))
    omega = np.empty((CHUNK, LANES))
    for first in range(0, total, CHUNK):
        for w in range(CHUNK):
            store(omega, program.frequencies[first + w], w)
        run_program(program.scan, registers, omega, program.tables_re, program.tables_im, first, re, im)
        for c in range(curves):
            place = program.scan.targets[c]
            for w in range(CHUNK):
                store2(store_re, load2(re, place, w), c, first + w)
                store2(store_im, load2(im, place, w), c, first + w)
    kinds, at, of = (
        np.empty((_EVENTS, LANES), np.int32),
        np.empty((_EVENTS, LANES), np.int32),
        np.empty((_EVENTS, LANES), np.int32),
    )
    counts = np.zeros(LANES, np.int32)
    level = np.empty((curves, LANES))
    for c in range(curves):
        _look(program, c, store_re, store_im, readings, level, kinds, at, counts, of)
    room = np.empty((4, places, LANES))
    most = 0
    for lane in range(LANES):
        most = max(most, counts[lane])
    for slot in range(most):
        _polish(program, registers, slot, store_re, store_im, readings, level, kinds, at, counts, of, room)


@compiled
def _look(
    program: SpectrumProgram, c: int, store_re: Real, store_im: Real, readings: Real, level: Real, kinds: Whole,
    at: Whole, counts: Whole, of: Whole,
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
    best = np.empty((3, LANES))
    second, where, runner_up = np.empty((3, LANES)), np.zeros((3, LANES)), np.zeros((3, LANES))
    before1, before2 = np.empty((3, LANES)), np.empty((3, LANES))
    for p in range(3):
        for lane in range(LANES):
            best[p, lane], second[p, lane], before2[p, lane] = -1.0, -1.0, math.inf
            before1[p, lane] = _size(_PEAK_S + p, store_re[c, 0, lane], store_im[c, 0, lane])
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
                size = 1.0 / distance if p == 0 else (m / distance if p == 1 else m)
                highest, runner, a1, a2 = load(best, p), load(second, p), load(before1, p), load(before2, p)
                local = (a1 > size) & (a1 >= a2)
                if anywhere(local):
                    # the height of the peak between the samples, from the parabola through the inverse
                    f0, f1, f2 = 1.0 / a2, 1.0 / a1, 1.0 / size
                    vertex = f1 - (f0 - f2) * (f0 - f2) / (8.0 * (f0 - 2.0 * f1 + f2))
                    top = select(vertex > 0.0, 1.0 / vertex, 1e300)
                    wins = local & (top > highest)
                    next_best = local & (top > runner) & (top <= highest)
                    store(second, select(wins, highest, select(next_best, top, runner)), p)
                    place = load(runner_up, p)
                    store(runner_up, select(wins, load(where, p), select(next_best, float(k - 1), place)), p)
                    store(best, select(wins, top, highest), p)
                    store(where, select(wins, float(k - 1), load(where, p)), p)
                store(before2, a1, p)
                store(before1, size, p)
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
        for p in range(3):
            if not wants & (SENSITIVITY << p if p < 2 else PEAK):
                continue
            to = MS + p if p < 2 else HIGHEST
            ends = max(_size(_PEAK_S + p, store_re[c, 0, lane], store_im[c, 0, lane]),
                       _size(_PEAK_S + p, store_re[c, last, lane], store_im[c, last, lane]))  # fmt: skip
            k = int(where[p, lane])
            # a peak that may be as high as an end of the axis is polished, and counts if it is higher
            inside = best[p, lane] > ends * (1.0 - _RIVAL)
            readings[c, to, lane] = math.sqrt(ends)
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

    The parabola through the samples, and half as much again, reaches the level; the samples are all on one side of it.
    """
    tip = middle - (right - left) * (right - left) / (8.0 * (left - 2.0 * middle + right))
    beyond = tip + 0.5 * (tip - middle)
    turns = (middle - left) * (middle - right) > 0.0
    side = middle - goal
    return turns & (side * (left - goal) > 0.0) & (side * (right - goal) > 0.0) & (side * (beyond - goal) <= 0.0)


@compiled
def root_of(square: Any, sign: Any) -> Any:
    """Return the root of a square with the sign of a number."""
    return select(sign < 0.0, -1.0, 1.0) * root(square)


@compiled
def run_point(
    program: FrequencyProgram, registers: Real, omega: Real, re: Real, im: Real, dre: Real, dim: Real
) -> None:
    """Evaluate all functions and their slopes by frequency at one frequency of every lane; arrays (places, LANES)."""
    s = load(omega, 0)
    square = -(s * s)
    for k in range(program.operations.shape[0]):
        code, to = program.operations[k, 0], program.operations[k, 1]
        a, b = program.operations[k, 2], program.operations[k, 3]
        if code == 0:
            even, odd, d_even, d_odd = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            last = b - 1
            for j in range(last - (last & 1), -1, -2):
                d_even = d_even * square + even
                even = even * square + load(registers, program.coefficients[a + j])
            for j in range(last - 1 + (last & 1), 0, -2):
                d_odd = d_odd * square + odd
                odd = odd * square + load(registers, program.coefficients[a + j])
            store(re, even, to)
            store(im, odd * s, to)
            store(dre, -2.0 * s * d_even, to)
            store(dim, odd + 2.0 * square * d_odd, to)
            continue
        x, y, p, q = load(re, a), load(im, a), load(dre, a), load(dim, a)
        if code == 5:
            factor = load(registers, b)
            store(re, x * factor, to)
            store(im, y * factor, to)
            store(dre, p * factor, to)
            store(dim, q * factor, to)
            continue
        if code == 6:
            store(re, x + load(registers, b), to)
            store(im, y, to)
            store(dre, p, to)
            store(dim, q, to)
            continue
        u, v, m, n = load(re, b), load(im, b), load(dre, b), load(dim, b)
        if code == 1:
            store(re, x + u, to)
            store(im, y + v, to)
            store(dre, p + m, to)
            store(dim, q + n, to)
        elif code == 2:
            store(re, x - u, to)
            store(im, y - v, to)
            store(dre, p - m, to)
            store(dim, q - n, to)
        elif code == 3:
            store(re, x * u - y * v, to)
            store(im, x * v + y * u, to)
            store(dre, p * u - q * v + x * m - y * n, to)
            store(dim, p * v + q * u + x * n + y * m, to)
        elif code == 4:
            inverse = 1.0 / (u * u + v * v)
            c, d = (x * u + y * v) * inverse, (y * u - x * v) * inverse
            f, g = p - (c * m - d * n), q - (c * n + d * m)
            store(re, c, to)
            store(im, d, to)
            store(dre, (f * u + g * v) * inverse, to)
            store(dim, (g * u - f * v) * inverse, to)
        else:
            store(re, -x, to)
            store(im, -y, to)
            store(dre, -p, to)
            store(dim, -q, to)


@compiled
def _residual(kind: int, x: float, y: float, dx: float, dy: float, level: float) -> tuple[float, float]:
    """Return what is 0 at a crossing or peak, and its slope by frequency (0 for a peak, whose slope is not known).

    At a peak it is the slope of the inverse square, which is smooth however sharp the peak.
    """
    square, slope = x * x + y * y, 2.0 * (x * dx + y * dy)
    if kind == _CROSS_UNIT:
        return square - 1.0, slope
    if kind == _CROSS_AXIS:
        return y, dy
    if kind == _CROSS_LEVEL:
        return square - level, slope
    if kind == _PEAK_H:
        return slope, 0.0
    nearness = slope + 2.0 * dx
    if kind == _PEAK_S:
        return nearness, 0.0
    distance = square + 2.0 * x + 1.0
    return nearness * square - distance * slope, 0.0


@compiled
def _polish(
    program: SpectrumProgram, registers: Real, slot: int, store_re: Real, store_im: Real, readings: Real, level: Real,
    kinds: Whole, at: Whole, counts: Whole, of: Whole, room: Real,
) -> None:  # fmt: skip
    """Polish one event of every lane and enter what it says into its readings; ``room`` is (4, places, LANES)."""
    omega = np.empty((1, LANES))
    low, high = np.empty(LANES), np.empty(LANES)
    before, f_before, rising = np.full(LANES, -1.0), np.empty(LANES), np.empty(LANES)
    re, im, dre, dim = room[0], room[1], room[2], room[3]
    for lane in range(LANES):
        there = slot < counts[lane]
        k = at[slot, lane] if there else 2
        c = of[slot, lane] if there else 0
        kind = kinds[slot, lane] if there else _CROSS_UNIT
        low[lane], high[lane] = program.frequencies[k - 1], program.frequencies[k]
        left = _function(kind, store_re[c, k - 1, lane], store_im[c, k - 1, lane], level[c, lane])
        right = _function(kind, store_re[c, k, lane], store_im[c, k, lane], level[c, lane])
        if kind >= _PEAK_S:
            middle, f_middle = high[lane], right
            high[lane] = program.frequencies[k + 1]
            right = _function(kind, store_re[c, k + 1, lane], store_im[c, k + 1, lane], level[c, lane])
            first, second = (middle - low[lane]) * (f_middle - right), (high[lane] - middle) * (f_middle - left)
            weight = first + second
            to = middle
            if weight > 0.0:
                to += 0.5 * ((high[lane] - middle) * second - (middle - low[lane]) * first) / weight
            # the slope of the inverse square falls through 0 at a peak of |T|, and rises for the others
            rising[lane] = -1.0 if kind == _PEAK_H else 1.0
        else:
            span = right - left
            to = low[lane] - left * (high[lane] - low[lane]) / span if span != 0.0 else low[lane]
            rising[lane] = 1.0 if right > left else -1.0
        omega[0, lane] = to if low[lane] < to < high[lane] else 0.5 * (low[lane] + high[lane])
    arrived = np.zeros(LANES, np.bool_)
    for turn in range(_TURNS):
        run_point(program.points, registers, omega, re, im, dre, dim)
        busy = False
        for lane in range(LANES):
            if slot >= counts[lane] or arrived[lane]:
                continue
            kind, c, here = kinds[slot, lane], of[slot, lane], omega[0, lane]
            place = program.points.targets[c]
            f, slope = _residual(
                kind, re[place, lane], im[place, lane], dre[place, lane], dim[place, lane], level[c, lane]
            )
            if f * rising[lane] > 0.0:
                high[lane] = min(high[lane], here)
            else:
                low[lane] = max(low[lane], here)
            if slope == 0.0 and before[lane] > 0.0 and here != before[lane]:
                slope = (f - f_before[lane]) / (here - before[lane])
            before[lane], f_before[lane] = here, f
            to = here - f / slope if slope != 0.0 else here * (1.0 - 1e-3 * rising[lane] * (1.0 if f > 0.0 else -1.0))
            inside = low[lane] <= to <= high[lane]
            to = to if inside else 0.5 * (low[lane] + high[lane])
            # The next point is the last: it is nearer than the step to it by the square of that step.
            arrived[lane] = slope != 0.0 and abs(to - here) <= (_AGREED if kind < _PEAK_S else _AGREED_PEAK) * here
            omega[0, lane] = to
            busy = True
            if turn == _TURNS - 1:
                readings[c, DOUBT, lane] = _ALL
        if not busy:
            break
    for lane in range(LANES):
        if slot >= counts[lane]:
            continue
        kind, c = kinds[slot, lane], of[slot, lane]
        place = program.points.targets[c]
        x, y = re[place, lane], im[place, lane]
        if kind == _CROSS_UNIT:
            margin = math.atan2(-y, -x)
            best = readings[c, PHASE_MARGIN, lane]
            readings[c, PHASE_MARGIN, lane] = margin if abs(margin) < abs(best) else best
            turn_left = margin if margin >= -1e-12 else margin + 2.0 * math.pi
            readings[c, DELAY_MARGIN, lane] = min(readings[c, DELAY_MARGIN, lane], turn_left / omega[0, lane])
        elif kind == _CROSS_AXIS:
            if x < -_SMALLEST:
                margin, best = -1.0 / x, readings[c, GAIN_MARGIN, lane]
                nearer = abs(math.log(margin)) < abs(math.log(best))
                readings[c, GAIN_MARGIN, lane] = margin if nearer else best
        elif kind == _CROSS_LEVEL:
            readings[c, FIRST_FALL, lane] = omega[0, lane]
        else:
            to = HIGHEST if kind == _PEAK_H else MS + kind - _PEAK_S
            readings[c, to, lane] = max(readings[c, to, lane], math.sqrt(_size(kind, x, y)))


@compiled
def _function(kind: int, x: float, y: float, level: float) -> float:
    """Return what is 0 at a crossing, or largest at a peak: the inverse is a parabola also where a peak is sharp."""
    square = x * x + y * y
    if kind == _CROSS_UNIT:
        return (square - 1.0) / (square + 1.0)
    if kind == _CROSS_AXIS:
        return y
    if kind == _CROSS_LEVEL:
        return (square - level) / (square + level)
    return -1.0 / _size(kind, x, y)
