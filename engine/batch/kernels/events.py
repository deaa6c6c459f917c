"""The events of step responses: from the interval in which a scan saw them to their instants.

A reading that the scan could not vouch for is marked doubtful, and so is one of an event where the response swings faster than the
samples that showed it: others may lie between them.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, compiled
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
from engine.batch.kernels.vector import anywhere, lanes_of, load, load2, magnitude, select, spread, store, store2
from engine.batch.kernels.walking import (
    BY_SLOPE,
    FIELD,
    LEVEL,
    NOTHING,
    NUMBERS,
    OFFSET,
    OUTPUT,
    READING,
    SHARP,
    SIGN,
    TARGET,
    TAU,
    TRACE,
    UNITS,
    VALUE,
    WIDTH,
    walk,
)

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]

FINAL, T_10, T_90, T_2, T_5, TOP_VALUE, TOP_TIME, BOTTOM_VALUE, BOTTOM_TIME, DOUBT, SIZE = range(11)
READINGS: Final = 11
"""What is read off one response; times in s; the top is the furthest in the direction of the final value. DOUBT is the sum
of the kinds of `engine.batch.kernels.scan_state` that are not vouched for."""

_KIND: Final = (0, RISE, RISE, SETTLE_2, SETTLE_5, HIGHEST, HIGHEST, LOWEST, LOWEST, 0, 0)
"""Of which kind a reading is."""
_WIDEST: Final = 10
"""Samples 2^10 steps apart and further count as that: what higher derivatives over so many steps are is rounding."""
MOST: Final = 12
"""At most so many events of one response are polished, two of them twice."""
_NEAR: Final = 1e-2
"""Turning points that are so near to each other in height are all polished before the highest is chosen: each tells whether others hide there."""
_RIVAL: Final = 1e-6
"""One that is so near to them and was not kept is in the way."""
_NOISE: Final = 1e-12
_AGREED: Final = 1e-9
"""What is read of a turning point and what was seen of it may differ by so much of the largest value, beside the error of what was seen."""


@compiled
def _begin(
    roles: Whole, numbers: Real, state: Real, q: int, output: int, by_slope: int, trace: int, field: int, reading: int
) -> int:  # fmt: skip
    """Enter an event whose interval is in ``field`` and the next; return the number of the next event."""
    roles[OUTPUT, q], roles[BY_SLOPE, q], roles[TRACE, q], roles[FIELD, q] = output, by_slope, trace, field
    roles[READING, q] = reading
    level = load(state, field + 1)
    for lane in range(LANES):
        numbers[WIDTH, q, lane] = float(1 << min(max(int(state[field + 1, lane]), 0), _WIDEST))
    store2(numbers, load(state, field), OFFSET, q)
    store2(numbers, select(level > 0.0, level, 0.0), LEVEL, q)
    store2(numbers, 0.0, TARGET, q)
    store2(numbers, 0.0, TAU, q)
    return q + 1


@compiled
def _least(state: Real, first: int, share: float) -> Any:
    """Return how far the furthest turning point reaches at least, less a share of it."""
    height = load(state, first)
    return height - share * magnitude(height) - SURE * load(state, first + 3)


@compiled
def _rivals(state: Real, first: int, entry: int) -> Any:
    """Return who has in an entry of a list a turning point that may be the furthest, or is so near to that as to tell what else is there."""
    reaches = load(state, entry) + SURE * load(state, entry + 3) >= _least(state, first, _NEAR)
    return reaches & (load(state, entry + 2) >= 0.0)


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
                for rank in range(RANKS):
                    entry = f + ENTRY * rank
                    if anywhere(_rivals(state, f, entry)):
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
        sharp = (depth >= 0.0) & (load2(number, SHARP, q) > _AGREED * load(reading, SIZE))
        if to in (T_10, T_90):
            store(reading, select(depth == EDGE, 0.0, select(depth == NONE, math.nan, time)), to)
        elif to in (T_2, T_5):
            store(reading, select(depth == NONE, 0.0, time), to)
        elif to != NOTHING:
            goal, known = load(final, role[TRACE, q]), load(reading, to)
            way = select(goal >= 0.0, 1.0, -1.0) * (1.0 if to == TOP_VALUE else -1.0)
            height = way * (load2(number, VALUE, q) + goal)
            entry = role[FIELD, q] - 1
            rivals = _rivals(state, TOP if to == TOP_VALUE else LOW, entry)
            # a turning point that is not where it was seen is another one: there are several between two samples
            apart = magnitude(way * load2(number, VALUE, q) - load(state, entry))
            sharp = rivals & (sharp | (apart > SURE * load(state, entry + 3) + _AGREED * load(reading, SIZE)))
            # where a response leaves its highest value slowly, the first samples equal it to rounding
            higher = rivals & (height > way * known + _NOISE * magnitude(known))
            store(reading, select(higher, way * height, known), to)
            store(reading, select(higher, time, load(reading, to + 1)), to + 1)
        if to != NOTHING and anywhere(sharp):
            _suspect(reading, lanes_of(sharp), _KIND[to])


@compiled
def _suspect(reading: Real, lanes: int, bit: int) -> None:
    """Mark a kind of reading as doubtful in some lanes."""
    for lane in range(LANES):
        if (lanes >> lane) & 1 and not int(reading[DOUBT, lane]) & bit:
            reading[DOUBT, lane] += float(bit)


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
        for k in (LEVEL, TAU, WIDTH):
            store2(numbers[1], load2(numbers[0], k, q), k, p)
        for k in (SIGN, TARGET):
            store2(numbers[1], load2(numbers[0], k, aim), k, p)
    walk(powers, nn, taylors, rows, roles[1], events, numbers[1], tips, trial, polynomials)
    for q in range(first, count):
        aim = roles[0, FIELD, q]
        poking = load(states[roles[0, TRACE, aim]], roles[0, FIELD, aim] + POKE2 - N2) > 0.0
        units = load2(numbers[0], UNITS, q) + load2(numbers[1], UNITS, q - first)
        store2(numbers[0], select(poking, units, load2(numbers[0], UNITS, aim)), UNITS, aim)
        for k in (TAU, SHARP):
            store2(numbers[0], select(poking, load2(numbers[1], k, q - first), load2(numbers[0], k, aim)), k, aim)


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
            suspect = (load(state, f + ENTRY * RANKS) > _least(state, f, _RIVAL)) | (load(state, unseen) > least)
            doubt = doubt + select(suspect, float(bit), 0.0)
    store(reading, doubt, DOUBT)
