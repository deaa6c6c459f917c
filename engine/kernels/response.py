"""Step responses of eight candidates at a time, sampled where something happens and read where it does.

    y(t) = y∞ + C e^(A t) (-x∞):   16 samples for every octave of time, or more, from the fastest mode until nothing moves

Each sample comes with its slope, so that turning points between samples are seen and under-sampled responses are caught.
What a metric needs is bracketed by samples, then found by walking down the binary digits of time and by Newton's method on
the Taylor polynomial of the last step. A reading that the samples cannot vouch for is marked doubtful.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.kernels.compiled import LANES, compiled, multiply
from engine.kernels.vector import anywhere, lanes_of, load, load2, magnitude, select, spread, store, store2

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]

RISE: Final = 1
SETTLE_2: Final = 2
SETTLE_5: Final = 4
TOP: Final = 8
BOTTOM: Final = 16

FINAL, T_10, T_90, T_2, T_5, TOP_VALUE, TOP_TIME, BOTTOM_VALUE, BOTTOM_TIME, DOUBT, SIZE = range(11)
READINGS: Final = 11
"""What is read off one response; times in s; the top is the furthest in the direction of the final value. DOUBT is the sum of the kinds above that are not vouched for."""

SETTLED: Final = 1e-8
"""A response is followed until its slowest mode has decayed to this."""
TAYLOR: Final = 12
"""Terms of the last step's Taylor polynomial: 0.64^12 / 12! is 1e-11."""
ROWS: Final = 4
COLUMNS: Final = 4
PER_PASS: Final = 16
_UNRESOLVED: Final = 3e-3
"""Largest interpolation error between samples, by the largest value, at which brackets are trusted."""
_GRAZE: Final = 1e-6
"""A tip so near to the edge of a band, by the band, or as near as the interpolation error, is not decided here."""
_NOISE: Final = 1e-12
_RIPPLE: Final = 1e-7
"""What moves by less than this part of the largest value between samples changes no metric that is read here."""
_SWING: Final = 0.15
"""The trapezoidal rule misses by s²/12 of the steepest slope where a swing goes on by s rad between samples."""
_ALIASED: Final = 0.03
"""Interpolation over two steps misses by this part of what moves where there are about two samples to a swing."""
_RIVAL: Final = 0.03
"""Turning points that are so near to each other in height are all polished before the highest is chosen."""

# Fields of the state of a scan, each with LANES entries.
(
    _Y, _D, _Y2, _D2, _RES, _BIG, _N10, _L10, _N90, _L90,
    _N2, _L2, _POKE2, _S2, _GRAZE2, _HID2, _N5, _L5, _POKE5, _S5, _GRAZE5, _HID5,
    _A1, _AN1, _AL1, _A2, _AN2, _AL2, _A3,
    _B1, _BN1, _BL1, _B2, _BN2, _BL2, _B3, _MIXED, _ERROR, _TIP, _UP, _DOWN,
) = range(41)  # fmt: skip
FIELDS: Final = 41
_NONE: Final = -1.0
_EDGE: Final = -2.0


@compiled
def passes(norms: Real, levels: int, alive: Real, growth: Real, detail: int) -> int:
    """Return how many passes of 16 samples follow every candidate of the block until it rests."""
    last = 0
    for lane in range(LANES):
        if alive[lane] > 0.0 and growth[lane] < 0.0:
            level = 0
            while level + 1 < levels and norms[level, lane] > SETTLED:
                level += 1
            last = max(last, level)
    # the passes of level k end at 32 * detail * 2^k steps
    first = 5
    while 2 ** (first - 5) < detail:
        first += 1
    return (min(max(last - first, 0), max(levels - 4, 0)) + 2) * detail


