"""Exact derivatives of a candidate's metrics in eight directions at once: one direction to a lane.

    P' = e^(A h):  dP from the Taylor polynomial,  d(P²) = dP P + P dP;     x(T) = P^N x(0):  dx ← dP x + P dx
    y(t*) = level:  dt* = (dlevel - dy)/ẏ;     at a turning point dy* = dy and dt* = -dẏ/ÿ
    |L(jω*)| = 1 and its like:  dω* = -∂f/f_ω

The readings say where the events of a candidate are; there everything is evaluated once more, with its derivatives by the
parameters at a fixed instant or frequency, and the event's own motion is added by the rule of implicit functions.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.kernels import events as r
from engine.kernels import powers as constants
from engine.kernels import sampling as s
from engine.kernels import spectrum as f
from engine.kernels.compiled import LANES, apply, apply_add, compiled, multiply, multiply_add
from engine.kernels.evaluate import scatter
from engine.kernels.powers import LEVELS, raise_powers
from engine.kernels.readings import enter_slopes
from engine.kernels.spectrum import SpectrumProgram, run_point
from engine.kernels.tape import Tape
from engine.kernels.time_program import TimeProgram
from engine.kernels.transfer import FrequencyProgram
from engine.kernels.vector import clear, copy, load, load2, room, spread, store, store2, zeros

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]
Flags = npt.NDArray[np.bool_]

_TERMS: Final = 16
"""Terms of the last step's Taylor polynomial: 0.64^15 / 15! is 1e-15."""
_REACH: Final = 1e-3
"""An instant is corrected by at most this part of a step, a frequency by this part of it: readings are nearer than that."""
_BESIDE: Final = 1e-5
"""How far to the side the curvature at a peak is looked at, as a part of its frequency."""


@compiled
def run_tangents(tape: Tape, values: Real, tangents: Real) -> None:
    """Fill the registers (count, LANES) behind the parameters, all lanes alike, and their derivatives (count, LANES)."""
    base = tape.parameters
    for k in range(tape.constants.shape[0]):
        store(values, tape.constants[k], base + k)
        store(tangents, 0.0, base + k)
    base += tape.constants.shape[0]
    for k in range(tape.operations.shape[0]):
        op, a, b, to = tape.operations[k, 0], tape.operations[k, 1], tape.operations[k, 2], base + k
        x, y = values[a, 0], values[b, 0]
        dx, dy = load(tangents, a), load(tangents, b)
        value, moved = 0.0, spread(0.0)
        if op == 0:
            value, moved = x + y, dx + dy
        elif op == 1:
            value, moved = x - y, dx - dy
        elif op == 2:
            value, moved = x * y, dx * y + dy * x
        elif op == 3:
            value = x / y
            moved = (dx - dy * value) / y
        elif op == 4:
            value, moved = -x, -dx
        elif op == 5:
            value = math.sqrt(x)
            moved = dx / (2.0 * value)
        elif op == 6:
            value = math.exp(x)
            moved = dx * value
        elif op == 7:
            value, moved = math.log(x), dx / x
        elif op == 8:
            value, moved = math.sin(x), dx * math.cos(x)
        elif op == 9:
            value, moved = math.cos(x), -(dx * math.sin(x))
        else:
            value = 1.0 if x == 0.0 else 0.0
        store(values, value, to)
        store(tangents, moved, to)


@compiled
def _product(c: Real, dc: Real, a: Real, da: Real, b: Real, db: Real, n: int) -> None:
    """C = A B with its derivative."""
    multiply(c, a, b, n, n, n, n, n, n)
    multiply(dc, da, b, n, n, n, n, n, n)
    multiply_add(dc, a, db, n, n, n, n, n, n)


