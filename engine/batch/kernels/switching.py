"""The march of `engine.batch.kernels.marching` for laws that remember their modes: cut where a mode ends, eight candidates after eight.

A step is taken in the modes at its beginning. Where a guard is positive at its end, the instant from which on it is so is
enclosed on the step by the Illinois method, which aims at what is just beyond and solves the part of the step before again for every
trial; modes and states change there, and the rest of the step is taken in the new modes. Inputs and delayed signals on a part of a step are Hermite's cubic
through their values and slopes at its ends. The candidates of a vector have their ends each; one without any keeps its step as it was.

References
----------
M. Dowell, P. Jarratt, "A modified regula falsi method for computing the root of an equation", BIT 11 (1971) 168-174.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, allocating, compiled
from engine.batch.kernels.functions import multiply_add
from engine.batch.kernels.marching import drive, interpret
from engine.batch.kernels.vector import load, load2, select, spread, store, store2

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]

_TRIALS = 14
"""Of the instant of an event at most;"""
_FLAT = 1e-11
"""Where it has been nearer to 0 than this part of what it is beyond, its bracket is halved."""
_RESOLVED = 1e-9
"""fewer where it is known to this part of a step, or the guard is about this part of what it has risen by."""
_MOST_EVENTS = 16
"""So many on one step, or in one instant, are chattering: the candidate is given up."""
_SMALL = 1e-6
"""What begins to be held residuals by no more than this part of the largest guard."""
_NOTHING = 1e-12
"""A guard below this part of its largest value is 0."""


class ChangeRows(NamedTuple):
    """See `engine.batch.nonlinear.program.ChangeTape`."""

    tape: Whole
    made: Whole
    given: Whole
    residuals: Whole
    guards: Whole


class Tapes(NamedTuple):
    """What a march runs; see `engine.batch.nonlinear.program.Program`."""

    whole: Whole
    rates_only: Whole
    rates: Whole
    read: Whole
    entering: Whole
    guards: Whole
    switched: ChangeRows
    settled: ChangeRows
    released: ChangeRows


@compiled
def _between(registers: Real, first: int, counts: Whole, ends: Real, theta: Real, width: float) -> None:
    """Put inputs and delayed signals at the parts ``theta`` (1, LANES) of a step into the registers.

    ``ends`` (2, signals with their slopes, LANES) are those at both ends of it; ``counts`` how many inputs and delayed signals there are.
    """
    place = 0
    p = load(theta, 0)
    q = 1.0 - p
    for count in counts:
        for i in range(place, place + count):
            y0, y1 = load2(ends, 0, i), load2(ends, 1, i)
            d0, d1 = load2(ends, 0, count + i) * width, load2(ends, 1, count + i) * width
            value = q * q * (1.0 + 2.0 * p) * y0 + p * p * (3.0 - 2.0 * p) * y1 + p * q * (q * d0 - p * d1)
            slope = 6.0 * p * q * (y1 - y0) + q * (1.0 - 3.0 * p) * d0 + p * (3.0 * p - 2.0) * d1
            store2(registers, value, first + i, 0)
            store2(registers, slope / width, first + count + i, 0)
        place += 2 * count


@compiled
def _part(
    tapes: Tapes, registers: Real, base: Real, total: Real, counts: Whole, ends: Real, begin: Real, end: Real,
    theta: Real, width: float,
) -> None:  # fmt: skip
    """Take the part from ``begin`` to ``end`` (1, LANES) of a step, from the states ``base``, in the modes that the registers hold."""
    states = tapes.rates.shape[0]
    start, stop = load(begin, 0), load(end, 0)
    length = (stop - start) * width
    for i in range(states):
        store2(registers, load(base, i), i, 0)
        store(total, load(base, i), i)
    for stage in range(4):
        along = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
        store(theta, start + along * (stop - start), 0)
        _between(registers, states, counts, ends, theta, width)
        interpret(tapes.rates_only, registers)
        share = length * (1 / 6 if stage in (0, 3) else 1 / 3)
        onward = length * (1.0 if stage == 2 else 0.5)
        for i in range(states):
            slope = load2(registers, tapes.rates[i], 0)
            reached = multiply_add(slope, share, load(total, i))
            store(total, reached, i)
            store2(registers, reached if stage == 3 else multiply_add(slope, onward, load(base, i)), i, 0)
    store(theta, stop, 0)
    _between(registers, states, counts, ends, theta, width)


@compiled
def _largest(guards: Whole, registers: Real, scales: Real, found: Real) -> None:
    """Set ``found`` (LANES,) to the largest guard, by how much it is beyond what counts as 0."""
    for lane in range(LANES):
        found[lane] = -np.inf
    for k in range(guards.shape[0]):
        for lane in range(LANES):
            beyond = registers[guards[k], 0, lane] - _NOTHING * scales[k, lane]
            found[lane] = max(found[lane], beyond)


@compiled
def _change(change: ChangeRows, registers: Real, scales: Real, who: Real, room: Real, lost: Real) -> None:
    """Change modes and states as a tape that has been run says, of the candidates ``who`` (1, LANES) is positive for."""
    for k in range(change.residuals.shape[0]):
        for lane in range(LANES):
            residual = abs(registers[change.residuals[k], 0, lane])
            if who[0, lane] > 0.0 and not residual <= _SMALL * scales[k, lane]:
                lost[lane] = 1.0
    chosen = load(who, 0) > 0.0
    for i in range(change.made.shape[0]):
        store(room, select(chosen, load2(registers, change.made[i], 0), load2(registers, change.given[i], 0)), i)
    for i in range(change.made.shape[0]):
        store2(registers, load(room, i), change.given[i], 0)


@compiled
def _settle(tapes: Tapes, registers: Real, scales: Real, who: Real, room: Real, lost: Real, found: Real) -> None:
    """Change modes in one instant, in which nobody knows how inputs move, until no guard is left, of those who were asked for."""
    for _ in range(_MOST_EVENTS):
        interpret(tapes.settled.tape, registers)
        _largest(tapes.settled.guards, registers, scales, found)
        left = False
        for lane in range(LANES):
            if not found[lane] > 0.0:
                who[0, lane] = 0.0
            left = left or who[0, lane] > 0.0
        if not left:
            return
        _change(tapes.settled, registers, scales, who, room, lost)
    for lane in range(LANES):
        if who[0, lane] > 0.0:
            lost[lane] = 1.0


@compiled
def _note(
    read: Whole, registers: Real, time: float, width: float, theta: Real, active: npt.NDArray[np.bool_], corners: Real
) -> None:
    """Note outputs that are larger, or smaller, than at any corner before."""
    for k in range(corners.shape[0]):
        for lane in range(LANES):
            value = registers[read[2 * k], 0, lane]
            for side in range(2):
                larger = value > corners[k, 0, lane] if side == 0 else value < corners[k, 2, lane]
                if active[lane] and larger:
                    corners[k, 2 * side, lane] = value
                    corners[k, 2 * side + 1, lane] = time + theta[0, lane] * width


@compiled
def _narrow(end: Real, found: Real, aim: Real, low: Real, high: Real, below: Real, above: Real, side: Real) -> None:
    """Narrow the brackets of instants by what was ``found`` (LANES,) at ``end`` (1, LANES): by the Illinois method.

    A bracket that is narrow enough stays, however long others are narrowed.
    """
    for lane in range(LANES):
        if high[lane] - low[lane] <= _RESOLVED:
            continue
        if 0.0 < found[lane] <= 4.0 * aim[lane]:
            low[lane] = high[lane] = end[0, lane]
        elif found[lane] > 0.0:
            high[lane], above[lane] = end[0, lane], found[lane]
            below[lane] *= 0.5 if side[lane] > 0 else 1.0
            side[lane] = 1.0
        else:
            low[lane], below[lane] = end[0, lane], found[lane]
            above[lane] *= 0.5 if side[lane] < 0 else 1.0
            side[lane] = -1.0


@allocating
def _cut(
    tapes: Tapes, registers: Real, base: Real, before: Real, guard: Real, scales: Real, counts: Whole, ends: Real,
    time: float, width: float, lost: Real, corners: Real,
) -> None:  # fmt: skip
    """Take a step that begins at ``time`` (s) again for those whose ``guard`` (LANES,) is positive at its end.

    ``base`` (states, LANES) and ``before`` (LANES,) are states and guards at its beginning; the registers hold the states at its end.
    """
    states = tapes.rates.shape[0]
    total, reached = np.empty((states, LANES)), np.empty((states, LANES))
    begin, end, theta, who = np.zeros((1, LANES)), np.ones((1, LANES)), np.empty((1, LANES)), np.empty((1, LANES))
    room = np.empty((max(1, tapes.switched.made.shape[0], tapes.settled.made.shape[0]), LANES))
    low, high = np.empty(LANES), np.empty(LANES)
    below, above, side, aim = np.empty(LANES), np.empty(LANES), np.empty(LANES), np.empty(LANES)
    found = guard.copy()
    active = guard > 0.0
    reached[:] = registers[:states, 0]
    for _ in range(_MOST_EVENTS):
        for lane in range(LANES):
            low[lane], high[lane] = begin[0, lane] if active[lane] else 1.0, 1.0
            below[lane], above[lane], side[lane] = min(before[lane], 0.0), found[lane], 0.0
            aim[lane] = _RESOLVED * (above[lane] - below[lane])
            if before[lane] > 0.0:
                high[lane] = low[lane]
        for trial in range(_TRIALS + 1):
            last = trial == _TRIALS or np.all(high - low <= _RESOLVED)
            for lane in range(LANES):
                rise = (aim[lane] - below[lane]) / (above[lane] - below[lane])
                secant = low[lane] + (high[lane] - low[lane]) * rise
                # a guard that stands at 0 before it rises says nothing about where it does
                inside = low[lane] < secant < high[lane] and -below[lane] > _FLAT * above[lane]
                end[0, lane] = secant if inside else 0.5 * (low[lane] + high[lane])
                if not active[lane]:
                    end[0, lane] = 1.0
                elif last or high[lane] - low[lane] <= _RESOLVED:
                    end[0, lane] = high[lane]
            _part(tapes, registers, base, total, counts, ends, begin, end, theta, width)
            interpret(tapes.whole, registers)
            _largest(tapes.guards, registers, scales, found)
            if last:
                break
            _narrow(end, found, aim, low, high, below, above, side)
        _note(tapes.read, registers, time, width, end, active, corners)
        for lane in range(LANES):
            who[0, lane] = 1.0 if active[lane] else 0.0
        interpret(tapes.switched.tape, registers)
        _change(tapes.switched, registers, scales, who, room, lost)
        _settle(tapes, registers, scales, who, room, lost, found)
        interpret(tapes.whole, registers)
        _largest(tapes.guards, registers, scales, found)
        _note(tapes.read, registers, time, width, end, active, corners)
        for lane in range(LANES):
            if active[lane]:
                base[:, lane] = registers[:states, 0, lane]
                before[lane], begin[0, lane] = found[lane], end[0, lane]
            end[0, lane] = 1.0
        _part(tapes, registers, base, total, counts, ends, begin, end, theta, width)
        interpret(tapes.whole, registers)
        _largest(tapes.guards, registers, scales, found)
        left = False
        for lane in range(LANES):
            if active[lane] and not found[lane] > 0.0:
                reached[:, lane] = registers[:states, 0, lane]
                active[lane] = False
            left = left or active[lane]
        if not left:
            break
    for lane in range(LANES):
        if active[lane]:
            lost[lane] = 1.0
    registers[:states, 0] = reached


@compiled
def _take(
    tapes: Tapes, registers: Real, base: Real, total: Real, inputs: Real, row: int, places: Whole, shares: Real, past: Real,
    group: int, width: float,
) -> None:  # fmt: skip
    """Take a whole step from the states, whose rates the registers hold; ``base`` keeps them."""
    states, sixth, third, half = tapes.rates.shape[0], spread(width / 6), spread(width / 3), spread(width / 2)
    for i in range(states):
        x, slope = load2(registers, i, 0), load2(registers, tapes.rates[i], 0)
        store(base, x, i)
        store(total, multiply_add(slope, sixth, x), i)
        store2(registers, multiply_add(slope, half, x), i, 0)
    for stage in range(1, 4):
        drive(registers, states, inputs, row + (stage + 1) // 2, places, shares, past, group)
        interpret(tapes.rates_only, registers)
        for i in range(states):
            slope = load2(registers, tapes.rates[i], 0)
            if stage == 3:
                store2(registers, multiply_add(slope, sixth, load(total, i)), i, 0)
            else:
                store(total, multiply_add(slope, third, load(total, i)), i)
                onward = half if stage == 1 else spread(width)
                store2(registers, multiply_add(slope, onward, load(base, i)), i, 0)


@compiled
def _grow(guards: Whole, registers: Real, scales: Real) -> None:
    """Let ``scales`` (guards, LANES) be as large as guards have been."""
    for k in range(guards.shape[0]):
        for lane in range(LANES):
            size = abs(registers[guards[k], 0, lane])
            if scales[k, lane] < size < np.inf:
                scales[k, lane] = size


@allocating
def march_modes(
    tapes: Tapes, every: Real, inputs: Real, places: Whole, shares: Real, past: Real, first: int, width: float, stride: int,
    time: float, breaks: bool, scales: Real, corners: Real, record: Real,
) -> None:  # fmt: skip
    """March over equal steps, as `engine.batch.kernels.marching.march` does with registers ``every`` and the same pieces.

    Parameters
    ----------
    time : float
        When they begin, s.
    breaks : bool
        Whether inputs may jump at the beginning: laws are then prepared for it with what the registers hold.
    scales : ndarray, shape (guards, groups, LANES)
        How large the guards have been; updated.
    corners : ndarray, shape (groups, watched, 4, LANES)
        The largest value of what is written down where a mode ended, when that was, the smallest value, and when; updated.
    record : ndarray, shape (groups, steps / stride + 1, read + 1, LANES)
        Behind what is read off is 1 where a mode has ended since the sample before.
    """
    states, groups, given, delayed = tapes.rates.shape[0], every.shape[1], inputs.shape[1], places.shape[1]
    steps, driven = inputs.shape[0] // 3, inputs.shape[1] + 2 * places.shape[1]
    counts = np.array([given // 2, delayed])
    registers = np.empty((every.shape[0], 1, LANES))
    base, total = np.empty((states, LANES)), np.empty((states, LANES))
    ends = np.empty((2, driven, LANES))
    most = max(tapes.switched.made.shape[0], tapes.settled.made.shape[0], tapes.released.made.shape[0])
    room = np.empty((max(1, most), LANES))
    who, guard, before = np.ones((1, LANES)), np.empty(LANES), np.empty(LANES)
    own = np.empty((scales.shape[0], LANES))
    for group in range(groups):
        registers[:, 0] = every[:, group]
        own[:] = scales[:, group]
        lost, cut = np.zeros(LANES), np.zeros(LANES)
        if breaks:
            who[:] = 1.0
            interpret(tapes.released.tape, registers)
            _change(tapes.released, registers, own, who, room, lost)
        for k in range(steps + 1):
            row = 3 * k
            drive(registers, states, inputs, row, places, shares, past, group)
            if k == 0:
                who[:] = 1.0
                _settle(tapes, registers, own, who, room, lost, guard)
            interpret(tapes.whole, registers)
            _largest(tapes.guards, registers, own, guard)
            _grow(tapes.guards, registers, own)
            if np.any(guard > 0.0) and k > 0:
                for end in range(2):
                    drive(registers, states, inputs, row - 3 + 2 * end, places, shares, past, group)
                    ends[end] = registers[states : states + driven, 0]
                for lane in range(LANES):
                    cut[lane] = max(cut[lane], 1.0 if guard[lane] > 0.0 else 0.0)
                _cut(
                    tapes, registers, base, before, guard, own, counts, ends, time + (k - 1) * width, width, lost,
                    corners[group],
                )  # fmt: skip
                drive(registers, states, inputs, row, places, shares, past, group)
                interpret(tapes.whole, registers)
                _largest(tapes.guards, registers, own, guard)
            before[:] = guard
            if k % stride == 0:
                for i in range(tapes.read.shape[0]):
                    record[group, k // stride, i] = registers[tapes.read[i], 0]
                for lane in range(LANES):
                    if lost[lane] > 0.0:
                        record[group, k // stride, tapes.read.shape[0] - 1, lane] = 1.0
                record[group, k // stride, tapes.read.shape[0]] = cut
                cut[:] = 0.0
            for i in range(2 * delayed):
                past[i, first + k, group] = registers[tapes.entering[i], 0]
            if k == steps:
                break
            _take(tapes, registers, base, total, inputs, row, places, shares, past, group, width)
        scales[:, group] = own
        every[:, group] = registers[:, 0]