@compiled
def begin(state: Real, start: Real, slope: Real, final: Real) -> None:
    """Start a scan at t = 0+, where the output is ``start`` below its final value (all LANES,)."""
    for field in range(FIELDS):
        store(state, 0.0, field)
    away, goal = load(start, 0), load(final, 0)
    size, value = magnitude(goal), away + goal
    way = select(goal >= 0.0, 1.0, -1.0)
    progress = way * value
    store(state, away, _Y)
    store(state, away, _Y2)
    store(state, load(slope, 0), _D)
    store(state, load(slope, 0), _D2)
    store(state, magnitude(value), _BIG)
    store(state, select(progress >= 0.1 * size, _EDGE, _NONE), _L10)
    store(state, select(progress >= 0.9 * size, _EDGE, _NONE), _L90)
    store(state, select(magnitude(away) > 0.02 * size, 0.0, _NONE), _L2)
    store(state, select(magnitude(away) > 0.05 * size, 0.0, _NONE), _L5)
    side = select(away > 0.0, -1.0, 1.0)
    store(state, side, _S2)
    store(state, side, _S5)
    store(state, way * away, _A1)
    store(state, -(way * away), _B1)
    store(state, _EDGE, _AL1)
    store(state, _EDGE, _BL1)
    for field in (_A2, _A3, _B2, _B3):
        store(state, -1e300, field)
    store(state, _NONE, _AL2)
    store(state, _NONE, _BL2)


@compiled
def _enter(state: Real, first: int, lane: int, height: float, n: float, level: float) -> None:
    """Enter a turning point into the list of the three highest; of the third only the height is kept."""
    if height > state[first, lane]:
        state[first + 6, lane] = state[first + 3, lane]
        for k in range(3):
            state[first + 3 + k, lane] = state[first + k, lane]
        state[first, lane], state[first + 1, lane], state[first + 2, lane] = height, n, level
    elif height > state[first + 3, lane]:
        state[first + 6, lane] = state[first + 3, lane]
        state[first + 3, lane], state[first + 4, lane], state[first + 5, lane] = height, n, level
    elif height > state[first + 6, lane]:
        state[first + 6, lane] = height


@compiled
def _turn(
    state: Real, lane: int, y: float, d: float, final: float, h: float, n: float, level: float, wants: int
) -> None:
    """Take down a turning point in the interval that begins at ``n`` and ends with the deviation y and its slope d."""
    before, rising, error = state[_Y, lane], state[_D, lane], state[_ERROR, lane]
    # the turning point of the cubic through both values with both slopes
    m0, m1, climb = h * rising, h * d, y - before
    c2, c3 = 3.0 * climb - 2.0 * m0 - m1, m0 + m1 - 2.0 * climb
    bend = math.sqrt(max(c2 * c2 - 3.0 * c3 * m0, 0.0))
    below = -c2 + bend if rising > 0.0 else -c2 - bend
    share = min(max(m0 / below, 0.0), 1.0) if below != 0.0 else 0.5
    tip = before + share * (m0 + share * (c2 + share * c3))
    size, way = abs(final), 1.0 if final >= 0.0 else -1.0
    if wants & (TOP | BOTTOM):
        first = _A1 if way * rising > 0.0 else _B1
        height = way * tip if way * rising > 0.0 else -way * tip
        if height > state[first, lane]:
            state[_TIP, lane] = error
        _enter(state, first, lane, height, n, level)
    if wants & RISE:
        highest, reached = way * (tip + final), way * (y + final)
        for f, part in ((_L10, 0.1), (_L90, 0.9)):
            # A level that is reached between two samples only: the bracket has no change of sign.
            if state[f, lane] == _NONE and reached < part * size and highest + error >= part * size:
                state[_MIXED, lane] = 1.0
    for f, part in ((_N2, 0.02), (_N5, 0.05)):
        band = part * size
        margin = _GRAZE * band + 3.0 * error
        if abs(tip) > band - margin and abs(y) <= band:
            state[f, lane], state[f + 1, lane], state[f + 2, lane] = n, level, 1.0
            state[f + 3, lane] = -1.0 if tip > 0.0 else 1.0
            state[f + 4, lane] = 1.0 if abs(tip) < band + margin else 0.0


