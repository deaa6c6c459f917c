"""Crossings and peaks of curves over frequency, from the samples in which they were seen to where they are.

    crossing: Newton's method from the parabola through three samples;   peak: the secant method on the slope of its inverse

Every lane has a list of events of its own. Those with the same number in all lanes share a slot, and all slots that still
move are evaluated side by side.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, compiled
from engine.batch.kernels.curves import run_points
from engine.batch.kernels.spectrum_program import (
    BANDWIDTH,
    DELAY,
    DELAY_AT,
    DELAY_MARGIN,
    DOUBT,
    FAINT,
    FAINTEST,
    FIRST_FALL,
    GAIN_AT,
    GAIN_MARGIN,
    HIGHEST,
    MS,
    MS_AT,
    PEAK,
    PHASE,
    PHASE_AT,
    PHASE_MARGIN,
    SENSITIVITY,
    SMALLEST,
    SpectrumProgram,
)
from engine.batch.kernels.vector import anywhere, load, load2, magnitude, select, spread, store

Real = npt.NDArray[np.float64]

CROSS_UNIT, CROSS_AXIS, CROSS_LEVEL, PEAK_S, PEAK_T, PEAK_H, TURN_UNIT, TURN_LEVEL, NO_EVENT = range(9)
"""What an event is. A curve whose square turns so near to 1 or to its level that it may cross that twice between samples is
followed to where it turns."""
EVENTS: Final = 12
ALL: Final = 127.0
_TURNS: Final = 9
_ARRIVED: Final = 0.5
"""What stands in MOVING of a lane that has taken its last step, where the curve is still to be evaluated; 1 while it moves, 0 at the end."""
_AGREED: Final = 1e-6
"""Relative step after which the next point is final: it is off by about the square of it."""
_AGREED_PEAK: Final = 1e-5
"""The value at a peak depends on the square of what is left."""
_SHARP: Final = 1e-4
"""A step that would change the value at a peak by more than about this part of it is not the last: the peak is narrower than that."""
_STRAIGHT: Final = 1e-12
"""Where the square of a last step of the curve is less than this, by the square of its size, the curve goes straight to its end."""
_BELOW: Final = 1e-9
"""What is lower than the sample at which a peak was seen is not that peak."""
_TOUCHES: Final = 1e-9
"""A curve that turns so near to a level, by its square, may cross it twice or not at all."""

KIND, CURVE, LEVEL, SIDE, HERE, LOW, HIGH, LAST, F_LAST, STEEP, RISING, MOVING, X, Y, OPEN = range(15)
SLOT: Final = 15
"""Fields of a slot: kind and curve, the level and on which side of it the curve was, or how high a peak is at least; the frequency,
its bounds, the one before and what was to be 0 there; its slope and sign; which lanes move; the curve at the end; in lane 0, whether any
lane moves."""
BRACKET: Final = 10


@compiled
def size_of(kind: int, x: float, y: float) -> float:
    """Return what a peak is a peak of: |1/(1 + L)|², |L/(1 + L)|² or |T|²."""
    square = x * x + y * y
    if kind == PEAK_H:
        return square
    distance = (1.0 + x) * (1.0 + x) + y * y
    return 1.0 / distance if kind == PEAK_S else square / distance


@compiled
def suspect(readings: Real, c: int, lane: int, bit: float) -> None:
    """Mark one kind of reading as doubtful."""
    if readings[c, DOUBT, lane] < ALL and int(readings[c, DOUBT, lane]) & int(bit) == 0:
        readings[c, DOUBT, lane] += bit


@compiled
def polish(
    program: SpectrumProgram, registers: Real, store_re: Real, store_im: Real, readings: Real, levels: Real, events: Real,
    most: int, omega: Real, points: Real, slots: Real, bracket: Real,
) -> None:  # fmt: skip
    """Polish the events of all lanes and enter what they say into the readings.

    Parameters
    ----------
    program, registers
        Of the curves.
    store_re, store_im : ndarray, shape (curves, frequencies, LANES)
    readings : ndarray, shape (curves, READINGS, LANES)
    levels : ndarray, shape (curves, LANES)
        What |T|² falls to.
    events : ndarray, shape (3, EVENTS, LANES)
        Kind, the number of the frequency at which it was seen, curve.
    most : int
        How many slots there are.
    omega, points, slots, bracket
        Room: (EVENTS, LANES), (4, places, EVENTS, LANES), (EVENTS, SLOT, LANES), (BRACKET, LANES).
    """
    re, im, dre, dim = points[0], points[1], points[2], points[3]
    for slot in range(most):
        _begin(program, store_re, store_im, levels, events, slot, slots[slot], bracket)
    for turn in range(_TURNS + 1):
        count = 0
        for slot in range(most):
            if slots[slot, OPEN, 0] > 0.0:
                store(omega, load2(slots, slot, HERE), count)
                count += 1
        if count == 0:
            break
        run_points(program.points, registers, omega, count, re, im, dre, dim)
        column = 0
        for slot in range(most):
            if slots[slot, OPEN, 0] > 0.0:
                _advance(program, slots[slot], column, turn, re, im, dre, dim)
                column += 1
    for slot in range(most):
        for lane in range(LANES):
            _conclude(readings, slots[slot], lane)


@compiled
def _begin(
    program: SpectrumProgram, store_re: Real, store_im: Real, levels: Real, events: Real, slot: int, state: Real,
    bracket: Real,
) -> None:  # fmt: skip
    """Find out where a slot begins, from the samples around each lane's event."""
    for lane in range(LANES):
        k, c = int(events[1, slot, lane]), int(events[2, slot, lane])
        for row in range(3):
            there = k - 1 + row
            bracket[row, lane] = program.frequencies[there]
            bracket[3 + row, lane] = store_re[c, there, lane]
            bracket[6 + row, lane] = store_im[c, there, lane]
        bracket[9, lane] = levels[c, lane]
    kind, level = load(events[0], slot), load(bracket, 9)
    level = select(kind == float(CROSS_UNIT), 1.0, select(kind == float(TURN_UNIT), 1.0, level))
    w0, w1, w2 = load(bracket, 0), load(bracket, 1), load(bracket, 2)
    f0 = _measured(kind, load(bracket, 3), load(bracket, 6), level)
    f1 = _measured(kind, load(bracket, 4), load(bracket, 7), level)
    f2 = _measured(kind, load(bracket, 5), load(bracket, 8), level)
    square = load(bracket, 4) * load(bracket, 4) + load(bracket, 7) * load(bracket, 7)
    peak = (kind >= float(PEAK_S)) & (kind <= float(TURN_LEVEL))
    # a crossing lies between the first two samples: frequency as a parabola of f, or else as a straight line
    line = w0 - f0 * (w1 - w0) / (f1 - f0)
    curved = (
        w0 * f1 * f2 / ((f0 - f1) * (f0 - f2)) + w1 * f0 * f2 / ((f1 - f0) * (f1 - f2))
        + w2 * f0 * f1 / ((f2 - f0) * (f2 - f1))
    )  # fmt: skip
    crossing = select((curved > w0) & (curved < w1), curved, line)
    # a peak between the outer ones: the vertex of the parabola
    before, after = (f1 - f0) / (w1 - w0), (f2 - f1) / (w2 - w1)
    second = 2.0 * (after - before) / (w2 - w0)
    vertex = 0.5 * (w0 + w1) - before / second
    low, high = w0, select(peak, w2, w1)
    here = select(peak, vertex, crossing)
    here = select((here > low) & (here < high), here, 0.5 * (low + high))
    # what is to be 0 at a peak, see `_missing`, and how that changes with frequency, from the samples
    steep, rising = second, select(peak, 1.0, select(f1 > f0, 1.0, -1.0))
    steep = select(kind == float(PEAK_T), square * square * second, steep)
    steep = select(kind == float(PEAK_H), -(square * square * second), steep)
    rising = select(kind == float(PEAK_H), -1.0, rising)
    rising = select((kind >= float(TURN_UNIT)) & (second < 0.0), -1.0, rising)
    moving = select(kind == float(NO_EVENT), 0.0, 1.0)
    store(state, kind, KIND)
    store(state, load(events[2], slot), CURVE)
    store(state, level, LEVEL)
    # a peak is a peak of the inverse of what `_measured` says
    store(state, select(kind >= float(TURN_UNIT), square - level, 1.0 / f1), SIDE)
    store(state, here, HERE)
    store(state, low, LOW)
    store(state, high, HIGH)
    store(state, steep, STEEP)
    store(state, rising, RISING)
    store(state, moving, MOVING)
    store(state, 1.0, OPEN)


