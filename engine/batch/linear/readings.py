"""Metrics of a response that is given as pieces: definitions are those of `engine.metrics`, NaN where there is no value.

All are made of a few primitives, which :mod:`engine.batch.linear.primitives` has.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.linear.compiled import compiled
from engine.batch.linear.pieces import Pieces
from engine.batch.linear.primitives import (
    ROUNDING,
    Room,
    absolute,
    end_of,
    extreme,
    first_crossing,
    instant_of,
    integral,
    last_exit,
    rivals,
    series_of,
)
from engine.batch.linear.series import (
    SIZE,
    differentiate,
    integral_of_square,
    right_end,
    roots,
    spread_of,
    value_at,
)

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]

(
    OVERSHOOT, UNDERSHOOT, RISE, ENTRY, PEAK, PEAK_TIME, RMS, IAE, ISE, ITAE, IE, RESIDUAL, ERROR, RECOVERY, TRACKING, ENVELOPE,
) = range(16)  # fmt: skip

_NEGLIGIBLE: Final = 1e-9
_BARELY: Final = 1e-8
_APPROACHED: Final = 1e-13
_TIED: Final = 1e-9
_UNDECIDED: Final = 10.0
"""A number within this factor of what decides whether a metric exists is left to the exact path."""
_GROWS: Final = 1.1
_LOOKS: Final = 8


class Wanted(NamedTuple):
    """Metrics of one response, one to a row: ``codes``, ``row`` watched, ``first`` and ``stop`` mark (-1: the end), ``numbers`` (K, 2).

    ``lines`` (segments, 7): metric, first mark, stop mark, time, value, slope, sign.
    """

    codes: Whole
    row: Whole
    first: Whole
    stop: Whole
    numbers: Real
    lines: Real
    start: float
    loading: int


class Rest(NamedTuple):
    """Where what is watched goes.

    ``y`` (R,) where the response settles, which ``settles`` says by 1; ``error`` (R,) where that of an endless command does, NaN where it does
    not, infinite where that cannot be told; ``open`` (R,): 1 where what is watched is infinite at a jump, -1 where that cannot be told.
    """

    y: Series
    settles: int
    error: Series
    open: Whole


@compiled
def _near(value: float, bound: float) -> bool:
    return bound / _UNDECIDED < value < bound * _UNDECIDED


@compiled
def read(
    wanted: Wanted, rest: Rest, pieces: Pieces, room: Room, count: int, values: Series, doubtful: npt.NDArray[np.bool_]
) -> None:  # fmt: skip
    """Enter the metrics (K,) of one response of ``count`` pieces; ``open`` rows are infinite, as where a jump is differentiated."""
    absent = math.nan * pieces.series[0, 0, 0]
    for k in range(wanted.codes.shape[0]):
        code, r = wanted.codes[k], wanted.row[k]
        first = pieces.marks[wanted.first[k]]
        stop = count if wanted.stop[k] < 0 else pieces.marks[wanted.stop[k]]
        if code == RESIDUAL and not rest.settles:
            values[k], doubtful[k] = absent, False
            continue
        if rest.open[r] != 0 or stop <= first:
            values[k], doubtful[k] = absent, rest.open[r] < 0 or (stop <= first and rest.open[r] == 0)
            continue
        if code <= ENTRY or code == RECOVERY:
            value, doubt = _relative(wanted, rest, pieces, room, k, count)
        elif code in (PEAK, PEAK_TIME):
            value, doubt = _largest(wanted, rest, pieces, room, k, first, stop, wanted.stop[k] >= 0)
        elif code == RMS:
            value, doubt = absent, False
            if wanted.numbers[k, 0] > 0.0:
                value = np.sqrt(integral(pieces, room, r, first, stop, 2) / wanted.numbers[k, 0])
        elif code <= IE:
            value, doubt = _of_error(wanted, rest, pieces, room, k, first, stop, wanted.stop[k] >= 0)
        elif code == RESIDUAL:
            value, doubt = _residual(rest, pieces, room, r, first, count)
        elif code == ERROR:
            value, doubt = (rest.y[r], False) if rest.settles else (rest.error[r], math.isinf(rest.error[r].real))
        else:
            value, doubt = _beside_lines(wanted, pieces, room, k)
        values[k], doubtful[k] = value, doubt


@compiled
def _relative(wanted: Wanted, rest: Rest, pieces: Pieces, room: Room, k: int, count: int) -> Any:
    """Return a metric that is relative to where the response settles, and doubt."""
    code, r = wanted.codes[k], wanted.row[k]
    absent = math.nan * pieces.series[0, 0, 0]
    if not rest.settles:
        return absent, False
    final = rest.y[r]
    if code == RECOVERY:
        return _recovery(wanted, rest, pieces, room, k, count)
    size, way = pieces.scale[r], abs(final.real)
    if way <= _NEGLIGIBLE * size:
        return absent, _near(way, _NEGLIGIBLE * size)
    doubt = _near(way, _NEGLIGIBLE * size)
    sign = 1.0 if final.real > 0.0 else -1.0
    if code == ENTRY:
        instant, told = last_exit(pieces, room, r, 0, count, final, wanted.numbers[k, 0] * sign * final)
        return instant - wanted.start, doubt or told != 1
    if code == RISE:
        early, one = first_crossing(pieces, room, r, count, 0.1 * final, sign)
        late, two = first_crossing(pieces, room, r, count, 0.9 * final, sign)
        return late - early, doubt or one != 1 or two != 1
    value, _, place = extreme(pieces, room, r, 0, count, sign if code == OVERSHOOT else -sign)
    ratio = value / (sign * final) - 1.0 if code == OVERSHOOT else value / (sign * final)
    if code == OVERSHOOT and ratio.real > _NEGLIGIBLE:
        ratio = (value - sign * final) / (sign * final)
    if ratio.real <= _NEGLIGIBLE:
        return 0.0 * final, doubt or place == 2.0 or ratio.real > 0.5 * _NEGLIGIBLE
    return ratio, doubt or place == 2.0 or ratio.real < 2.0 * _NEGLIGIBLE


@compiled
def _recovery(wanted: Wanted, rest: Rest, pieces: Pieces, room: Room, k: int, count: int) -> Any:
    r, band = wanted.row[k], wanted.numbers[k, 0]
    first = pieces.marks[wanted.loading]
    before = 0.0 * rest.y[r]
    if first > 0:
        before = pieces.base[r, first - 1] + right_end(pieces.series[r, first - 1])
    left = abs((rest.y[r] - before).real)
    close = abs(left - band) <= 1e-9 * band
    if left > band:
        return math.nan * before, close
    instant, told = last_exit(pieces, room, r, first, count, before, 0.0 * before + band)
    if told == 0:
        return 0.0 * before, close
    return instant - pieces.times[first], close or told < 0


@compiled
def _largest(
    wanted: Wanted, rest: Rest, pieces: Pieces, room: Room, k: int, first: int, stop: int, windowed: bool
) -> Any:  # fmt: skip
    """Return the largest |y|, or when it is, and doubt."""
    r = wanted.row[k]
    absent = math.nan * pieces.series[0, 0, 0]
    doubt = False
    if not rest.settles and not windowed:
        growth = _growth(pieces, r, stop)
        if growth > _GROWS:
            return absent, growth < 1.05 * _GROWS
        doubt = growth > 0.95 * _GROWS
    top, top_piece, top_place = extreme(pieces, room, r, first, stop, 1.0)
    bottom, bottom_piece, bottom_place = extreme(pieces, room, r, first, stop, -1.0)
    upwards = top.real >= bottom.real
    value, piece, place = top, top_piece, top_place
    if not upwards:
        value, piece, place = bottom, bottom_piece, bottom_place
    doubt = doubt or top_place == 2.0 or bottom_place == 2.0
    settled = rest.settles and not windowed
    limit = rest.y[r] if rest.y[r].real >= 0.0 else -rest.y[r]
    approached = settled and limit.real >= value.real * (1.0 - _APPROACHED)
    if wanted.codes[k] == PEAK:
        return (limit if approached else value), doubt
    if settled:
        excess = value.real - limit.real
        if approached or excess <= _BARELY * value.real:
            return absent, excess > 0.5 * _BARELY * value.real
        doubt = doubt or excess < 2.0 * _BARELY * value.real
    sign = 1.0 if upwards else -1.0
    at = instant_of(pieces, piece, place)
    level = value.real * (1.0 - _TIED)
    doubt = doubt or rivals(pieces, room, r, first, stop, 1.0, level, at)
    doubt = doubt or rivals(pieces, room, r, first, stop, -1.0, level, at)
    moved = 0.0 * value + place
    series_of(pieces, r, piece, 0.0, room.series)
    differentiate(room.series, room.slope)
    slope = value_at(room.slope, SIZE, place)
    differentiate(room.slope, room.series)
    bend = value_at(room.series, SIZE, place).real
    corner = False
    if abs(place) == 1.0:
        edge = pieces.times[piece] if place < 0.0 else pieces.times[piece + 1]
        for mark in pieces.marks:
            corner = corner or pieces.times[mark] == edge
        doubt = doubt or (not corner and abs(slope.real) > 1e-9 * spread_of(room.slope))
    if not corner and bend != 0.0:
        moved = place - slope / bend
        # the real step is rounding only
        moved = moved - (moved.real - place)
    return instant_of(pieces, piece, moved) - wanted.start + 0.0 * sign, doubt


@compiled
def _growth(pieces: Pieces, r: int, stop: int) -> float:
    """Return the largest value of the last fifth over that of what goes before."""
    early, late, until = 0.0, 0.0, 0.8 * pieces.times[stop]
    for p in range(stop):
        size = 0.0
        for node in range(_LOOKS + 1):
            here = value_at(pieces.series[r, p], SIZE, 2.0 * node / _LOOKS - 1.0)
            size = max(size, abs((pieces.base[r, p] + here).real))
        if pieces.times[p + 1] < until:
            early = max(early, size)
        else:
            late = max(late, size)
    return late / early if early > 0.0 else (math.inf if late > 0.0 else 1.0)


@compiled
def _of_error(
    wanted: Wanted, rest: Rest, pieces: Pieces, room: Room, k: int, first: int, stop: int, windowed: bool
) -> Any:  # fmt: skip
    """Return an integral of the error, and doubt."""
    code, r = wanted.codes[k], wanted.row[k]
    doubt = False
    if not windowed:
        remains = rest.y[r].real if rest.settles else rest.error[r].real
        if math.isnan(remains) or abs(remains) > _NEGLIGIBLE * pieces.scale[r]:
            near = abs(remains) < _UNDECIDED * _NEGLIGIBLE * pieces.scale[r]
            return math.nan * pieces.series[0, 0, 0], near or math.isinf(remains)
        doubt = abs(remains) > 0.01 * _NEGLIGIBLE * pieces.scale[r]
    if code == ISE:
        return integral(pieces, room, r, first, stop, 2), doubt
    if code == IE:
        total = integral(pieces, room, r, first, stop, 1)
        return (total if total.real >= 0.0 else -total), doubt
    value = absolute(pieces, room, r, first, stop, code == ITAE, wanted.start)
    return value, doubt or math.isnan(value.real)


@compiled
def _residual(rest: Rest, pieces: Pieces, room: Room, r: int, first: int, count: int) -> Any:
    high, _, one = extreme(pieces, room, r, first, count, 1.0)
    low, _, two = extreme(pieces, room, r, first, count, -1.0)
    if rest.y[r].real > high.real:
        high = rest.y[r]
    if -rest.y[r].real > low.real:
        low = -rest.y[r]
    return (high + low) / 2.0, one == 2.0 or two == 2.0


@compiled
def _beside_lines(wanted: Wanted, pieces: Pieces, room: Room, k: int) -> Any:
    """Return how a response compares with straight lines: the root of its mean square, or its worst excess; and doubt."""
    r, code = wanted.row[k], wanted.codes[k]
    total, length = 0.0 * pieces.series[0, 0, 0], 0.0
    worst, doubt = total - math.inf, False
    for s in range(wanted.lines.shape[0]):
        line = wanted.lines[s]
        if line[0] != k:
            continue
        first, stop = pieces.marks[int(line[1])], pieces.marks[int(line[2])]
        for p in range(first, stop):
            half = 0.5 * (pieces.times[p + 1] - pieces.times[p])
            middle = line[4] + line[5] * (pieces.times[p] + half - line[3])
            series_of(pieces, r, p, middle, room.series)
            room.series[1] = room.series[1] - line[5] * half
            length += 2.0 * half
            if code == TRACKING:
                total = total + integral_of_square(room.series) * half
                continue
            for end in range(2):
                here = line[6] * end_of(pieces, room.series, p, end)
                if here.real > worst.real:
                    worst = here
            if line[6] * room.series[0].real + spread_of(room.series) <= worst.real:
                continue
            differentiate(room.series, room.slope)
            count = roots(room.slope, ROUNDING * spread_of(room.slope), room.work, room.found)
            doubt = doubt or count < 0
            for i in range(max(count, 0)):
                here = line[6] * value_at(room.series, SIZE, room.found[i])
                if here.real > worst.real:
                    worst = here
    if code == TRACKING:
        return (np.sqrt(total / length) if total.real > 0.0 else 0.0 * total), False
    return 1.0 + worst / wanted.numbers[k, 0], doubt