@compiled
def scan(
    state: Real, samples: Real, row: int, stride: int, final: Real, step: Real, level: int, start: int, changed: bool,
    wants: int,
) -> None:  # fmt: skip
    """Go through the 16 samples of a pass: ``samples`` (4 * stride, 4, LANES), deviation in ``row``, slope in ``row + 1``.

    They are ``2**level`` steps apart and the first is number ``start``; ``changed``: the samples before it were half as far
    apart.
    """
    unit = 2.0**level
    goal, h = load(final, 0), load(step, 0)
    size = magnitude(goal)
    sign = select(goal >= 0.0, 1.0, -1.0)
    y1, d1, y2, d2 = load(state, _Y), load(state, _D), load(state, _Y2), load(state, _D2)
    worst, big = load(state, _RES), load(state, _BIG)
    last_miss = load(state, _ERROR)
    rising = bool(wants & RISE) and anywhere(load(state, _L90) == _NONE)
    extremes = bool(wants & (TOP | BOTTOM))
    need = 0.015 if wants & SETTLE_2 else (0.04 if wants & SETTLE_5 else (0.1 if wants & RISE else 1e300))
    for column in range(COLUMNS):
        for j in range(ROWS):
            index = column * ROWS + j
            if start == 0 and index == 0:
                continue
            at = row + j * stride
            before = level - 1 if index == 0 and changed else level
            n = (start + index) * unit
            wide = 2.0**before
            n_before = n - wide
            # Cubic Hermite interpolation over two steps beside the sample in the middle; a single step errs a sixteenth.
            known = 1.0 / 16.0 if (index != 1 or not changed) and n > unit else 0.0
            y, d = load2(samples, at, column), load2(samples, at + 1, column)
            middle = 0.5 * (y2 + y) + (0.25 * wide) * h * (d2 - d)
            # Where two unequal steps meet, the last estimate stands for it: a step twice as wide errs 16 times as much.
            seen = known * magnitude(middle - y1)
            miss = seen if known > 0.0 else 16.0 * last_miss
            last_miss = miss
            # Where interpolation misses by a part of what moves, or slopes do not add up to what happened, turning points
            # hide between samples.
            ahead = wide * h
            slip = magnitude(y - y1 - 0.5 * ahead * (d + d1))
            swings = slip > _SWING * ahead * select(magnitude(d) > magnitude(d1), magnitude(d), magnitude(d1))
            if anywhere((16.0 * seen > _ALIASED * magnitude(y - y1)) | swings):
                moves = (
                    magnitude(y - y1) + magnitude(y1 - y2) + wide * h * (magnitude(d) + magnitude(d1) + magnitude(d2))
                )
                hides = ((16.0 * seen > _ALIASED * moves) | swings) & (moves > _RIPPLE * big)
                if anywhere(hides):
                    rise, fall = select(sign * (y - y1) > 0.0, y, y1), select(sign * (y - y1) > 0.0, y1, y)
                    up, down = sign * rise + 0.25 * moves, 0.25 * moves - sign * fall
                    store(state, select(hides & (up > load(state, _UP)), up, load(state, _UP)), _UP)
                    store(state, select(hides & (down > load(state, _DOWN)), down, load(state, _DOWN)), _DOWN)
                    reach = select(up > down, up, down)
                    store(state, select(hides & (reach > load(state, _HID2)), reach, load(state, _HID2)), _HID2)
                    store(state, select(hides & (reach > load(state, _HID5)), reach, load(state, _HID5)), _HID5)
                    if rising:
                        unsure = hides & (load(state, _L90) == _NONE) & (moves > 0.02 * size)
                        store(state, select(unsure, 1.0, load(state, _MIXED)), _MIXED)
            worst = select(miss > worst, miss, worst)
            value = magnitude(y + goal)
            big = select(value > big, value, big)
            # a response at rest turns at every sample, by rounding
            turning = (d1 * d < 0.0) & (wide * h * magnitude(d1 - d) > _NOISE * big)
            if anywhere(turning):
                # How far a tip can be from the final value at most; most ripples cannot matter any more.
                steeper = select(magnitude(d) > magnitude(d1), magnitude(d), magnitude(d1))
                further = select(magnitude(y) > magnitude(y1), magnitude(y), magnitude(y1))
                reach = further + 0.5 * wide * h * steeper
                matters = reach > need * size
                if extremes:
                    lower = load(state, _A3) if wants & TOP else spread(1e300)
                    if wants & BOTTOM:
                        other = load(state, _B3)
                        lower = select(other < lower, other, lower)
                    matters = matters | (reach > lower)
                turning = turning & matters
            if anywhere(turning):
                store(state, y1, _Y)
                store(state, d1, _D)
                store(state, miss, _ERROR)
                bits = lanes_of(turning)
                for lane in range(LANES):
                    if (bits >> lane) & 1:
                        _turn(state, lane, samples[at, column, lane], samples[at + 1, column, lane], final[lane],
                              wide * step[lane], n_before, float(before), wants)  # fmt: skip
            y2, d2, y1, d1 = y1, d1, y, d
            if wants & SETTLE_2:
                _outside(state, _N2, 0.02, y, size, n, float(level))
            if wants & SETTLE_5:
                _outside(state, _N5, 0.05, y, size, n, float(level))
            if rising:
                reached = sign * (y + goal)
                first, last = load(state, _L10), load(state, _L90)
                passes10 = (first == _NONE) & (reached >= 0.1 * size)
                passes90 = (last == _NONE) & (reached >= 0.9 * size)
                store(state, select(passes10, n_before, load(state, _N10)), _N10)
                store(state, select(passes10, float(before), first), _L10)
                store(state, select(passes90, n_before, load(state, _N90)), _N90)
                last = select(passes90, float(before), last)
                store(state, last, _L90)
                rising = anywhere(last == _NONE)
    store(state, y1, _Y)
    store(state, d1, _D)
    store(state, y2, _Y2)
    store(state, d2, _D2)
    store(state, worst, _RES)
    store(state, last_miss, _ERROR)
    store(state, big, _BIG)