@compiled
def _measured(kind: Any, x: Any, y: Any, level: Any) -> Any:
    """Return what is 0 at a crossing, or turns at a peak: the inverse of a peak is a parabola also where that is sharp."""
    square = x * x + y * y
    distance = (1.0 + x) * (1.0 + x) + y * y
    found = (square - level) / (square + level)
    found = select(kind == float(CROSS_AXIS), y, found)
    found = select(kind == float(PEAK_S), distance, found)
    found = select(kind == float(PEAK_T), distance / square, found)
    found = select(kind == float(PEAK_H), 1.0 / square, found)
    return select(kind >= float(TURN_UNIT), square, found)


@compiled
def _missing(kind: Any, x: Any, y: Any, dx: Any, dy: Any, level: Any) -> Any:
    """Return what is to become 0, and its slope at a crossing: |L|² - 1, Im L, |T|² - level, or the slope at a peak.

    The third is what such a slope is the slope of, in the same scale.
    """
    square, slope = x * x + y * y, 2.0 * (x * dx + y * dy)
    nearness, distance = 2.0 * ((1.0 + x) * dx + y * dy), (1.0 + x) * (1.0 + x) + y * y
    f = select(kind == float(CROSS_AXIS), y, square - level)
    f = select(kind == float(PEAK_S), nearness, f)
    f = select(kind == float(PEAK_T), nearness * square - distance * slope, f)
    value = select(kind == float(PEAK_S), distance, select(kind == float(PEAK_T), distance * square, square))
    return select(kind >= float(PEAK_H), slope, f), select(kind == float(CROSS_AXIS), dy, slope), value


