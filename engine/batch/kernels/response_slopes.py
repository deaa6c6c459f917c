"""Derivatives of what is read off a step response: one candidate, one direction to a lane.

d(P²) = dP P + P dP;     x(T) = P^N x(0):  dx ← dP x + P dx
y(t*) = level:  dt* = (dlevel - dy)/ẏ;     at a turning point dy* = dy and dt* = -dẏ/ÿ
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels import events as r
from engine.batch.kernels import powers as constants
from engine.batch.kernels import scan_state as s
from engine.batch.kernels.compiled import (
    apply,
    apply_add,
    compiled,
    multiply,
    multiply_add,
    multiply_pairs,
    multiply_pairs_add,
)
from engine.batch.kernels.vector import copy, load, load2, spread, store, store2

Real = npt.NDArray[np.float64]

TERMS: Final = 16
"""Terms of the last step's Taylor polynomial: 0.64^16 / 16! is 4e-17."""
_REACH: Final = 1e-3
"""An instant is corrected by at most this part of a step: readings are nearer than that."""


@compiled
def _product(c: Real, dc: Real, a: Real, da: Real, b: Real, db: Real, n: int) -> None:
    """C = A B with its derivative."""
    multiply(c, a, b, n, n, n, n, n, n)
    multiply(dc, da, b, n, n, n, n, n, n)
    multiply_add(dc, a, db, n, n, n, n, n, n)


@compiled
def power_slopes(
    a: Real, da: Real, db: Real, n: int, experiments: int, step: Real, powers: Real, levels: int, top: int, rest: Real,
    d_powers: Real, d_rest: Real, work: Real, moved: Real,
) -> None:  # fmt: skip
    """Fill the derivatives of the first ``top`` powers, and of the states at rest x∞ = -B/A: ∫ e^(A s) (dB + dA x∞) ds.

    Sizes as in `raise_powers`, whose results these continue; ``work`` is (12, n, n, LANES).
    """
    x, x2, t1, t2, p, q = work[0], work[1], work[2], work[3], work[4], work[5]
    dx, dx2, dt1, dt2, dp, dq = work[6], work[7], work[8], work[9], work[10], work[11]
    h, size = load(step, 0) * 0.5**constants.EXTRA, n * n
    for k in range(size):
        store(x, load(a, k) * h, k)
        store(dx, load(da, k) * h, k)
    _product(x2, dx2, x, dx, x, dx, n)
    for k in range(size):
        store(t1, constants.C1 * load(x, k) + constants.C2 * load(x2, k), k)
        store(dt1, constants.C1 * load(dx, k) + constants.C2 * load(dx2, k), k)
    _product(t2, dt2, x2, dx2, t1, dt1, n)
    for k in range(size):
        third, d_third = load(t2, k), load(dt2, k)
        store(t1, constants.C5 * load(x, k) + constants.C6 * load(x2, k) + constants.C7 * third, k)
        store(dt1, constants.C5 * load(dx, k) + constants.C6 * load(dx2, k) + constants.C7 * d_third, k)
        store(t2, third + constants.C3 * load(x2, k), k)
        store(dt2, d_third + constants.C3 * load(dx2, k), k)
    for i in range(n):
        store2(t1, load2(t1, i, i) + constants.C4, i, i)
    _product(p, dp, t2, dt2, t1, dt1, n)
    for k in range(size):
        store(p, load(p, k) + load(x, k) + constants.D2 * load(x2, k), k)
        store(dp, load(dp, k) + load(dx, k) + constants.D2 * load(dx2, k), k)
    for i in range(n):
        store2(p, load2(p, i, i) + 1.0, i, i)
    entries = n * experiments
    forcing = moved[0]
    apply(forcing, da, rest, n, experiments, n, n, experiments, experiments)
    for k in range(entries):
        forced = (load(forcing, k) + load(db, k)) * h
        store(forcing, forced, k)
        store(d_rest, forced, k)
    for term in range(9, 1, -1):
        apply(moved[1], x, d_rest, n, experiments, n, n, experiments, experiments)
        for k in range(entries):
            store(d_rest, load(forcing, k) + load(moved[1], k) * (1.0 / term), k)
    for _ in range(constants.EXTRA):
        _double(p, d_rest, n, experiments, moved[1])
        _product(q, dq, p, dp, p, dp, n)
        p, q, dp, dq = q, p, dq, dp
    copy(d_powers, 0, dp, 0, size)
    for level in range(levels):
        _double(powers[level], d_rest, n, experiments, moved[1])
        if level + 1 < top:
            multiply(d_powers[level + 1], d_powers[level], powers[level], n, n, n, n, n, n)
            multiply_add(d_powers[level + 1], powers[level], d_powers[level], n, n, n, n, n, n)


@compiled
def _double(power: Real, total: Real, n: int, experiments: int, moved: Real) -> None:
    """Extend an integral over the time of a power to twice that time."""
    apply(moved, power, total, n, experiments, n, n, experiments, experiments)
    for k in range(n * experiments):
        store(total, load(total, k) + load(moved, k), k)


