"""Step responses of eight candidates at a time, sampled where something happens.

    y(t) = y∞ + C e^(A t) (-x∞):   16 samples for every octave of time, from the fastest mode until nothing moves

Where a scan of the samples leaves something open, that octave is sampled again twice as finely, and again.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, apply, apply_two, compiled, multiply
from engine.batch.kernels.scan_state import (  # fmt: skip
    COLUMNS,
    ERROR,
    FIELDS,
    HIGHEST,
    LOW,
    LOWEST,
    N2,
    N5,
    PER_PASS,
    ROWS,
    SETTLE_2,
    SETTLE_5,
    TOP,
)
from engine.batch.kernels.scanning import scan
from engine.batch.kernels.time_program import TimeProgram
from engine.batch.kernels.vector import copy, load, store2

Real = npt.NDArray[np.float64]

SETTLED: Final = 1e-8
"""A response is followed until its slowest mode has decayed to this."""
FINEST: Final = 9
"""How often the samples of an octave are doubled at most."""


@compiled
def passes(norms: Real, levels: int, alive: Real, growth: Real) -> int:
    """Return how many passes of 16 samples follow every candidate of the block until it rests."""
    last = 0
    for lane in range(LANES):
        if alive[lane] > 0.0 and growth[lane] < 0.0:
            level = 0
            while level + 1 < levels and norms[level, lane] > SETTLED:
                level += 1
            last = max(last, level)
    # the pass number k ends after 16 * 2^k steps
    return min(max(last - 5, 0), max(levels - 4, 0)) + 2


@compiled
def _keep(program: TimeProgram, experiment: int, to: Real, states: Real) -> None:
    """Copy what the scans of the responses to one command have found, of the kinds that they are asked for."""
    for t in range(program.traces.shape[0]):
        if program.traces[t, 1] == experiment:
            wants = program.traces[t, 2]
            copy(to[t], 0, states[t], 0, N2)
            if wants & SETTLE_2:
                copy(to[t], N2, states[t], N2, N5 - N2)
            if wants & SETTLE_5:
                copy(to[t], N5, states[t], N5, TOP - N5)
            if wants & HIGHEST:
                copy(to[t], TOP, states[t], TOP, LOW - TOP)
            if wants & LOWEST:
                copy(to[t], LOW, states[t], LOW, ERROR - LOW)
            copy(to[t], ERROR, states[t], ERROR, FIELDS - ERROR)


@compiled
def _watch(watched: Real, rows: Real, powers: Real, level: int, count: int, nn: int) -> None:
    """Fill ``watched`` with the rows C P^j, j = 1 ... 4, where P leads over 2^level steps."""
    multiply(watched, rows, powers[level], count, nn, nn, nn, nn, nn)
    multiply(watched[count:], watched, powers[level], count, nn, nn, nn, nn, nn)
    multiply(watched[2 * count :], watched, powers[level + 1], 2 * count, nn, nn, nn, nn, nn)


@compiled
def follow(
    program: TimeProgram, experiment: int, powers: Real, rows: Real, start: Real, final: Real, step: Real, last: int,
    extra: int, states: Real, saved: Real, watched: Real, columns: Real, samples: Real, moving: Real, run: Real,
) -> None:  # fmt: skip
    """Sample the responses to one command in ``last`` passes, and scan them; with 2^extra times as many samples at least.

    Parameters
    ----------
    program, experiment
        Whose traces, and which of them; their scans have begun.
    powers, rows
        Of the exponential (levels, nn, nn, LANES); of every output and its slope (rows, nn, LANES).
    start : ndarray, shape (nn, LANES)
        The deviation of the states at t = 0+ from their values at rest.
    final : ndarray, shape (traces, LANES)
    step : ndarray, shape (LANES,)
    states : ndarray, shape (traces, FIELDS, LANES)
        Of the scans.
    saved, watched, columns, samples, moving, run
        Room: as ``states``; (2, ROWS * rows, nn, LANES); (nn, COLUMNS, LANES); (ROWS * rows, COLUMNS, LANES);
        (1, nn, 1, LANES); (RUN, LANES).
    """
    nn, count, traces = program.padded, program.rows, program.traces.shape[0]
    origin = moving[0]
    copy(origin, 0, start, 0, nn)
    main, fine = watched[0], watched[1]
    _watch(main, rows, powers, 0, count, nn)
    doubled, before = 0, 0
    for number in range(last):
        level = max(0, number - 1)
        first = 0 if number == 0 else PER_PASS
        if level > 0:
            copy(main, 0, main, count * nn, count * nn)
            copy(main, count * nn, main, 3 * count * nn, count * nn)
            multiply(main[2 * count :], main, powers[level + 1], 2 * count, nn, nn, nn, nn, nn)
        # where the octave before needed finer samples, this one may, too
        doubled = min(max(doubled - 1, extra), level)
        if level > 0:
            _keep(program, experiment, saved, states)
        while True:
            deep = level - doubled
            least = deep == 0 or doubled == FINEST
            seen = main
            if doubled:
                seen = fine
                _watch(fine, rows, powers, deep, count, nn)
            for i in range(nn):
                store2(columns, load(origin, i), i, 0)
            unsure = False
            for part in range(1 << doubled):
                # the state, and how it is after four, eight and twelve samples
                if part:
                    apply(columns[0], powers[deep + 2], columns[0, 3:], nn, 1, nn, nn, COLUMNS, COLUMNS)
                apply(columns[0, 1:], powers[deep + 2], columns[0], nn, 1, nn, nn, COLUMNS, COLUMNS)
                apply_two(columns[0, 2:], powers[deep + 3], columns[0], nn, 2, nn, nn, COLUMNS, COLUMNS)
                multiply(samples, seen, columns, ROWS * count, COLUMNS, nn, nn, COLUMNS, COLUMNS)
                begin_at = float((first << doubled) + PER_PASS * part)
                for t in range(traces):
                    if program.traces[t, 1] == experiment:
                        open_ = scan(states[t], run, samples, 2 * program.traces[t, 0], count, final[t], step, deep,
                                     before if part == 0 else deep, begin_at, program.traces[t, 2], least)  # fmt: skip
                        if open_ and not least:
                            unsure = True
                            break
                if unsure:
                    break
            if not unsure:
                break
            doubled += 1
            _keep(program, experiment, states, saved)
        apply(origin, powers[level - doubled + 2], columns[0, 3:], nn, 1, nn, nn, COLUMNS, 1)
        before = level - doubled
