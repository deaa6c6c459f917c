"""From states to events of step responses: over whole steps by powers of the exponential, and within a step by its Taylor polynomial.

Powers of the exponential for 1, 2, 4 ... steps walk all events of eight candidates together down the binary digits of time:
first to the interval, then within it for as long as the event lies ahead. In the last step Newton's method on the Taylor
polynomial of the output finishes.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import compiled, multiply
from engine.batch.kernels.vector import anywhere, load, load2, magnitude, select, spread, store, store2

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]

TAYLOR: Final = 14
"""Terms of the last step's Taylor polynomial: ‖(A h)^14‖ / 14! is 1e-10 at most, where ‖A h‖ is 2.56 and ‖(A h)^8‖ 0.64^8."""
_NEWTON: Final = 12
_STILL: Final = 1e-8
"""Newton's method has arrived where it moves by less than this part of a step: the next move is its square."""
_SHARP: Final = 1.6
"""Angle of a swing between samples, rad, from which on they may not show it."""

OFFSET, LEVEL, SIGN, TARGET, UNITS, TAU, VALUE, HIGH, AT, WIDTH, SHARP = range(11)
"""Numbers of an event: the steps to its interval, the interval's level and width, -1 or 1, the deviation or slope it waits for; and the
result: whole steps, the part of a step from there, the deviation there, and how far the response swings at most where that is too fast
for the samples that showed the event, else 0. On the way that part lies between TAU and HIGH, at AT."""
NUMBERS: Final = 11
OUTPUT, BY_SLOPE, TRACE, FIELD, READING = range(5)
"""What an event is, the same for all lanes: it watches an output or its slope, for a field of a trace and a reading. An
event on the way to another one has that one's number for a field, and no reading."""
ROLES: Final = 5
NOTHING: Final = -1


@compiled
def walk(
    powers: Real, nn: int, taylors: Real, rows: Real, roles: Whole, events: int, numbers: Real, e: Real, trial: Real,
    polynomials: Real,
) -> None:  # fmt: skip
    """Go from states to events, several events of every lane at once: first over whole steps, then to the change of sign.

    An event is the zero of sign * (output - target), negative before it; or of the output's slope instead. An event in the
    first step lies after the part of it that is given. ``events`` is a multiple of 4.

    Parameters
    ----------
    powers, taylors, rows
        Of the exponential (levels, nn, nn, LANES); C (A h)^k of the outputs C (outputs, TAYLOR, nn, LANES); rows of every
        output and of its slope (2 outputs, nn, LANES).
    roles : ndarray, shape (ROLES, events)
    numbers : ndarray, shape (NUMBERS, events, LANES)
    e : ndarray, shape (nn, events, LANES)
        The states; on return those at so many whole steps.
    trial, polynomials
        Room of the shapes of ``e`` and (events, TAYLOR, LANES).
    """
    _over_whole_steps(powers, nn, rows, roles, events, numbers, e, trial)
    for q in range(events):
        taylor, terms, factor = taylors[roles[OUTPUT, q]], polynomials[q], 1.0
        for k in range(TAYLOR):
            coefficient = spread(0.0)
            for i in range(nn):
                coefficient = coefficient + load2(taylor, k, i) * load2(e, i, q)
            store(terms, coefficient * factor, k)
            factor /= k + 1.0
        store2(numbers, 1.0, HIGH, q)
        store2(numbers, _between(terms, roles[BY_SLOPE, q], load2(numbers, TARGET, q), load2(numbers, TAU, q)), AT, q)
    # round by round, not event by event: events do not wait for each other
    for _ in range(_NEWTON):
        moves = False
        for q in range(events):
            moves = _improved(roles[BY_SLOPE, q], q, numbers, polynomials[q]) or moves
        if not moves:
            break
    for q in range(events):
        _arrive(q, numbers, polynomials[q])


