"""Step responses of eight candidates at a time, sampled where something happens.

    y(t) = y∞ + C e^(A t) (-x∞):   16 samples for every octave of time, from the fastest mode until nothing moves

Where a scan of the samples leaves something open, that octave is sampled again twice as finely, and again.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, apply, apply_two, compiled, multiply
from engine.batch.kernels.scan_state import (
    APART,
    COLUMNS,
    DOUBLED,
    DUE,
    ERROR,
    FIELDS,
    HIGHEST,
    LAST,
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
from engine.batch.kernels.vector import copy, lanes_of, load, load2, select, store, store2

Real = npt.NDArray[np.float64]

SETTLED: Final = 1e-8
"""A response is followed until its slowest mode has decayed to this."""
FINEST: Final = 9
"""How often the samples of an octave are doubled at most."""


@compiled
def passes(norms: Real, levels: int, alive: Real, growth: Real, pace: Real) -> None:
    """Say in how many passes of 16 samples each candidate is followed until it rests: in none who does not exist or is not stable."""
    for lane in range(LANES):
        pace[LAST, lane] = 0.0
        if alive[lane] > 0.0 and growth[lane] < 0.0:
            level = 0
            while level + 1 < levels and norms[level, lane] > SETTLED:
                level += 1
            # the pass number k ends after 16 * 2^k steps
            pace[LAST, lane] = max(level - 5, 0) + 2


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
def _decide(program: TimeProgram, experiment: int, decided: Any, to: Real, states: Real) -> None:
    """Copy all that the scans of the responses to one command have found, of who is decided; the others' stays."""
    for t in range(program.traces.shape[0]):
        if program.traces[t, 1] == experiment:
            for field in range(FIELDS):
                store2(to, select(decided, load2(states, t, field), load2(to, t, field)), t, field)


@compiled
def _watch(watched: Real, rows: Real, powers: Real, level: int, count: int, nn: int) -> None:
    """Fill ``watched`` with the rows C P^j, j = 1 ... 4, where P leads over 2^level steps."""
    multiply(watched, rows, powers[level], count, nn, nn, nn, nn, nn)
    multiply(watched[count:], watched, powers[level], count, nn, nn, nn, nn, nn)
    multiply(watched[2 * count :], watched, powers[level + 1], 2 * count, nn, nn, nn, nn, nn)


@compiled
def _octave(
    program: TimeProgram, experiment: int, powers: Real, final: Real, step: Real, deep: int, doubled: int, first: int,
    least: bool, due: int, states: Real, seen: Real, columns: Real, samples: Real, run: Real, pace: Real,
) -> int:  # fmt: skip
    """Sample and scan one octave of time, whose beginning is in ``columns``, at intervals of 2^deep steps; return who is left unsure.

    When everyone is whose turn it is, ``due``, the rest is left out, unless ``least``, which says that there is nothing finer.
    """
    nn, count, unsure = program.padded, program.rows, 0
    for part in range(1 << doubled):
        # the state, and how it is after four, eight and twelve samples
        if part:
            apply(columns[0], powers[deep + 2], columns[0, 3:], nn, 1, nn, nn, COLUMNS, COLUMNS)
        apply(columns[0, 1:], powers[deep + 2], columns[0], nn, 1, nn, nn, COLUMNS, COLUMNS)
        apply_two(columns[0, 2:], powers[deep + 3], columns[0], nn, 2, nn, nn, COLUMNS, COLUMNS)
        multiply(samples, seen, columns, ROWS * count, COLUMNS, nn, nn, COLUMNS, COLUMNS)
        begin_at = float((first << doubled) + PER_PASS * part)
        for t in range(program.traces.shape[0]):
            if program.traces[t, 1] == experiment:
                unsure |= scan(
                    states[t], run, samples, 2 * program.traces[t, 0], count, final[t], step, deep, pace, part == 0, begin_at,
                    program.traces[t, 2], least,
                )  # fmt: skip
                if unsure == due and not least:
                    return unsure
    return 0 if least else unsure


@compiled
def _turn_over(pace: Real, unsure: int, doubled: int, deep: int) -> None:
    """After an octave, leave it the turn of those who are sure, and note at which intervals; the others need them finer."""
    for lane in range(LANES):
        if pace[DUE, lane] > 0.0:
            if (unsure >> lane) & 1:
                pace[DUE, lane], pace[DOUBLED, lane] = 0.0, float(doubled + 1)
            else:
                pace[APART, lane] = float(1 << deep)


@compiled
def follow(
    program: TimeProgram, experiment: int, powers: Real, rows: Real, start: Real, final: Real, step: Real, extra: int,
    states: Real, saved: Real, watched: Real, columns: Real, samples: Real, moving: Real, run: Real, pace: Real,
) -> None:  # fmt: skip
    """Sample the responses to one command, and scan them; with 2^extra times as many samples at least.

    Every octave of time is gone through as often as some lane needs it finer, and each lane keeps what it found when it was
    sure: what is found of a candidate is the same whoever lies beside it.

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
        (2, nn, 1, LANES); (RUN, LANES).
    pace : ndarray, shape (PACES, LANES)
        Whose LAST says in how many passes each lane is followed.
    """
    nn, count = program.padded, program.rows
    origin, ahead = moving[0], moving[1]
    copy(origin, 0, start, 0, nn)
    main, fine = watched[0], watched[1]
    _watch(main, rows, powers, 0, count, nn)
    passes, everyone = 0, lanes_of(load(pace, LAST) > 0.0)
    for lane in range(LANES):
        passes = max(passes, int(pace[LAST, lane]))
    store(pace, 0.0, DOUBLED)
    store(pace, 1.0, APART)
    for number in range(passes):
        level = max(0, number - 1)
        first = 0 if number == 0 else PER_PASS
        if level > 0:
            copy(main, 0, main, count * nn, count * nn)
            copy(main, count * nn, main, 3 * count * nn, count * nn)
            multiply(main[2 * count :], main, powers[level + 1], 2 * count, nn, nn, nn, nn, nn)
            _keep(program, experiment, saved, states)
        for lane in range(LANES):
            # where the octave before needed finer samples, this one may, too
            pace[DOUBLED, lane] = float(min(max(int(pace[DOUBLED, lane]) - 1, extra), level))
        left, again, in_turn = lanes_of(load(pace, LAST) > float(number)), False, False
        for doubled in range(level + 1):
            deep = level - doubled
            least = deep == 0 or doubled == FINEST
            due = left & lanes_of(load(pace, DOUBLED) == float(doubled))
            if not due:
                continue
            for lane in range(LANES):
                pace[DUE, lane] = float((due >> lane) & 1)
            if again:
                _keep(program, experiment, states, saved)
            again = True
            seen = main
            if doubled:
                seen = fine
                _watch(fine, rows, powers, deep, count, nn)
            for i in range(nn):
                store2(columns, load(origin, i), i, 0)
            unsure = _octave(
                program, experiment, powers, final, step, deep, doubled, first, least, due, states, seen, columns, samples, run,
                pace,
            )  # fmt: skip
            _turn_over(pace, unsure, doubled, deep)
            if unsure == due:
                continue
            decided = load(pace, DUE) > 0.0
            apply(ahead, powers[deep + 2], columns[0, 3:], nn, 1, nn, nn, COLUMNS, 1)
            for i in range(nn):
                store(origin, select(decided, load(ahead, i), load(origin, i)), i)
            left &= unsure | ~due
            in_turn = in_turn or (due & ~unsure) != everyone
            if in_turn:
                _decide(program, experiment, decided, saved, states)
            if not left:
                break
        if in_turn:
            _keep(program, experiment, states, saved)
