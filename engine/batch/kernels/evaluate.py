"""Eight candidates at a time through the whole kernel: tape, powers, samples, events."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, allocating, compiled, multiply_pairs
from engine.batch.kernels.events import MOST, NUMBERS, READINGS, ROLES, TAYLOR, locate
from engine.batch.kernels.polishing import ALL, BRACKET, EVENTS, SLOT
from engine.batch.kernels.powers import LEVELS, RESOLVED, STIFF, raise_powers
from engine.batch.kernels.sampling import follow, passes
from engine.batch.kernels.scan_state import COLUMNS, FIELDS, ROWS, begin
from engine.batch.kernels.spectrum import MARKS, spectrum
from engine.batch.kernels.spectrum_program import CHUNK, DOUBT, SpectrumProgram
from engine.batch.kernels.spectrum_program import READINGS as SPECTRAL_READINGS
from engine.batch.kernels.tape import Tape, run
from engine.batch.kernels.time_program import TimeProgram
from engine.batch.kernels.turning import RUN
from engine.batch.kernels.vector import clear, copy, load, load2, magnitude, room, select, spread, store, store2, zeros

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]

_OUT_OF_SIGHT: Final = 1e3
"""A mode that is so much slower than the first frequency of the table, or faster than the last."""


@compiled
def scatter(program: TimeProgram, registers: Real, a: Real, b: Real, c: Real, d: Real) -> None:
    """Put the registers where they belong in A, B, C and D; everything else there is 0 and stays it."""
    for k in range(program.a.shape[0]):
        i, j, r, s = program.a[k, 0], program.a[k, 1], program.a[k, 2], program.a_scale[k]
        store2(a, load(registers, r) * s, i, j)
    for k in range(program.b.shape[0]):
        i, j, r, s = program.b[k, 0], program.b[k, 1], program.b[k, 2], program.b_scale[k]
        store2(b, load(registers, r) * s, i, j)
    for k in range(program.c.shape[0]):
        i, j, r, s = program.c[k, 0], program.c[k, 1], program.c[k, 2], program.c_scale[k]
        store2(c, load(registers, r) * s, 2 * i, j)
    for k in range(program.d.shape[0]):
        i, j, r = program.d[k, 0], program.d[k, 1], program.d[k, 2]
        store2(d, load(registers, r), i, j)


@compiled
def computable(program: TimeProgram, registers: Real, alive: Real) -> None:
    """Mark the candidates all of whose coefficients of B, C and D are numbers; those of A are looked at later."""
    finite = spread(0.0) == 0.0
    for k in range(program.b.shape[0]):
        finite = finite & (magnitude(load(registers, program.b[k, 2])) < math.inf)
    for k in range(program.c.shape[0]):
        finite = finite & (magnitude(load(registers, program.c[k, 2])) < math.inf)
    for k in range(program.d.shape[0]):
        finite = finite & (magnitude(load(registers, program.d[k, 2])) < math.inf)
    store(alive, select(finite, load(alive, 0), 0.0), 0)


@compiled
def expand(program: TimeProgram, a: Real, c: Real, step: Real, x: Real, taylors: Real) -> None:
    """Write the rows C (A h)^k, k = 0 ... (rows / 2, TAYLOR, nn, LANES), and the slopes C A beside the rows of C; x is room."""
    nn, outputs, h = program.padded, program.rows // 2, load(step, 0)
    for k in range(nn * nn):
        store(x, load(a, k) * h, k)
    for o in range(outputs):
        copy(taylors[o], 0, c[2 * o], 0, nn)
    stride = TAYLOR * nn
    for k in range(1, TAYLOR):
        multiply_pairs(taylors[0, k], taylors[0, k - 1], x, outputs, nn, nn, stride, nn, stride)
    for o in range(program.outputs):
        for i in range(nn):
            store2(c, load(taylors[o, 1], i) / h, 2 * o + 1, i)


@compiled
def admit(bounds: Whole, limits: Real, registers: Real, alive: Real) -> None:
    """Mark the candidates whose values are within their bounds: register, open below; lower, upper."""
    for lane in range(LANES):
        good = True
        for k in range(bounds.shape[0]):
            value = registers[bounds[k, 0], lane]
            above = value > limits[k, 0] if bounds[k, 1] > 0 else value >= limits[k, 0]
            good = good and above and value <= limits[k, 1] and abs(value) < math.inf
        alive[lane] = 1.0 if good else 0.0


@compiled
def beyond(curves: SpectrumProgram, step: Real, rate: Real, readings: Real) -> None:
    """Doubt all readings of candidates whose modes lie so far beyond the table of frequencies that no sample hints at them."""
    last = curves.frequencies.shape[0] - 1
    slowest, fastest = curves.frequencies[1] / _OUT_OF_SIGHT, curves.frequencies[last - 1] * _OUT_OF_SIGHT
    for lane in range(LANES):
        if -rate[lane] < slowest or fastest * step[lane] < RESOLVED:
            for c in range(curves.wants.shape[0]):
                readings[c, DOUBT, lane] = ALL


@allocating
def evaluate(
    tape: Tape, count: int, bounds: Whole, limits: Real, pivots: Whole, smallest: Real, program: TimeProgram,
    curves: SpectrumProgram, points: Real, readings: Real, spectra: Real, growth: Real, valid: Real, extra: int,
) -> None:  # fmt: skip
    """Evaluate candidates.

    Parameters
    ----------
    tape, count
        The tape and its number of registers.
    bounds, limits
        What makes a candidate exist.
    pivots, smallest
        Registers of what algebraic loops divide by, and below which size that leaves doubt.
    program, curves
        What is asked of it in time and in frequency.
    points : ndarray, shape (B, parameters)
    readings : ndarray, shape (B, T, READINGS)
        Written for what exists and is stable; the rest stays as it is.
    spectra : ndarray, shape (B, curves, READINGS of a spectrum)
        Written likewise.
    growth, valid : ndarray, shape (B,)
        Written.
    extra : int
        Responses have 2^extra times as many samples as usual.
    """
    total = points.shape[0]
    n, nn, rows, experiments = program.states, program.padded, program.rows, program.experiments
    registers = room((count, LANES))
    a, b = zeros((nn, nn, LANES)), zeros((nn, experiments, LANES))
    c, d = zeros((rows, nn, LANES)), zeros((program.outputs, experiments, LANES))
    powers, norms = room((LEVELS, nn, nn, LANES)), room((LEVELS, LANES))
    rest, work = room((nn, experiments, LANES)), room((6, nn, nn, LANES))
    moved = room((2, nn, experiments, LANES))
    alive, step, rate = room((LANES,)), room((LANES,)), room((LANES,))
    watched, moving = room((2, ROWS * rows, nn, LANES)), room((1, nn, 1, LANES))
    run_of = room((RUN, LANES))
    columns, samples = zeros((nn, COLUMNS, LANES)), room((ROWS * rows, COLUMNS, LANES))
    taylors = room((rows // 2, TAYLOR, nn, LANES))
    traces = program.traces.shape[0]
    states, saved = room((traces, FIELDS, LANES)), room((traces, FIELDS, LANES))
    start, edge, final = room((nn, LANES)), room((2, 1, LANES)), room((traces, LANES))
    roles, numbers = np.empty((2, ROLES, MOST * traces), np.int64), room((2, NUMBERS, MOST * traces, LANES))
    vectors, polynomials = room((3, nn * MOST * traces, LANES)), room((MOST * traces, TAYLOR, LANES))
    reading = room((traces, READINGS, LANES))
    spectral = room((curves.wants.shape[0], SPECTRAL_READINGS, LANES))
    curve_re = room((curves.wants.shape[0], curves.frequencies.shape[0], LANES))
    curve_im = room((curves.wants.shape[0], curves.frequencies.shape[0], LANES))
    places = max(curves.scan.places, 1)
    network, seen, seen_count = room((2, places, CHUNK, LANES)), room((3, EVENTS, LANES)), np.empty(LANES, np.int32)
    omega, marks, levels_of = room((CHUNK, LANES)), room((MARKS, LANES)), room((curves.wants.shape[0], LANES))
    points_of = room((4, max(curves.points.places, 1), EVENTS, LANES))
    slots, bracket = room((EVENTS, SLOT, LANES)), room((BRACKET, LANES))
    for first in range(0, total, LANES):
        for lane in range(LANES):
            candidate = min(first + lane, total - 1)
            for k in range(points.shape[1]):
                registers[k, lane] = points[candidate, k]
        run(tape, registers)
        admit(bounds, limits, registers, alive)
        clear(a, nn * nn)
        scatter(program, registers, a, b, c, d)
        computable(program, registers, alive)
        for lane in range(LANES):
            candidate = first + lane
            if candidate < total:
                valid[candidate] = alive[lane]
        # from here on `alive` also asks for finite coefficients of A
        levels = raise_powers(a, b, n, nn, experiments, alive, step, powers, norms, rest, rate, work, moved, extra)
        for lane in range(LANES):
            for k in range(pivots.shape[0]):
                if abs(registers[pivots[k], lane]) < smallest[k]:
                    rate[lane] = math.nan
            # Every squaring doubles the rounding of the slowest mode.
            if -STIFF < rate[lane] * step[lane] < 0.0:
                rate[lane] = math.nan
            candidate = first + lane
            if candidate < total:
                valid[candidate] *= alive[lane]
                growth[candidate] = rate[lane]
        stable = False
        for lane in range(LANES):
            stable = stable or (alive[lane] > 0.0 and rate[lane] < 0.0)
        if not stable:
            continue
        if curves.wants.shape[0] > 0:
            spectrum(curves, registers, spectral, curve_re, curve_im, network, seen, seen_count, omega, marks, levels_of,
                     points_of, slots, bracket)  # fmt: skip
            beyond(curves, step, rate, spectral)
            for lane in range(LANES):
                candidate = first + lane
                if candidate < total and alive[lane] > 0.0 and rate[lane] < 0.0:
                    for m in range(curves.wants.shape[0]):
                        for k in range(SPECTRAL_READINGS):
                            spectra[candidate, m, k] = spectral[m, k, lane]
        if program.traces.shape[0] == 0:
            continue
        expand(program, a, c, step, work[0], taylors)
        last = passes(norms, levels, alive, rate)
        for e in range(experiments):
            for i in range(nn):
                store(start, -load2(rest, i, e), i)
            for t in range(program.traces.shape[0]):
                if program.traces[t, 1] != e:
                    continue
                o = program.traces[t, 0]
                away, slope = spread(0.0), spread(0.0)
                for i in range(nn):
                    away = away + load2(c, 2 * o, i) * load(start, i)
                    slope = slope + load2(c, 2 * o + 1, i) * load(start, i)
                store(final, load2(d, o, e) - away, t)
                store2(edge, away, 0, 0)
                store2(edge, slope, 1, 0)
                begin(states[t], edge[0, 0], edge[1, 0], final[t])
            follow(
                program,
                e,
                powers,
                c,
                start,
                final,
                step,
                last,
                extra,
                states,
                saved,
                watched,
                columns,
                samples,
                moving,
                run_of,
            )
            locate(program, e, states, powers, start, c, taylors, final, step, reading, roles, numbers, vectors,
                   polynomials)  # fmt: skip
        for lane in range(LANES):
            candidate = first + lane
            if candidate < total and alive[lane] > 0.0 and rate[lane] < 0.0:
                for t in range(program.traces.shape[0]):
                    for k in range(READINGS):
                        readings[candidate, t, k] = reading[t, k, lane]
