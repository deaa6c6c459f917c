"""Exact derivatives of a candidate's metrics in eight directions at once: one direction to a lane.

The readings say where the events of a candidate are; there everything is evaluated once more, with its derivatives by the
parameters at a fixed instant or frequency, and the event's own motion is added by the rule of implicit functions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.batch.kernels import events as r
from engine.batch.kernels import scan_state as s
from engine.batch.kernels import spectrum_program as f
from engine.batch.kernels.compiled import LANES, allocating, compiled
from engine.batch.kernels.evaluate import scatter
from engine.batch.kernels.powers import LEVELS, raise_powers
from engine.batch.kernels.readings import enter_slopes
from engine.batch.kernels.response_slopes import TERMS, expand_slopes, power_slopes, response_slopes
from engine.batch.kernels.spectrum_program import SpectrumProgram
from engine.batch.kernels.spectrum_slopes import curve_slopes
from engine.batch.kernels.tape import Tape
from engine.batch.kernels.time_program import TimeProgram
from engine.batch.kernels.vector import clear, load, load2, room, spread, store, zeros

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]


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
def _final_slope(o: int, nn: int, direct: Any, c: Real, dc: Real, start: Real, d_start: Real) -> Any:
    """Return how the final value of output ``o`` moves."""
    for i in range(nn):
        direct = direct - load2(c, 2 * o, i) * load(d_start, i) - load2(dc, 2 * o, i) * load(start, i)
    return direct


@allocating
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
    states, series, slopes = room((4, nn, LANES)), room((TERMS, LANES)), room((TERMS, LANES))
    taylors, d_taylors = room((rows // 2, TERMS, nn, LANES)), room((rows // 2, TERMS, nn, LANES))
    traces = program.traces.shape[0]
    found = room((traces, r.READINGS, LANES))
    framed = room((curves.wants.shape[0], f.READINGS, LANES))
    point, omega = room((4, max(curves.points.places, 1), 1, LANES)), room((1, LANES))
    for candidate in range(points.shape[0]):
        if not growth[candidate] < 0.0:
            continue
        for k in range(points.shape[1]):
            store(registers, points[candidate, k], k)
            for lane in range(LANES):
                tangents[k, lane] = directions[candidate, k, lane]
        run_tangents(tape, registers, tangents)
        for m in range(curves.wants.shape[0]):
            curve_slopes(curves, m, registers, tangents, spectra[candidate, m], framed[m], point, omega)
        enter_slopes(of_curves, spectra[candidate], framed, results[candidate])
        if traces == 0:
            continue
        clear(a, nn * nn)
        clear(da, nn * nn)
        scatter(program, registers, a, b, c, d)
        scatter(program, tangents, da, db, dc, dd)
        store(alive, 1.0, 0)
        levels = raise_powers(a, b, n, nn, experiments, alive, step, powers, norms, rest, rate, work, moved, 0)
        h = step[0]
        top = _levels(program, readings[candidate], h, levels)
        power_slopes(a, da, db, nn, experiments, step, powers, levels, top, rest, d_powers, d_rest, work, moved)
        x, dx = work[0], work[6]
        for k in range(nn * nn):
            store(x, load(a, k) * h, k)
            store(dx, load(da, k) * h, k)
        expand_slopes(c, dc, x, dx, rows // 2, nn, taylors, d_taylors)
        for e in range(experiments):
            for i in range(nn):
                store(start, -load2(rest, i, e), i)
                store(d_start, -load2(d_rest, i, e), i)
            for t in range(traces):
                if program.traces[t, 1] != e:
                    continue
                o = program.traces[t, 0]
                d_final = _final_slope(o, nn, load2(dd, o, e), c, dc, start, d_start)
                response_slopes(
                    program.traces[t, 2], readings[candidate, t], found[t], h, readings[candidate, t, r.FINAL], d_final,
                    powers, d_powers, nn, start, d_start, taylors[o], d_taylors[o], states, series, slopes,
                )  # fmt: skip
        enter_slopes(of_time, readings[candidate], found, results[candidate])