@compiled
def _outside(state: Real, f: int, part: float, y: Any, size: Any, n: float, level: float) -> None:
    """Take down the candidates whose sample lies outside its band."""
    out = magnitude(y) > part * size
    if anywhere(out):
        store(state, select(out, n, load(state, f)), f)
        store(state, select(out, level, load(state, f + 1)), f + 1)
        store(state, select(out, 0.0, load(state, f + 2)), f + 2)
        store(state, select(out, select(y > 0.0, -1.0, 1.0), load(state, f + 3)), f + 3)
        store(state, select(out, 0.0, load(state, f + 4)), f + 4)
        store(state, select(out, 0.0, load(state, f + 5)), f + 5)


@compiled
def walk(
    powers: Real, nn: int, taylor: Real, c: Real, slope: Real, events: int, e: Real, offset: Real, level: Real,
    by_slope: Whole, sign: Real, target: Real, units: Real, tau: Real, value: Real, trial: Real,
) -> None:  # fmt: skip
    """Go from states to events, several events of every lane at once: first over ``offset`` steps, then to the sign change.

    An event is the zero of sign * (output - target), negative before it; with ``by_slope`` of the output's slope instead.
    ``e`` (nn, events, LANES) are the states, on return those at ``units`` whole steps; ``tau`` is the part of a step from
    there, ``value`` the output (less its final value) at the event. An event in the first step lies after the ``tau`` given.
    Arrays of events are (events, LANES); ``events`` is a multiple of 4.
    """
    furthest, widest = 0.0, 0.0
    for q in range(events):
        for lane in range(LANES):
            furthest = max(furthest, offset[q, lane])
            widest = max(widest, level[q, lane])
        store(units, 0.0, q)
    top = 0
    while 2.0 ** (top + 1) <= furthest:
        top += 1
    top = max(top, int(widest) - 1)
    for k in range(top, -1, -1):
        width = 2.0**k
        multiply(trial, powers[k], e, nn, events, nn, nn, events, events)
        for q in range(events):
            left, known = load(offset, q), load(level, q) <= float(k)
            reached = spread(0.0)
            if by_slope[q]:
                for i in range(nn):
                    reached = reached + load(slope, i) * load2(trial, i, q)
            else:
                for i in range(nn):
                    reached = reached + load(c, i) * load2(trial, i, q)
            far = known & (left >= width)
            go = far | ((load(level, q) > float(k)) & (load(sign, q) * (reached - load(target, q)) < 0.0))
            if anywhere(go):
                store(offset, select(far, left - width, left), q)
                store(units, select(go, load(units, q) + width, load(units, q)), q)
                store(tau, select(go, 0.0, load(tau, q)), q)
                for i in range(nn):
                    store2(e, select(go, load2(trial, i, q), load2(e, i, q)), i, q)
    polynomial = np.empty((TAYLOR, LANES))
    for q in range(events):
        for k in range(TAYLOR):
            coefficient = spread(0.0)
            for i in range(nn):
                coefficient = coefficient + load2(taylor, k, i) * load2(e, i, q)
            store(polynomial, coefficient, k)
        way, goal = load(sign, q), load(target, q)
        low, high = load(tau, q), spread(1.0)
        t = 0.5 * (low + high)
        for _ in range(6):
            v, d, bend = spread(0.0), spread(0.0), spread(0.0)
            for k in range(TAYLOR - 1, -1, -1):
                bend = bend * t + d
                d = d * t + v
                v = v * t + load(polynomial, k)
            g, dg = v - goal, d
            if by_slope[q]:
                g, dg = d, 2.0 * bend
            before = way * g < 0.0
            low, high = select(before, t, low), select(before, high, t)
            new = t - g / dg
            t = select((new >= low) & (new <= high), new, 0.5 * (low + high))
        v = spread(0.0)
        for k in range(TAYLOR - 1, -1, -1):
            v = v * t + load(polynomial, k)
        store(tau, t, q)
        store(value, v, q)


