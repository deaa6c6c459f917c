"""Derivatives of what is read off a curve over frequency: one candidate, one direction to a lane.

|L(jω*)| = 1 and its like:  dω* = -∂f/f_ω;     a peak's height moves as the curve does at its frequency
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels import spectrum_program as f
from engine.batch.kernels.compiled import compiled
from engine.batch.kernels.curves import run_points
from engine.batch.kernels.frequency_program import FrequencyProgram
from engine.batch.kernels.spectrum_program import SpectrumProgram
from engine.batch.kernels.vector import load, spread, store

Real = npt.NDArray[np.float64]

_REACH: Final = 1e-3
"""A frequency is corrected by at most this part of it: readings are nearer than that."""
_BESIDE: Final = 1e-5
"""How far to the side the curvature at a peak is looked at, as a part of its frequency."""


@compiled
def _run_slopes(
    program: FrequencyProgram, registers: Real, tangents: Real, omega: float, re: Real, im: Real, dre: Real, dim: Real
) -> None:  # fmt: skip
    """Evaluate all functions at one frequency, all lanes alike, and their derivatives; arrays (places, 1, LANES)."""
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
    run_points(program, registers, omega, 1, re, im, dre, dim)
    x, y, dx, dy = re[place, 0, 0], im[place, 0, 0], dre[place, 0, 0], dim[place, 0, 0]
    square, slope = x * x + y * y, 2.0 * (x * dx + y * dy)
    if to == f.HIGHEST:
        return slope
    nearness, distance = slope + 2.0 * dx, square + 2.0 * x + 1.0
    return nearness if to == f.MS else nearness * square - distance * slope


@compiled
def curve_slopes(
    program: SpectrumProgram, curve: int, registers: Real, tangents: Real, reading: Real, found: Real, point: Real,
    omega: Real,
) -> None:  # fmt: skip
    """Write the derivatives (READINGS, LANES) of what is read off one curve; ``point`` is (4, places, 1, LANES)."""
    wants, place = program.wants[curve], program.points.targets[curve]
    re, im, dre, dim = point[0], point[1], point[2], point[3]
    first, last = program.frequencies[0], program.frequencies[program.frequencies.shape[0] - 1]
    level, d_level = 0.0, spread(0.0)
    if wants & f.BANDWIDTH:
        _run_slopes(program.points, registers, tangents, first, re, im, dre, dim)
        x, y = re[place, 0, 0], im[place, 0, 0]
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
                run_points(program.points, registers, omega, 1, re, im, dre, dim)
                x, y, steep_x, steep_y = re[place, 0, 0], im[place, 0, 0], dre[place, 0, 0], dim[place, 0, 0]
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
        x, y, dx, dy = re[place, 0, 0], im[place, 0, 0], load(dre, place), load(dim, place)
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