@compiled
def _power_slopes(
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
def _at(
    time: float, h: float, powers: Real, d_powers: Real, x: Real, dx: Real, n: int, start: Real, d_start: Real, row: Real,
    d_row: Real, room: Real, series: Real, slopes: Real,
) -> float:  # fmt: skip
    """Write the Taylor series of an output and its derivatives, (TERMS, LANES), about an instant's last whole step.

    Return the part of a step that is left from there. ``room`` is (6, n, LANES): states, their derivatives, and what they
    become; ``x`` is A h with its derivative.
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
    for term in range(_TERMS):
        value, slope = spread(0.0), spread(0.0)
        for i in range(n):
            value = value + load(row, i) * load(e, i)
            slope = slope + load(row, i) * load(de, i) + load(d_row, i) * load(e, i)
        store(series, value, term)
        store(slopes, slope, term)
        apply(moved, x, e, n, 1, n, n, 1, 1)
        apply(d_moved, x, de, n, 1, n, n, 1, 1)
        apply_add(d_moved, dx, e, n, 1, n, n, 1, 1)
        share = 1.0 / (term + 1.0)
        for i in range(n):
            store(moved, load(moved, i) * share, i)
            store(d_moved, load(d_moved, i) * share, i)
        e, de, moved, d_moved = moved, d_moved, e, de
    return time / h - units


@compiled
def _value(series: Real, at: float, order: int) -> float:
    """Return a derivative of the series by its variable, of one lane."""
    total = 0.0
    for k in range(_TERMS - 1, order - 1, -1):
        factor = 1.0
        for m in range(order):
            factor *= k - m
        total = total * at + factor * series[k, 0]
    return total


@compiled
def _values(series: Real, at: float, order: int) -> Any:
    """Return it of all lanes, the value or the first derivative."""
    total = spread(0.0)
    for k in range(_TERMS - 1, order - 1, -1):
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
def _response_slopes(
    wants: int, reading: Real, found: Real, h: float, final: float, d_final: Any, powers: Real, d_powers: Real, x: Real,
    dx: Real, n: int, start: Real, d_start: Real, row: Real, d_row: Real, room: Real, series: Real, slopes: Real,
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
        part = _at(time, h, powers, d_powers, x, dx, n, start, d_start, row, d_row, room, series, slopes)
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
        part = _at(time, h, powers, d_powers, x, dx, n, start, d_start, row, d_row, room, series, slopes)
        if time > 0.0:
            for _ in range(2):
                move = _value(series, part, 1) / _value(series, part, 2)
                part -= min(max(move, -_REACH), _REACH)
            store(found, -(_values(slopes, part, 1) * (h / _value(series, part, 2))), to + 1)
        store(found, _values(slopes, part, 0) + d_final, to)


@compiled
def _run_slopes(
    program: FrequencyProgram, registers: Real, tangents: Real, omega: float, re: Real, im: Real, dre: Real, dim: Real
) -> None:  # fmt: skip
    """Evaluate all functions at one frequency, all lanes alike, and their derivatives; arrays (places, LANES)."""
    square = -(omega * omega)
    for k in range(program.operations.shape[0]):
        code, to = program.operations[k, 0], program.operations[k, 1]
        a, b = program.operations[k, 2], program.operations[k, 3]
        if code == 0:
            even, odd, d_even, d_odd = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            last = b - 1
            for j in range(last - (last & 1), -1, -2):
                even = even * square + load(registers, program.coefficients[a + j])
                d_even = d_even * square + load(tangents, program.coefficients[a + j])
            for j in range(last - 1 + (last & 1), 0, -2):
                odd = odd * square + load(registers, program.coefficients[a + j])
                d_odd = d_odd * square + load(tangents, program.coefficients[a + j])
            _put(to, even, odd * omega, d_even, d_odd * omega, re, im, dre, dim)
            continue
        x, y, p, q = load(re, a), load(im, a), load(dre, a), load(dim, a)
        if code == 5:
            factor, moved = load(registers, b), load(tangents, b)
            _put(to, x * factor, y * factor, p * factor + x * moved, q * factor + y * moved, re, im, dre, dim)
            continue
        if code == 6:
            _put(to, x + load(registers, b), y, p + load(tangents, b), q, re, im, dre, dim)
            continue
        u, v, m, n = load(re, b), load(im, b), load(dre, b), load(dim, b)
        if code == 1:
            _put(to, x + u, y + v, p + m, q + n, re, im, dre, dim)
        elif code == 2:
            _put(to, x - u, y - v, p - m, q - n, re, im, dre, dim)
        elif code == 3:
            _put(
                to, x * u - y * v, x * v + y * u, p * u - q * v + x * m - y * n, p * v + q * u + x * n + y * m, re, im,
                dre, dim,
            )  # fmt: skip
        elif code == 4:
            inverse = 1.0 / (u * u + v * v)
            c, d = (x * u + y * v) * inverse, (y * u - x * v) * inverse
            g, o = p - (c * m - d * n), q - (c * n + d * m)
            _put(to, c, d, (g * u + o * v) * inverse, (o * u - g * v) * inverse, re, im, dre, dim)
        else:
            _put(to, -x, -y, -p, -q, re, im, dre, dim)


@compiled
def _put(to: int, x: Any, y: Any, p: Any, q: Any, re: Real, im: Real, dre: Real, dim: Real) -> None:
    store(re, x, to)
    store(im, y, to)
    store(dre, p, to)
    store(dim, q, to)


@compiled
def _miss(kind: int, level: float, x: float, y: float) -> float:
    """Return what is 0 at a crossing: |L|² - 1, Im L, or |T|² - level."""
    return y if kind == f.GAIN_MARGIN else x * x + y * y - (1.0 if kind != f.FIRST_FALL else level)


@compiled
def _climb(
    program: FrequencyProgram, registers: Real, omega: Real, to: int, place: int, here: float, re: Real, im: Real,
    dre: Real, dim: Real,
) -> Any:  # fmt: skip
    """Return what is 0 at a peak: the slope of |1 + L|², of |1 + L|²/|L|² times |L|⁴, or of |T|²."""
    store(omega, here, 0)
    run_point(program, registers, omega, re, im, dre, dim)
    x, y, dx, dy = re[place, 0], im[place, 0], dre[place, 0], dim[place, 0]
    square, slope = x * x + y * y, 2.0 * (x * dx + y * dy)
    if to == f.HIGHEST:
        return slope
    nearness, distance = slope + 2.0 * dx, square + 2.0 * x + 1.0
    return nearness if to == f.MS else nearness * square - distance * slope


@compiled
def _curve_slopes(
    program: SpectrumProgram, curve: int, registers: Real, tangents: Real, reading: Real, found: Real, point: Real,
    omega: Real,
) -> None:  # fmt: skip
    """Write the derivatives (READINGS, LANES) of what is read off one curve; ``point`` is (4, places, LANES)."""
    wants, place = program.wants[curve], program.points.targets[curve]
    re, im, dre, dim = point[0], point[1], point[2], point[3]
    first, last = program.frequencies[0], program.frequencies[program.frequencies.shape[0] - 1]
    level, d_level = 0.0, spread(0.0)
    if wants & f.BANDWIDTH:
        _run_slopes(program.points, registers, tangents, first, re, im, dre, dim)
        x, y = re[place, 0], im[place, 0]
        level = f.FALL * (x * x + y * y)
        d_level = (2.0 * f.FALL) * (load(dre, place) * x + load(dim, place) * y)
    for bit, to, at in (
        (f.GAIN, f.GAIN_MARGIN, f.GAIN_AT), (f.PHASE, f.PHASE_MARGIN, f.PHASE_AT),
        (f.DELAY, f.DELAY_MARGIN, f.DELAY_AT), (f.SENSITIVITY, f.MS, f.MS_AT), (f.COMPLEMENTARY, f.MT, f.MT_AT),
        (f.BANDWIDTH, f.FIRST_FALL, f.FIRST_FALL), (f.PEAK, f.HIGHEST, f.HIGHEST_AT),
    ):  # fmt: skip
        if not wants & bit:
            continue
        store(found, 0.0, to)
        here = reading[at]
        if not (abs(reading[to]) < math.inf and 0.0 < here < math.inf):
            continue
        crossing, inside = to in (f.GAIN_MARGIN, f.PHASE_MARGIN, f.DELAY_MARGIN, f.FIRST_FALL), first < here < last
        steep_x, steep_y, steep = 0.0, 0.0, 1.0
        if crossing and inside:
            for _ in range(2):
                store(omega, here, 0)
                run_point(program.points, registers, omega, re, im, dre, dim)
                x, y, steep_x, steep_y = re[place, 0], im[place, 0], dre[place, 0], dim[place, 0]
                steep = steep_y if to == f.GAIN_MARGIN else 2.0 * (x * steep_x + y * steep_y)
                move = -_miss(to, level, x, y) / steep
                here += min(max(move, -_REACH * here), _REACH * here)
        elif inside:
            uphill = _climb(program.points, registers, omega, to, place, here, re, im, dre, dim)
            beside = _climb(program.points, registers, omega, to, place, here * (1.0 + _BESIDE), re, im, dre, dim)
            if beside != uphill:
                move = -uphill * (_BESIDE * here) / (beside - uphill)
                here += min(max(move, -_REACH * here), _REACH * here)
        _run_slopes(program.points, registers, tangents, here, re, im, dre, dim)
        x, y, dx, dy = re[place, 0], im[place, 0], load(dre, place), load(dim, place)
        square = x * x + y * y
        moved = spread(0.0)
        if crossing and inside:
            missed = dy if to == f.GAIN_MARGIN else 2.0 * (dx * x + dy * y)
            if to == f.FIRST_FALL:
                missed = missed - d_level
            moved = -missed / steep
            dx, dy = dx + moved * steep_x, dy + moved * steep_y
        turn = (dy * x - dx * y) / square
        distance = (1.0 + x) * (1.0 + x) + y * y
        grows = (dx * x + dy * y) / square
        shrinks = (dx * (1.0 + x) + dy * y) / distance
        if to == f.GAIN_MARGIN:
            store(found, dx / (x * x), to)
        elif to == f.PHASE_MARGIN:
            store(found, turn, to)
        elif to == f.DELAY_MARGIN:
            store(found, (turn - moved * reading[to]) / here, to)
        elif to == f.MS:
            store(found, -(shrinks * reading[to]), to)
        elif to == f.MT:
            store(found, (grows - shrinks) * reading[to], to)
        elif to == f.FIRST_FALL:
            store(found, moved, to)
        else:
            store(found, grows * reading[to], to)


@compiled
def _levels(program: TimeProgram, readings: Real, h: float, most: int) -> int:
    """Return how many powers lead to the last of all instants."""
    top = 1
    for t in range(program.traces.shape[0]):
        for bit, to in (
            (s.RISE, r.T_90), (s.SETTLE_2, r.T_2), (s.SETTLE_5, r.T_5), (s.HIGHEST, r.TOP_TIME), (s.LOWEST, r.BOTTOM_TIME)
        ):  # fmt: skip
            if program.traces[t, 2] & bit:
                while readings[t, to] >= h * 2.0**top and top < most:
                    top += 1
    return top


@compiled
def differentiate(
    tape: Tape, count: int, program: TimeProgram, curves: SpectrumProgram, of_time: Whole, of_curves: Whole, points: Real,
    directions: Real, readings: Real, spectra: Real, growth: Real, results: Real,
) -> None:  # fmt: skip
    """Write the derivatives of metrics in up to eight directions.

    Parameters
    ----------
    tape, count, program, curves
        As in `evaluate`.
    of_time, of_curves
        Reading lists.
    points : ndarray, shape (B, parameters)
    directions : ndarray, shape (B, parameters, LANES)
        Derivatives of the parameters.
    readings, spectra, growth
        What `evaluate` found.
    results : ndarray, shape (B, R, LANES)
        Written for candidates that are stable.
    """
    n, nn, rows, experiments = program.states, program.padded, program.rows, program.experiments
    registers, tangents = room((count, LANES)), room((count, LANES))
    a, da = zeros((nn, nn, LANES)), zeros((nn, nn, LANES))
    b, db = zeros((nn, experiments, LANES)), zeros((nn, experiments, LANES))
    c, dc = zeros((rows, nn, LANES)), zeros((rows, nn, LANES))
    d, dd = zeros((program.outputs, experiments, LANES)), zeros((program.outputs, experiments, LANES))
    powers, norms = room((LEVELS, nn, nn, LANES)), room((LEVELS, LANES))
    d_powers, work = room((LEVELS, nn, nn, LANES)), room((12, nn, nn, LANES))
    rest, d_rest = room((nn, experiments, LANES)), room((nn, experiments, LANES))
    moved = room((2, nn, experiments, LANES))
    alive, step, rate = room((LANES,)), room((LANES,)), room((LANES,))
    start, d_start = room((nn, LANES)), room((nn, LANES))
    states, series, slopes = room((4, nn, LANES)), room((_TERMS, LANES)), room((_TERMS, LANES))
    traces = program.traces.shape[0]
    found = room((traces, r.READINGS, LANES))
    framed = room((curves.wants.shape[0], f.READINGS, LANES))
    point, omega = room((4, max(curves.points.places, 1), LANES)), room((1, LANES))
    for candidate in range(points.shape[0]):
        if not growth[candidate] < 0.0:
            continue
        for k in range(points.shape[1]):
            store(registers, points[candidate, k], k)
            for lane in range(LANES):
                tangents[k, lane] = directions[candidate, k, lane]
        run_tangents(tape, registers, tangents)
        for m in range(curves.wants.shape[0]):
            _curve_slopes(curves, m, registers, tangents, spectra[candidate, m], framed[m], point, omega)
        enter_slopes(of_curves, spectra[candidate], framed, results[candidate])
        if traces == 0:
            continue
        clear(a, nn * nn)
        clear(da, nn * nn)
        scatter(program, registers, a, b, c, d)
        scatter(program, tangents, da, db, dc, dd)
        store(alive, 1.0, 0)
        levels = raise_powers(a, b, n, nn, experiments, alive, step, powers, norms, rest, rate, work, moved)
        h = step[0]
        top = _levels(program, readings[candidate], h, levels)
        _power_slopes(a, da, db, nn, experiments, step, powers, levels, top, rest, d_powers, d_rest, work, moved)
        x, dx = work[0], work[6]
        for k in range(nn * nn):
            store(x, load(a, k) * h, k)
            store(dx, load(da, k) * h, k)
        for e in range(experiments):
            for i in range(nn):
                store(start, -load2(rest, i, e), i)
                store(d_start, -load2(d_rest, i, e), i)
            for t in range(traces):
                if program.traces[t, 1] != e:
                    continue
                o = program.traces[t, 0]
                row, d_row = c[2 * o], dc[2 * o]
                d_final = load2(dd, o, e)
                for i in range(nn):
                    d_final = d_final - load(row, i) * load(d_start, i) - load(d_row, i) * load(start, i)
                _response_slopes(
                    program.traces[t, 2], readings[candidate, t], found[t], h, readings[candidate, t, r.FINAL], d_final,
                    powers, d_powers, x, dx, nn, start, d_start, row, d_row, states, series, slopes,
                )  # fmt: skip
        enter_slopes(of_time, readings[candidate], found, results[candidate])