@compiled
def _over_whole_steps(
    powers: Real, nn: int, rows: Real, roles: Whole, events: int, numbers: Real, e: Real, trial: Real
) -> None:  # fmt: skip
    """Go over as many whole steps as lie before the events, by powers of 2 of them."""
    furthest, widest = spread(0.0), spread(0.0)
    for q in range(events):
        offset, level = load2(numbers, OFFSET, q), load2(numbers, LEVEL, q)
        furthest = select(offset > furthest, offset, furthest)
        widest = select(level > widest, level, widest)
        store2(numbers, 0.0, UNITS, q)
    top = 0
    while anywhere(furthest >= 2.0 ** (top + 1)):
        top += 1
    while anywhere(widest > float(top + 1)):
        top += 1
    for k in range(top, -1, -1):
        width = float(1 << k)
        for first in range(0, events, 4):
            # early events have nothing to do with the long steps
            due = False
            for q in range(first, first + 4):
                level = load2(numbers, LEVEL, q)
                due = due or anywhere((level > float(k)) | (load2(numbers, OFFSET, q) >= width))
            if not due:
                continue
            multiply(trial[0, first:], powers[k], e[0, first:], nn, 4, nn, nn, events, events)
            for q in range(first, first + 4):
                left, level = load2(numbers, OFFSET, q), load2(numbers, LEVEL, q)
                searching = level > float(k)
                far = (level <= float(k)) & (left >= width)
                go = far
                if anywhere(searching):
                    row = 2 * roles[OUTPUT, q] + roles[BY_SLOPE, q]
                    reached = spread(0.0)
                    for i in range(nn):
                        reached = reached + load2(rows, row, i) * load2(trial, i, q)
                    ahead = load2(numbers, SIGN, q) * (reached - load2(numbers, TARGET, q)) < 0.0
                    go = far | (searching & ahead)
                if anywhere(go):
                    units = load2(numbers, UNITS, q)
                    store2(numbers, select(far, left - width, left), OFFSET, q)
                    store2(numbers, select(go, units + width, units), UNITS, q)
                    store2(numbers, select(go, 0.0, load2(numbers, TAU, q)), TAU, q)
                    for i in range(nn):
                        store2(e, select(go, load2(trial, i, q), load2(e, i, q)), i, q)


@compiled
def _improved(by_slope: int, q: int, numbers: Real, terms: Real) -> bool:
    """Take one step of Newton's method, kept in its bracket, to event ``q``; whether anybody still moves."""
    t, v, d, bend = load2(numbers, AT, q), spread(0.0), spread(0.0), spread(0.0)
    if by_slope:
        for k in range(TAYLOR - 1, -1, -1):
            bend = bend * t + d
            d = d * t + v
            v = v * t + load(terms, k)
        v, d = d, 2.0 * bend
    else:
        for k in range(TAYLOR - 1, -1, -1):
            d = d * t + v
            v = v * t + load(terms, k)
    g, low, high = v - load2(numbers, TARGET, q), load2(numbers, TAU, q), load2(numbers, HIGH, q)
    before = load2(numbers, SIGN, q) * g < 0.0
    low, high = select(before, t, low), select(before, high, t)
    new = t - g / d
    new = select((new >= low) & (new <= high), new, 0.5 * (low + high))
    moves = magnitude(new - t) > _STILL
    # a bracket without width keeps who has arrived where he is while others still move
    store2(numbers, select(moves, low, new), TAU, q)
    store2(numbers, select(moves, high, new), HIGH, q)
    store2(numbers, new, AT, q)
    return bool(anywhere(moves))


@compiled
def _between(terms: Real, by_slope: int, goal: Any, low: Any) -> Any:
    """Return where in a step an event lies if what it waits for, known at both ends, goes straight from one to the other."""
    begin, end = load(terms, 0) - goal, -goal
    if by_slope:
        begin, end = load(terms, 1) - goal, -goal
        for k in range(1, TAYLOR):
            end = end + load(terms, k) * float(k)
    else:
        for k in range(TAYLOR):
            end = end + load(terms, k)
    straight = begin / (begin - end)
    return select((straight > low) & (straight < 1.0), straight, 0.5 * (low + 1.0))


@compiled
def _arrive(q: int, numbers: Real, terms: Real) -> None:
    """Write where event ``q`` lies, the deviation there, and how far the response swings there where that is too fast for the samples.

    Of A sin(ω t) with s = ω times the distance of the samples, the derivatives over that distance are A s, A s², A s³ and A s⁴ times sine or
    cosine: the two higher ones are s² times the two lower ones, wherever in its swing the event lies.
    """
    t, width = load2(numbers, AT, q), load2(numbers, WIDTH, q)
    v, d, b, c, f = spread(0.0), spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for k in range(TAYLOR - 1, -1, -1):
        f = f * t + c
        c = c * t + b
        b = b * t + d
        d = d * t + v
        v = v * t + load(terms, k)
    lower = (magnitude(d) + 2.0 * width * magnitude(b)) * width
    higher = (6.0 * magnitude(c) + 24.0 * width * magnitude(f)) * (width * width * width)
    store2(numbers, t, TAU, q)
    store2(numbers, v, VALUE, q)
    # the fastest mode of all turns by 0.64 in a step
    store2(numbers, select((width > 2.0) & (higher > _SHARP * _SHARP * lower), higher, 0.0), SHARP, q)
