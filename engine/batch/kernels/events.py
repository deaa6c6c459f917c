"""The events of step responses: from the interval in which a scan saw them to their instants.

Powers of the exponential for 1, 2, 4 ... steps walk all events of eight candidates together down the binary digits of time:
first to the interval, then within it for as long as the event lies ahead. In the last step Newton's method on the Taylor
polynomial of the output finishes. A reading that the scan could not vouch for is marked doubtful.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, compiled, multiply
from engine.batch.kernels.scan_state import (
    BIG,
    DOWN,
    EDGE,
    ENTRY,
    GRAZE2,
    GRAZE5,
    HIGHEST,
    LOW,
    LOWEST,
    MIXED,
    N2,
    N5,
    N10,
    N90,
    NONE,
    POKE2,
    RANKS,
    RISE,
    SETTLE_2,
    SETTLE_5,
    SIDE2,
    SLIGHT,
    SURE,
    TOP,
    UP,
    WHEN,
)
from engine.batch.kernels.time_program import TimeProgram
from engine.batch.kernels.vector import anywhere, load, load2, magnitude, select, spread, store, store2

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]

FINAL, T_10, T_90, T_2, T_5, TOP_VALUE, TOP_TIME, BOTTOM_VALUE, BOTTOM_TIME, DOUBT, SIZE = range(11)
READINGS: Final = 11
"""What is read off one response; times in s; the top is the furthest in the direction of the final value. DOUBT is the sum
of the kinds of `engine.batch.kernels.scan_state` that are not vouched for."""

TAYLOR: Final = 14
"""Terms of the last step's Taylor polynomial: ‖(A h)^14‖ / 14! is 1e-10 at most, where ‖A h‖ is 2.56 and ‖(A h)^8‖ 0.64^8."""
MOST: Final = 12
"""At most so many events of one response are polished, two of them twice."""
_RIVAL: Final = 1e-6
"""Turning points that are so near to each other in height are all polished before the highest is chosen."""
_NOISE: Final = 1e-12
_NEWTON: Final = 12
_STILL: Final = 1e-8
"""Newton's method has arrived where it moves by less than this part of a step: the next move is its square."""

OFFSET, LEVEL, SIGN, TARGET, UNITS, TAU, VALUE, HIGH, AT = range(9)
"""Numbers of an event: the steps to its interval, the interval's level, -1 or 1, the deviation or slope it waits for; and the
result: whole steps, the part of a step from there, the deviation there. On the way that part lies between TAU and HIGH, at AT."""
NUMBERS: Final = 9
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
        terms, t, v = polynomials[q], load2(numbers, AT, q), spread(0.0)
        for k in range(TAYLOR - 1, -1, -1):
            v = v * t + load(terms, k)
        store2(numbers, t, TAU, q)
        store2(numbers, v, VALUE, q)


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
    store2(numbers, low, TAU, q)
    store2(numbers, high, HIGH, q)
    store2(numbers, new, AT, q)
    return bool(anywhere(magnitude(new - t) > _STILL))


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
def _begin(
    roles: Whole, numbers: Real, state: Real, q: int, output: int, by_slope: int, trace: int, field: int, reading: int
) -> int:  # fmt: skip
    """Enter an event whose interval is in ``field`` and the next; return the number of the next event."""
    roles[OUTPUT, q], roles[BY_SLOPE, q], roles[TRACE, q], roles[FIELD, q] = output, by_slope, trace, field
    roles[READING, q] = reading
    level = load(state, field + 1)
    store2(numbers, load(state, field), OFFSET, q)
    store2(numbers, select(level > 0.0, level, 0.0), LEVEL, q)
    store2(numbers, 0.0, TARGET, q)
    store2(numbers, 0.0, TAU, q)
    return q + 1


@compiled
def _least(state: Real, first: int) -> Any:
    """Return how far the furthest turning point reaches at least."""
    height = load(state, first)
    return height - _RIVAL * magnitude(height) - SURE * load(state, first + 3)


