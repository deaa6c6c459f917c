"""Eight candidates at a time through the whole kernel: tape, powers, samples, events."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, allocating, compiled, multiply_pairs
from engine.batch.kernels.events import MOST, READINGS, locate
from engine.batch.kernels.polishing import ALL, BRACKET, EVENTS, SLOT
from engine.batch.kernels.powers import LEVELS, RESOLVED, STIFF, raise_powers
from engine.batch.kernels.sampling import follow, passes
from engine.batch.kernels.scan_state import COLUMNS, FIELDS, PACES, ROWS, begin
from engine.batch.kernels.spectrum import MARKS, spectrum
from engine.batch.kernels.spectrum_program import CHUNK, DOUBT, SpectrumProgram
from engine.batch.kernels.spectrum_program import READINGS as SPECTRAL_READINGS
from engine.batch.kernels.tape import Tape, run
from engine.batch.kernels.time_program import TimeProgram
from engine.batch.kernels.turning import RUN
from engine.batch.kernels.vector import clear, copy, load, load2, magnitude, room, select, spread, store, store2, zeros
from engine.batch.kernels.walking import NUMBERS, ROLES, TAYLOR

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


class TimeRoom(NamedTuple):
    """Room for the responses of eight candidates; see `engine.batch.kernels.sampling.follow` and `engine.batch.kernels.events.locate`."""

    powers: Real
    norms: Real
    rest: Real
    work: Real
    moved: Real
    watched: Real
    moving: Real
    run_of: Real
    pace: Real
    columns: Real
    samples: Real
    taylors: Real
    states: Real
    saved: Real
    start: Real
    edge: Real
    final: Real
    roles: npt.NDArray[np.int64]
    numbers: Real
    vectors: Real
    polynomials: Real
    reading: Real


class CurveRoom(NamedTuple):
    """Room for the curves over frequency of eight candidates; see `engine.batch.kernels.spectrum.spectrum`."""

    reading: Real
    re: Real
    im: Real
    network: Real
    seen: Real
    counts: Whole
    omega: Real
    marks: Real
    levels: Real
    points: Real
    slots: Real
    bracket: Real


@allocating
def _time_room(program: TimeProgram) -> TimeRoom:
    nn, rows, experiments, traces = program.padded, program.rows, program.experiments, program.traces.shape[0]
    return TimeRoom(
        room((LEVELS, nn, nn, LANES)), room((LEVELS, LANES)), room((nn, experiments, LANES)), room((6, nn, nn, LANES)),
        room((2, nn, experiments, LANES)), room((2, ROWS * rows, nn, LANES)), room((2, nn, 1, LANES)), room((RUN, LANES)), room((PACES, LANES)),
        zeros((nn, COLUMNS, LANES)), room((ROWS * rows, COLUMNS, LANES)), room((rows // 2, TAYLOR, nn, LANES)),
        room((traces, FIELDS, LANES)), room((traces, FIELDS, LANES)), room((nn, LANES)), room((2, 1, LANES)),
        room((traces, LANES)), np.empty((2, ROLES, MOST * traces), np.int64), room((2, NUMBERS, MOST * traces, LANES)),
        room((3, nn * MOST * traces, LANES)), room((MOST * traces, TAYLOR, LANES)), room((traces, READINGS, LANES)),
    )  # fmt: skip


@allocating
def _curve_room(curves: SpectrumProgram) -> CurveRoom:
    count, frequencies = curves.wants.shape[0], curves.frequencies.shape[0]
    return CurveRoom(
        room((count, SPECTRAL_READINGS, LANES)), room((count, frequencies, LANES)), room((count, frequencies, LANES)),
        room((2, max(curves.scan.places, 1), CHUNK, LANES)), room((3, EVENTS, LANES)), np.empty(LANES, np.int32),
        room((CHUNK, LANES)), room((MARKS, LANES)), room((count, LANES)),
        room((4, max(curves.points.places, 1), EVENTS, LANES)), room((EVENTS, SLOT, LANES)), room((BRACKET, LANES)),
    )  # fmt: skip


@compiled
def _doubt_rates(pivots: Whole, smallest: Real, registers: Real, step: Real, rate: Real) -> None:
    """Leave open how fast candidates grow whose algebraic loops divide by little, or whose slowest mode is rounding."""
    for lane in range(LANES):
        for k in range(pivots.shape[0]):
            if abs(registers[pivots[k], lane]) < smallest[k]:
                rate[lane] = math.nan
        # Every squaring doubles the rounding of the slowest mode.
        if -STIFF < rate[lane] * step[lane] < 0.0:
            rate[lane] = math.nan


@compiled
def _enter(found: Real, first: int, alive: Real, rate: Real, out: Real) -> None:
    """Write what was found (T, K, LANES) of candidates that exist and are stable to their places in ``out`` (B, T, K)."""
    for lane in range(min(LANES, out.shape[0] - first)):
        if alive[lane] > 0.0 and rate[lane] < 0.0:
            for t in range(found.shape[0]):
                for k in range(found.shape[1]):
                    out[first + lane, t, k] = found[t, k, lane]


@compiled
def _begin(program: TimeProgram, e: int, c: Real, d: Real, own: TimeRoom) -> None:
    """Let the responses of an experiment begin: away from where they go by what the states are."""
    nn, start, edge = program.padded, own.start, own.edge
    for i in range(nn):
        store(start, -load2(own.rest, i, e), i)
    for t in range(program.traces.shape[0]):
        if program.traces[t, 1] != e:
            continue
        o = program.traces[t, 0]
        away, slope = spread(0.0), spread(0.0)
        for i in range(nn):
            away = away + load2(c, 2 * o, i) * load(start, i)
            slope = slope + load2(c, 2 * o + 1, i) * load(start, i)
        store(own.final, load2(d, o, e) - away, t)
        store2(edge, away, 0, 0)
        store2(edge, slope, 1, 0)
        begin(own.states[t], edge[0, 0], edge[1, 0], own.final[t])


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
    total, n, nn, experiments = points.shape[0], program.states, program.padded, program.experiments
    registers, alive, step, rate = room((count, LANES)), room((LANES,)), room((LANES,)), room((LANES,))
    a, b = zeros((nn, nn, LANES)), zeros((nn, experiments, LANES))
    c, d = zeros((program.rows, nn, LANES)), zeros((program.outputs, experiments, LANES))
    own, framed = _time_room(program), _curve_room(curves)
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
        here = min(LANES, total - first)
        valid[first : first + here] = alive[:here]
        # from here on `alive` also asks for finite coefficients of A
        levels = raise_powers(
            a, b, n, nn, experiments, alive, step, own.powers, own.norms, own.rest, rate, own.work, own.moved, extra
        )  # fmt: skip
        _doubt_rates(pivots, smallest, registers, step, rate)
        valid[first : first + here] *= alive[:here]
        growth[first : first + here] = rate[:here]
        if not np.any((alive > 0.0) & (rate < 0.0)):
            continue
        if curves.wants.shape[0] > 0:
            spectrum(
                curves, registers, framed.reading, framed.re, framed.im, framed.network, framed.seen, framed.counts,
                framed.omega, framed.marks, framed.levels, framed.points, framed.slots, framed.bracket,
            )  # fmt: skip
            beyond(curves, step, rate, framed.reading)
            _enter(framed.reading, first, alive, rate, spectra)
        if program.traces.shape[0] == 0:
            continue
        expand(program, a, c, step, own.work[0], own.taylors)
        passes(own.norms, levels, alive, rate, own.pace)
        for e in range(experiments):
            _begin(program, e, c, d, own)
            follow(
                program, e, own.powers, c, own.start, own.final, step, extra, own.states, own.saved, own.watched,
                own.columns, own.samples, own.moving, own.run_of, own.pace,
            )  # fmt: skip
            locate(
                program, e, own.states, own.powers, own.start, c, own.taylors, own.final, step, own.reading, own.roles,
                own.numbers, own.vectors, own.polynomials,
            )  # fmt: skip
        _enter(own.reading, first, alive, rate, readings)