@compiled
def _advance(
    program: SpectrumProgram, state: Real, column: int, turn: int, re: Real, im: Real, dre: Real, dim: Real
) -> None:
    """Take the next step of a slot whose curves were evaluated in ``column``, or find that it has arrived."""
    kind, curve, here, moving = load(state, KIND), load(state, CURVE), load(state, HERE), load(state, MOVING)
    x, y, dx, dy = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for c in range(program.wants.shape[0]):
        place, mine = program.points.targets[c], curve == float(c)
        x, y = select(mine, load2(re, place, column), x), select(mine, load2(im, place, column), y)
        dx, dy = select(mine, load2(dre, place, column), dx), select(mine, load2(dim, place, column), dy)
    goes, arrived = moving == 1.0, moving == _ARRIVED
    if turn == _TURNS or not anywhere(goes):
        _take_down(state, goes | arrived, x, y)
        store(state, select(goes, 1.0, 0.0), MOVING)
        store(state, 0.0, OPEN)
        return
    peak = (kind >= float(PEAK_S)) & (kind <= float(TURN_LEVEL))
    f, slope, value = _missing(kind, x, y, dx, dy, load(state, LEVEL))
    steep, rising = load(state, STEEP), load(state, RISING)
    if turn > 0:
        apart = here - load(state, LAST)
        secant = (f - load(state, F_LAST)) / select(apart == 0.0, 1.0, apart)
        steep = select((apart == 0.0) | (secant == 0.0), steep, secant)
    slope = select(peak, steep, slope)
    low, high = load(state, LOW), load(state, HIGH)
    beyond = f * rising > 0.0
    high = select(beyond & (here < high), here, high)
    low = select(beyond | (here < low), low, here)
    to = here - f / slope
    inside = (to >= low) & (to <= high)
    to = select(inside, to, 0.5 * (low + high))
    arrives = goes & inside & (magnitude(to - here) <= select(peak, _AGREED_PEAK, _AGREED) * here)
    changes = (to - here) * (to - here) * magnitude(steep)
    arrives = arrives & (select(peak, changes, 0.0) <= _SHARP * value)
    # after so short a last step nothing need be evaluated again
    ahead, square, distance = select(goes, to - here, 0.0), x * x + y * y, (1.0 + x) * (1.0 + x) + y * y
    size = select((kind >= float(PEAK_S)) & (kind <= float(PEAK_T)) & (distance < square), distance, square)
    straight = arrives & ((dx * dx + dy * dy) * (ahead * ahead) <= _STRAIGHT * size)
    straight = straight & (select(peak, changes, 0.0) <= _BELOW * value)
    done = straight | arrived
    _take_down(state, done, x + dx * ahead, y + dy * ahead)
    store(state, here + ahead, HERE)
    moving = select(done, 0.0, select(arrives, _ARRIVED, moving))
    store(state, moving, MOVING)
    if not anywhere(moving > 0.0):
        store(state, 0.0, OPEN)
        return
    store(state, steep, STEEP)
    store(state, low, LOW)
    store(state, high, HIGH)
    store(state, here, LAST)
    store(state, f, F_LAST)