@compiled
def _gather(program: TimeProgram, experiment: int, states: Real, final: Real, roles: Whole, numbers: Real) -> int:
    """Enter all events of the responses to a command; return how many there are."""
    count = 0
    for t in range(program.traces.shape[0]):
        o, wants, state = program.traces[t, 0], program.traces[t, 2], states[t]
        if program.traces[t, 1] != experiment:
            continue
        goal = load(final, t)
        size, way = magnitude(goal), select(goal >= 0.0, 1.0, -1.0)
        if wants & RISE:
            for f, to, part in ((N10, T_10, -0.9), (N90, T_90, -0.1)):
                count = _begin(roles, numbers, state, count, o, 0, t, f, to)
                store2(numbers, way, SIGN, count - 1)
                store2(numbers, part * goal, TARGET, count - 1)
        for bit, f, to, part in ((SETTLE_2, N2, T_2, 0.02), (SETTLE_5, N5, T_5, 0.05)):
            if wants & bit:
                side = load(state, f + SIDE2 - N2)
                count = _begin(roles, numbers, state, count, o, 0, t, f, to)
                store2(numbers, side, SIGN, count - 1)
                store2(numbers, -(side * (part * size)), TARGET, count - 1)
        for bit, f, to in ((HIGHEST, TOP, TOP_VALUE), (LOWEST, LOW, BOTTOM_VALUE)):
            if wants & bit:
                least = _least(state, f)
                for rank in range(RANKS):
                    entry = f + ENTRY * rank
                    reaches = load(state, entry) + SURE * load(state, entry + 3) >= least
                    if anywhere(reaches & (load(state, entry + 2) >= 0.0)):
                        count = _begin(roles, numbers, state, count, o, 1, t, entry + 1, to)
                        store2(numbers, -way if bit == HIGHEST else way, SIGN, count - 1)
    main = count
    for q in range(main):
        to, state, f = roles[READING, q], states[roles[TRACE, q]], roles[FIELD, q]
        if to in (T_2, T_5):
            poking = load(state, f + POKE2 - N2) > 0.0
            if anywhere(poking):
                # A tip pokes out of the band between two samples: first to the tip, where the slope changes its sign.
                count = _begin(roles, numbers, state, count, roles[OUTPUT, q], 1, roles[TRACE, q], f, NOTHING)
                roles[FIELD, count - 1] = q
                store2(numbers, load2(numbers, SIGN, q), SIGN, count - 1)
                store2(numbers, select(poking, load2(numbers, LEVEL, q), 0.0), LEVEL, count - 1)
                store2(numbers, select(poking, 0.0, load2(numbers, LEVEL, q)), LEVEL, q)
    return count


@compiled
def _pad(roles: Whole, numbers: Real, count: int) -> int:
    """Enter events that nobody asks for up to a multiple of 4, which is returned."""
    events = (count + 3) // 4 * 4
    for q in range(count, events):
        roles[OUTPUT, q], roles[BY_SLOPE, q], roles[READING, q] = 0, 0, NOTHING
        for k in range(NUMBERS):
            store2(numbers, 0.0, k, q)
    return events


@compiled
def locate(
    program: TimeProgram, experiment: int, states: Real, powers: Real, start: Real, rows: Real, taylors: Real,
    final: Real, step: Real, readings: Real, roles: Whole, numbers: Real, room: Real, polynomials: Real,
) -> None:  # fmt: skip
    """Polish every event of the responses to one command.

    Parameters
    ----------
    program, experiment
        Whose traces, and which of them.
    states : ndarray, shape (traces, FIELDS, LANES)
        Of their scans.
    powers, rows, taylors
        As `walk` takes them.
    start : ndarray, shape (nn, LANES)
        The deviation of the states at t = 0+ from their values at rest.
    final : ndarray, shape (traces, LANES)
    step : ndarray, shape (LANES,)
    readings : ndarray, shape (traces, READINGS, LANES)
        Written.
    roles, numbers, room, polynomials
        Room: (2, ROLES, most), (2, NUMBERS, most, LANES), (3, nn * most, LANES), (most, TAYLOR, LANES), where ``most`` is MOST for
        every trace.
    """
    nn, h = program.padded, load(step, 0)
    role, number = roles[0], numbers[0]
    for t in range(program.traces.shape[0]):
        if program.traces[t, 1] == experiment:
            _conclude(states[t], readings[t], final[t], program.traces[t, 2])
    count = _gather(program, experiment, states, final, role, number)
    if count == 0:
        return
    events = _pad(role, number, count)
    e = room[0, : nn * events].reshape(nn, events, LANES)
    for i in range(nn):
        for q in range(events):
            store2(e, load(start, i), i, q)
    trial = room[1, : nn * events].reshape(nn, events, LANES)
    walk(powers, nn, taylors, rows, role, events, number, e, trial, polynomials)
    if role[READING, count - 1] == NOTHING:
        _return(powers, nn, taylors, rows, roles, count, numbers, e, room, states, polynomials)
    for q in range(count):
        to, state, reading = role[READING, q], states[role[TRACE, q]], readings[role[TRACE, q]]
        depth, time = load(state, role[FIELD, q] + 1), (load2(number, UNITS, q) + load2(number, TAU, q)) * h
        if to in (T_10, T_90):
            store(reading, select(depth == EDGE, 0.0, select(depth == NONE, math.nan, time)), to)
        elif to in (T_2, T_5):
            store(reading, select(depth == NONE, 0.0, time), to)
        elif to != NOTHING:
            goal, known = load(final, role[TRACE, q]), load(reading, to)
            way = select(goal >= 0.0, 1.0, -1.0) * (1.0 if to == TOP_VALUE else -1.0)
            height = way * (load2(number, VALUE, q) + goal)
            # where a response leaves its highest value slowly, the first samples equal it to rounding
            higher = (depth >= 0.0) & (height > way * known + _NOISE * magnitude(known))
            store(reading, select(higher, way * height, known), to)
            store(reading, select(higher, time, load(reading, to + 1)), to + 1)