@compiled
def expand_slopes(
    c: Real, dc: Real, x: Real, dx: Real, outputs: int, n: int, taylors: Real, d_taylors: Real
) -> None:  # fmt: skip
    """Write the rows C (A h)^k / k!, k = 0 ... (outputs, TERMS, n, LANES), and their derivatives.

    ``outputs`` is even and every second row of C an output; ``x`` is A h with its derivative.
    """
    stride = TERMS * n
    for o in range(outputs):
        copy(taylors[o], 0, c[2 * o], 0, n)
        copy(d_taylors[o], 0, dc[2 * o], 0, n)
    for k in range(1, TERMS):
        multiply_pairs(taylors[0, k], taylors[0, k - 1], x, outputs, n, n, stride, n, stride)
        multiply_pairs(d_taylors[0, k], d_taylors[0, k - 1], x, outputs, n, n, stride, n, stride)
        multiply_pairs_add(d_taylors[0, k], taylors[0, k - 1], dx, outputs, n, n, stride, n, stride)
        share = 1.0 / k
        for o in range(outputs):
            for i in range(k * n, (k + 1) * n):
                store(taylors[o], load(taylors[o], i) * share, i)
                store(d_taylors[o], load(d_taylors[o], i) * share, i)


@compiled
def _at(
    time: float, h: float, powers: Real, d_powers: Real, n: int, start: Real, d_start: Real, taylor: Real, d_taylor: Real,
    room: Real, series: Real, slopes: Real,
) -> float:  # fmt: skip
    """Write the Taylor series of an output and its derivatives, (TERMS, LANES), about an instant's last whole step.

    Return the part of a step that is left from there. ``room`` is (4, n, LANES): states, their derivatives, and what they
    become; ``taylor`` are the output's rows (TERMS, n, LANES).
    """
    units = math.floor(time / h)
    e, de, moved, d_moved = room[0], room[1], room[2], room[3]
    copy(e, 0, start, 0, n)
    copy(de, 0, d_start, 0, n)
    left, level = units, 0
    while left > 0.0:
        half = math.floor(0.5 * left)
        if left - 2.0 * half > 0.0:
            apply(moved, powers[level], e, n, 1, n, n, 1, 1)
            apply(d_moved, powers[level], de, n, 1, n, n, 1, 1)
            apply_add(d_moved, d_powers[level], e, n, 1, n, n, 1, 1)
            e, de, moved, d_moved = moved, d_moved, e, de
        left = half
        level += 1
    for term in range(TERMS):
        value, slope, moves = spread(0.0), spread(0.0), spread(0.0)
        for i in range(n):
            state, row = load(e, i), load2(taylor, term, i)
            value = value + row * state
            slope = slope + load2(d_taylor, term, i) * state
            moves = moves + row * load(de, i)
        store(series, value, term)
        store(slopes, slope + moves, term)
    return time / h - units


@compiled
def _value(series: Real, at: float, order: int) -> float:
    """Return a derivative of the series by its variable, of one lane."""
    total = 0.0
    for k in range(TERMS - 1, order - 1, -1):
        factor = 1.0
        for m in range(order):
            factor *= k - m
        total = total * at + factor * series[k, 0]
    return total


@compiled
def _values(series: Real, at: float, order: int) -> Any:
    """Return it of all lanes, the value or the first derivative."""
    total = spread(0.0)
    for k in range(TERMS - 1, order - 1, -1):
        total = total * at + load(series, k) * (1.0 if order == 0 else float(k))
    return total


@compiled
def _crossing(series: Real, slopes: Real, part: float, h: float, goal: float, d_goal: Any) -> Any:
    """Return how the instant moves at which the output reaches ``goal``, near ``part`` of a step."""
    at = part
    for _ in range(2):
        move = (_value(series, at, 0) - goal) / _value(series, at, 1)
        at -= min(max(move, -_REACH), _REACH)
    return (d_goal - _values(slopes, at, 0)) * (h / _value(series, at, 1))


@compiled
def response_slopes(
    wants: int, reading: Real, found: Real, h: float, final: float, d_final: Any, powers: Real, d_powers: Real, n: int,
    start: Real, d_start: Real, taylor: Real, d_taylor: Real, room: Real, series: Real, slopes: Real,
) -> None:  # fmt: skip
    """Write the derivatives (READINGS, LANES) of what is read off one response."""
    store(found, d_final, r.FINAL)
    sign = 1.0 if final >= 0.0 else -1.0
    for bit, to in ((s.RISE, r.T_10), (s.RISE, r.T_90), (s.SETTLE_2, r.T_2), (s.SETTLE_5, r.T_5)):
        if not wants & bit:
            continue
        store(found, 0.0, to)
        time = reading[to]
        if not (0.0 < time < math.inf):
            continue  # at once, whatever the parameters are
        part = _at(time, h, powers, d_powers, n, start, d_start, taylor, d_taylor, room, series, slopes)
        if to in (r.T_10, r.T_90):
            level = -0.9 if to == r.T_10 else -0.1
        else:
            side = 1.0 if _value(series, part, 0) >= 0.0 else -1.0
            level = side * sign * (0.02 if to == r.T_2 else 0.05)
        store(found, _crossing(series, slopes, part, h, level * final, level * d_final), to)
    for bit, to in ((s.HIGHEST, r.TOP_VALUE), (s.LOWEST, r.BOTTOM_VALUE)):
        if not wants & bit:
            continue
        store(found, 0.0, to)
        store(found, 0.0, to + 1)
        time = reading[to + 1]
        if not (abs(reading[to]) < 1e299 and 0.0 <= time < math.inf):
            continue
        part = _at(time, h, powers, d_powers, n, start, d_start, taylor, d_taylor, room, series, slopes)
        if time > 0.0:
            for _ in range(2):
                move = _value(series, part, 1) / _value(series, part, 2)
                part -= min(max(move, -_REACH), _REACH)
            store(found, -(_values(slopes, part, 1) * (h / _value(series, part, 2))), to + 1)
        store(found, _values(slopes, part, 0) + d_final, to)