@compiled
def _take_down(state: Real, who: Any, x: Any, y: Any) -> None:
    """Take down the curve at the end, of those who are there: the others, who go on, change nothing in it."""
    store(state, select(who, x, load(state, X)), X)
    store(state, select(who, y, load(state, Y)), Y)


@compiled
def _conclude(readings: Real, state: Real, lane: int) -> None:
    """Enter what a polished event says of its curve, L or T being x + jy there."""
    kind, c = int(state[KIND, lane]), int(state[CURVE, lane])
    reading = readings[c]
    omega, x, y = state[HERE, lane], state[X, lane], state[Y, lane]
    if state[MOVING, lane] > 0.0:
        reading[DOUBT, lane] = ALL
    if kind == CROSS_UNIT:
        margin = math.atan2(-y, -x)
        if abs(margin) < abs(reading[PHASE_MARGIN, lane]):
            reading[PHASE_MARGIN, lane], reading[PHASE_AT, lane] = margin, omega
        turn_left = margin if margin >= -1e-12 else margin + 2.0 * math.pi
        if turn_left / omega < reading[DELAY_MARGIN, lane]:
            reading[DELAY_MARGIN, lane], reading[DELAY_AT, lane] = turn_left / omega, omega
    elif kind == CROSS_AXIS:
        if x < -SMALLEST and abs(math.log(-x)) < abs(math.log(reading[GAIN_MARGIN, lane])):
            reading[GAIN_MARGIN, lane], reading[GAIN_AT, lane] = -1.0 / x, omega
        elif -SMALLEST <= x < -FAINTEST and math.isinf(reading[GAIN_MARGIN, lane]):
            reading[GAIN_AT, lane] = FAINT
    elif kind == CROSS_LEVEL:
        reading[FIRST_FALL, lane] = omega
    elif kind in (TURN_UNIT, TURN_LEVEL):
        goal = state[LEVEL, lane]
        away = x * x + y * y - goal
        if not (away * state[SIDE, lane] > 0.0 and abs(away) > _TOUCHES * goal):
            suspect(readings, c, lane, float(PHASE if kind == TURN_UNIT else BANDWIDTH))
            if kind == TURN_UNIT:
                suspect(readings, c, lane, float(DELAY))
    elif kind != NO_EVENT:
        to, square = HIGHEST if kind == PEAK_H else MS + kind - PEAK_S, size_of(kind, x, y)
        if not square >= (1.0 - _BELOW) * state[SIDE, lane]:
            suspect(readings, c, lane, float(SENSITIVITY << (kind - PEAK_S) if kind != PEAK_H else PEAK))
        height = math.sqrt(square)
        if height > reading[to, lane]:
            reading[to, lane], reading[MS_AT + kind - PEAK_S, lane] = height, omega