MOST_EVENTS: Final = 8


@compiled
def locate(
    state: Real, powers: Real, nn: int, start: Real, c: Real, slope: Real, taylor: Real, final: Real, step: Real,
    wants: int, reading: Real, room: Real,
) -> None:  # fmt: skip
    """Polish every event of one response: ``reading`` (READINGS, LANES) from the state of its scan.

    ``start`` (nn, LANES) is the deviation at t = 0+, ``c`` and ``slope`` (nn, LANES) the rows of output and slope; ``room``
    is (2, nn, MOST_EVENTS, LANES).
    """
    fields, kinds = np.empty(MOST_EVENTS, np.int64), np.empty(MOST_EVENTS, np.int64)
    by_slope = np.zeros(MOST_EVENTS, np.int64)
    count = 0
    if wants & RISE:
        fields[0], kinds[0], fields[1], kinds[1] = _N10, T_10, _N90, T_90
        count = 2
    if wants & SETTLE_2:
        fields[count], kinds[count] = _N2, T_2
        count += 1
    if wants & SETTLE_5:
        fields[count], kinds[count] = _N5, T_5
        count += 1
    for which in range(2):
        kind, f, to = (TOP, _A1, TOP_VALUE) if which == 0 else (BOTTOM, _B1, BOTTOM_VALUE)
        if wants & kind:
            rivals = False
            for lane in range(LANES):
                if state[f + 5, lane] >= 0.0 and _is_rival(state, f, f + 3, lane):
                    rivals = True
            for runner in range(2 if rivals else 1):
                fields[count], kinds[count], by_slope[count] = f + 3 * runner + 1, to, 1
                count += 1
    events = (count + 3) // 4 * 4
    e = room[0].reshape(nn * MOST_EVENTS, LANES)[: nn * events].reshape(nn, events, LANES)
    trial = room[1].reshape(nn * MOST_EVENTS, LANES)[: nn * events].reshape(nn, events, LANES)
    offset, level = np.zeros((events, LANES)), np.zeros((events, LANES))
    sign, target = np.ones((events, LANES)), np.zeros((events, LANES))
    units, tau, value = np.empty((events, LANES)), np.zeros((events, LANES)), np.empty((events, LANES))
    base = np.zeros((events, LANES))
    goal = load(final, 0)
    size, way = magnitude(goal), select(goal >= 0.0, 1.0, -1.0)
    doubt = select(load(state, _RES) > _UNRESOLVED * load(state, _BIG), 31.0, 0.0)
    pokes = False
    for q in range(events):
        for i in range(nn):
            store2(e, load(start, i), i, q)
        if q >= count:
            continue
        f, to = fields[q], kinds[q]
        depth = load(state, f + 1)
        store(offset, load(state, f), q)
        store(level, select(depth > 0.0, depth, 0.0), q)
        if to in (T_10, T_90):
            store(sign, way, q)
            store(target, (-0.9 if to == T_10 else -0.1) * goal, q)
        elif to in (T_2, T_5):
            side = load(state, f + 3)
            store(sign, side, q)
            store(target, -(side * ((0.02 if to == T_2 else 0.05) * size)), q)
            pokes = pokes or anywhere(load(state, f + 2) > 0.0)
        else:
            store(sign, -way if to == TOP_VALUE else way, q)
    if pokes:
        # A tip pokes out of a band between two samples: go to the tip first, all others to their last sample.
        goals = target.copy()
        for q in range(count):
            if kinds[q] in (T_2, T_5):
                by_slope[q] = 1
                store(level, select(load(state, fields[q] + 2) > 0.0, load(level, q), 0.0), q)
                store(target, 0.0, q)
            else:
                store(level, 0.0, q)
        walk(powers, nn, taylor, c, slope, events, e, offset, level, by_slope, sign, target, units, tau, value, trial)
        for q in range(count):
            store(base, load(units, q), q)
            store(offset, 0.0, q)
            depth = load(state, fields[q] + 1)
            store(level, select(depth > 0.0, depth, 0.0), q)
            store(target, load(goals, q), q)
            if kinds[q] in (T_2, T_5):
                by_slope[q] = 0
                store(tau, select(load(state, fields[q] + 2) > 0.0, load(tau, q), 0.0), q)
            else:
                store(tau, 0.0, q)
    walk(powers, nn, taylor, c, slope, events, e, offset, level, by_slope, sign, target, units, tau, value, trial)
    store(reading, goal, FINAL)
    store(reading, load(state, _BIG), SIZE)
    store(reading, -1e300, TOP_VALUE)
    store(reading, -1e300, BOTTOM_VALUE)
    h = load(step, 0)
    if wants & RISE:
        doubt = select((load(state, _MIXED) > 0.0) & (doubt < 31.0), doubt + float(RISE), doubt)
    for q in range(count):
        f, to = fields[q], kinds[q]
        depth, t = load(state, f + 1), (load(base, q) + load(units, q) + load(tau, q)) * h
        if to in (T_10, T_90):
            store(reading, select(depth == _EDGE, 0.0, select(depth == _NONE, math.nan, t)), to)
        elif to in (T_2, T_5):
            store(reading, select(depth == _NONE, 0.0, t), to)
            bit = float(SETTLE_2 if to == T_2 else SETTLE_5)
            grazes = (load(state, f + 4) > 0.0) | (load(state, f + 5) > (0.0195 if to == T_2 else 0.049) * size)
            doubt = select(grazes & (doubt < 31.0), doubt + bit, doubt)
        else:
            up = way if to == TOP_VALUE else -way
            edge = depth == _EDGE
            height = select(edge, load(state, f - 1) + up * goal, up * (load(value, q) + goal))
            height = select(depth == _NONE, -1e300, height)
            # where the response leaves its highest value slowly, the first samples equal it to rounding
            grace = select(edge, _NOISE * magnitude(height), 0.0)
            higher = height + grace > load(reading, to)
            store(reading, select(higher, height, load(reading, to)), to)
            store(reading, select(higher, select(edge, 0.0, t), load(reading, to + 1)), to + 1)
    for which in range(2):
        kind, f, to = (TOP, _A1, TOP_VALUE) if which == 0 else (BOTTOM, _B1, BOTTOM_VALUE)
        if wants & kind:
            store(reading, load(reading, to) * (way if which == 0 else -way), to)
            third = load(state, f + 6) > load(state, f) - _RIVAL * magnitude(load(state, f)) - 4.0 * load(state, _TIP)
            # what is hidden may be higher than what was found, or be all that lies beyond the final value
            height = load(state, f)
            least = select(height > 0.0, 1.001 * height, 1e-9 * size)
            higher = load(state, _UP if which == 0 else _DOWN) > least
            suspect = (third & (load(state, f + 5) >= 0.0)) | higher
            doubt = select(suspect & (doubt < 31.0), doubt + float(kind), doubt)
    store(reading, doubt, DOUBT)


@compiled
def _is_rival(state: Real, first: int, second: int, lane: int) -> bool:
    """Whether a turning point is so near to the highest that its estimate may have the order wrong."""
    return bool(state[second, lane] > state[first, lane] - _RIVAL * abs(state[first, lane]) - 4.0 * state[_TIP, lane])
