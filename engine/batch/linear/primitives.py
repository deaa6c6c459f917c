"""Primitives of metrics on a response that is given as pieces: extremum, first crossing, last exit, integrals.

Values and instants carry infinitesimals: an extremum's value is that at its real instant, a crossing takes one Newton step more.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.linear.compiled import compiled
from engine.batch.linear.pieces import Pieces
from engine.batch.linear.series import (
    SIZE,
    antiderivative,
    differentiate,
    integral_of,
    integral_of_square,
    left_end,
    right_end,
    roots,
    spread_of,
    timed,
    value_at,
)

Real = npt.NDArray[np.float64]
Series = npt.NDArray[Any]

_EQUAL: Final = 1e-15
ROUNDING: Final = 1e-15
_GRAZES: Final = 1e-9


class Room(NamedTuple):
    """Work space: of `roots`, its results, and series."""

    work: Real
    found: Real
    series: Series
    slope: Series
    wide: Series


@compiled
def series_of(pieces: Pieces, r: int, p: int, level: Any, out: Series) -> None:
    """Write the series of a piece above a level."""
    for k in range(SIZE):
        out[k] = pieces.series[r, p, k]
    out[0] = out[0] + (pieces.base[r, p] - level)


@compiled
def instant_of(pieces: Pieces, p: int, u: Any) -> Any:
    """Return the time (s) at a place of a piece."""
    return pieces.times[p] + (pieces.times[p + 1] - pieces.times[p]) * 0.5 * (u + 1.0)


@compiled
def end_of(pieces: Pieces, series: Series, p: int, side: int) -> Any:
    """Return a series of piece ``p`` at an end of the piece, which may move with a parameter."""
    value, shift = right_end(series) if side else left_end(series), pieces.shifts[p + side]
    if shift != 0.0:
        slope = 0.0 * value
        for k in range(1, SIZE):
            slope = slope + k * k * (series[k] if side == 1 or k % 2 == 1 else -series[k])
        value = value + slope * shift * (2.0 / (pieces.times[p + 1] - pieces.times[p]))
    return value


@compiled
def extreme(pieces: Pieces, room: Room, r: int, first: int, stop: int, sign: float) -> Any:
    """Return (largest of sign y, piece, u) over pieces; the earliest among equals. u is 2 where roots cannot be told."""
    best, piece, place = -math.inf, first, -1.0
    value = 0.0 * pieces.series[0, 0, 0]
    least = _EQUAL * pieces.scale[r]
    for p in range(first, stop):
        series, base = pieces.series[r, p], pieces.base[r, p]
        if sign * (base.real + series[0].real) + spread_of(series) <= best:
            continue
        for side in range(2):
            end = sign * (base + end_of(pieces, series, p, side))
            if end.real > best + least:
                best, value, piece, place = end.real, end, p, (1.0 if side else -1.0)
    for p in range(first, stop):
        series, base = pieces.series[r, p], pieces.base[r, p]
        spread = spread_of(series)
        if sign * (base.real + series[0].real) + spread <= best or spread <= least:
            continue
        differentiate(series, room.slope)
        count = roots(room.slope, ROUNDING * spread_of(room.slope), room.work, room.found)
        if count < 0:
            return value, piece, 2.0
        for k in range(count):
            u = room.found[k]
            here = sign * (base + value_at(series, SIZE, u))
            if here.real > best + least or (here.real > best - least and p < piece):
                best, value, piece, place = max(best, here.real), here, p, u
    return value, piece, place


@compiled
def rivals(pieces: Pieces, room: Room, r: int, first: int, stop: int, sign: float, level: float, at: float) -> bool:
    """Whether a turning point apart from the instant ``at`` reaches a level as well."""
    beside = 1e-7 * pieces.times[stop]
    for p in range(first, stop):
        series, base = pieces.series[r, p], pieces.base[r, p]
        if sign * (base.real + series[0].real) + spread_of(series) < level:
            continue
        for side in range(2):
            end = sign * (base + (right_end(series) if side else left_end(series))).real
            if end >= level and abs(pieces.times[p + side] - at) > beside:
                return True
        differentiate(series, room.slope)
        count = roots(room.slope, ROUNDING * spread_of(room.slope), room.work, room.found)
        if count < 0:
            return True
        for k in range(count):
            u = room.found[k]
            if sign * (base + value_at(series, SIZE, u)).real >= level and abs(instant_of(pieces, p, u) - at) > beside:
                return True
    return False


@compiled
def _crossing(pieces: Pieces, room: Room, p: int, u: float) -> Any:
    """Return the instant of a root of the series in room, with its infinitesimals."""
    differentiate(room.series, room.slope)
    slope = value_at(room.slope, SIZE, u)
    moved = 0.0 * room.series[0] + u
    if slope.real != 0.0:
        moved = u - value_at(room.series, SIZE, u) / slope
    return instant_of(pieces, p, moved)


@compiled
def first_crossing(pieces: Pieces, room: Room, r: int, stop: int, level: Any, sign: float) -> Any:
    """Return (instant, 1 found, 0 not found or -1 not told) at which sign y first reaches sign level."""
    none = 0.0 * pieces.series[0, 0, 0]
    below = True
    for p in range(stop):
        series_of(pieces, r, p, level, room.series)
        start = sign * left_end(room.series).real
        if p == 0:
            if start >= 0.0:
                return none + pieces.times[0], 1
        elif below and start >= 0.0:  # a jump, or rounding at the edge
            return none + pieces.times[p], 1
        if abs(room.series[0].real) > spread_of(room.series):
            below = start < 0.0
            continue
        count = roots(room.series, ROUNDING * pieces.scale[r], room.work, room.found)
        if count < 0:
            return none, -1
        if count > 0:
            return _crossing(pieces, room, p, room.found[0]), 1
        below = sign * right_end(room.series).real < 0.0
    return none, 0


@compiled
def last_exit(pieces: Pieces, room: Room, r: int, first: int, stop: int, level: Any, half: Any) -> Any:
    """Return (instant, 1 found, 0 always within or -1 not told) at which y is last outside level ± half."""
    none = 0.0 * pieces.series[0, 0, 0]
    following = 0.0
    for p in range(stop - 1, first - 1, -1):
        series_of(pieces, r, p, level, room.series)
        spread, middle = spread_of(room.series), abs(room.series[0].real)
        end = right_end(room.series).real
        if p < stop - 1 and abs(end) > half.real >= abs(following):
            return none + pieces.times[p + 1], 1
        if p == stop - 1 and abs(end) > half.real:
            return none, -1
        following = left_end(room.series).real
        if middle + spread < half.real * (1.0 - _GRAZES):
            continue
        best, place, which = -2.0, 0.0, 0.0
        for side in range(2):
            edge = 1.0 if side else -1.0
            series_of(pieces, r, p, level + edge * half, room.series)
            count = roots(room.series, ROUNDING * pieces.scale[r], room.work, room.found)
            if count < 0:
                return none, -1
            if count > 0 and room.found[count - 1] > best:
                best, place, which = room.found[count - 1], room.found[count - 1], edge
        if best > -2.0:
            series_of(pieces, r, p, level + which * half, room.series)
            return _crossing(pieces, room, p, place), 1
        for side in range(2):
            edge = 1.0 if side else -1.0
            top, _, where = extreme(pieces, room, r, p, p + 1, edge)
            if where == 2.0 or (top - edge * level).real > half.real * (1.0 - _GRAZES):
                return none, -1
    return none, 0


@compiled
def integral(pieces: Pieces, room: Room, r: int, first: int, stop: int, power: int) -> Any:
    """Return ∫ y or, for a power of 2, ∫ y²."""
    total = 0.0 * pieces.series[0, 0, 0]
    for p in range(first, stop):
        series_of(pieces, r, p, 0.0, room.series)
        part = integral_of(room.series) if power == 1 else integral_of_square(room.series)
        total = total + part * (0.5 * (pieces.times[p + 1] - pieces.times[p]))
    return total


@compiled
def absolute(pieces: Pieces, room: Room, r: int, first: int, stop: int, weighted: bool, start: float) -> Any:
    """Return ∫ |y| or ∫ (t - start) |y|, cut where y changes its sign; NaN where its roots cannot be told."""
    total = 0.0 * pieces.series[0, 0, 0]
    for p in range(first, stop):
        half = 0.5 * (pieces.times[p + 1] - pieces.times[p])
        series_of(pieces, r, p, 0.0, room.series)
        count = 0
        if abs(room.series[0].real) <= spread_of(room.series):
            count = roots(room.series, ROUNDING * pieces.scale[r], room.work, room.found)
        if count < 0:
            return math.nan * total
        if count == 0 and not weighted:
            whole = integral_of(room.series) * half
            total = total + (whole if whole.real >= 0.0 else -whole)
            continue
        size = SIZE
        if weighted:
            timed(room.series, pieces.times[p] - start, half, room.wide[0])
            size = SIZE + 1
        else:
            for k in range(SIZE):
                room.wide[0, k] = room.series[k]
        antiderivative(room.wide[0], size, room.wide[1])
        before = 0.0 * total
        for k in range(count + 1):
            u = room.found[k] if k < count else 1.0
            until = value_at(room.wide[1], size + 1, u)
            part = (until - before) * half
            total = total + (part if part.real >= 0.0 else -part)
            before = until
    return total