@compiled
def _return(
    powers: Real, nn: int, taylors: Real, rows: Real, roles: Whole, count: int, numbers: Real, e: Real, room: Real,
    states: Real, polynomials: Real,
) -> None:  # fmt: skip
    """Go from tips that poke out of a band back into it."""
    first = count
    while first > 0 and roles[0, READING, first - 1] == NOTHING:
        first -= 1
    events = _pad(roles[1], numbers[1], count - first)
    tips = room[2, : nn * events].reshape(nn, events, LANES)
    trial = room[1, : nn * events].reshape(nn, events, LANES)
    for p in range(events):
        q = min(first + p, count - 1)
        for i in range(nn):
            store2(tips, load2(e, i, q), i, p)
        aim = roles[0, FIELD, q]
        roles[1, OUTPUT, p], roles[1, BY_SLOPE, p] = roles[0, OUTPUT, q], 0
        store2(numbers[1], 0.0, OFFSET, p)
        for k in (LEVEL, TAU):
            store2(numbers[1], load2(numbers[0], k, q), k, p)
        for k in (SIGN, TARGET):
            store2(numbers[1], load2(numbers[0], k, aim), k, p)
    walk(powers, nn, taylors, rows, roles[1], events, numbers[1], tips, trial, polynomials)
    for q in range(first, count):
        aim = roles[0, FIELD, q]
        poking = load(states[roles[0, TRACE, aim]], roles[0, FIELD, aim] + POKE2 - N2) > 0.0
        units = load2(numbers[0], UNITS, q) + load2(numbers[1], UNITS, q - first)
        store2(numbers[0], select(poking, units, load2(numbers[0], UNITS, aim)), UNITS, aim)
        store2(numbers[0], select(poking, load2(numbers[1], TAU, q - first), load2(numbers[0], TAU, aim)), TAU, aim)


@compiled
def _conclude(state: Real, reading: Real, final: Real, wants: int) -> None:
    """Write what needs no instant: the final value, what is highest at the edge t = 0+, and the kinds in doubt."""
    goal = load(final, 0)
    size, way = magnitude(goal), select(goal >= 0.0, 1.0, -1.0)
    store(reading, goal, FINAL)
    store(reading, load(state, BIG), SIZE)
    doubt = spread(0.0)
    if wants & RISE:
        doubt = doubt + select(load(state, MIXED) > 0.0, float(RISE), 0.0)
    for bit, f in ((SETTLE_2, GRAZE2), (SETTLE_5, GRAZE5)):
        if wants & bit:
            doubt = doubt + select(load(state, f) > 0.0, float(bit), 0.0)
    for bit, f, to, unseen in ((HIGHEST, TOP, TOP_VALUE, UP), (LOWEST, LOW, BOTTOM_VALUE, DOWN)):
        up = way if bit == HIGHEST else -way
        store(reading, -1e300 * up, to)
        store(reading, 0.0, to + 1)
        for rank in range(RANKS):
            entry = f + ENTRY * rank
            store(
                reading, select(load(state, entry + 2) == EDGE, up * load(state, entry) + goal, load(reading, to)), to
            )
        if wants & bit:
            height = load(state, f)
            # what is hidden may be higher than what was found, or be all that lies beyond the final value
            least = select(height > 0.0, 1.001 * height, (1e-9 if wants & WHEN else SLIGHT) * size)
            suspect = (load(state, f + ENTRY * RANKS) > _least(state, f)) | (load(state, unseen) > least)
            doubt = doubt + select(suspect, float(bit), 0.0)
    store(reading, doubt, DOUBT)
