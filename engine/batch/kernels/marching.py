"""Runge and Kutta's method of fourth order on the tapes of a diagram, for many candidates at once.

    k_1 = f(t, x),  k_2 = f(t + h/2, x + h k_1/2),  k_3 = f(t + h/2, x + h k_2/2),  k_4 = f(t + h, x + h k_3)
    x(t + h) = x + h (k_1 + 2 k_2 + 2 k_3 + k_4)/6

Registers are (register, group, lane): a row of a tape is done for all groups of eight candidates before the next, so that
reading the tape costs little.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, allocating, compiled
from engine.batch.kernels.functions import cos, exp, log, maximum, minimum, multiply_add, sin, tanh
from engine.batch.kernels.vector import load2, root, select, spread, store2

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


@compiled
def interpret(tape: Whole, registers: Real) -> None:
    """Run a tape on registers (register, group, LANES)."""
    groups = registers.shape[1]
    for row in range(tape.shape[0]):
        op, a, b, c, to = tape[row, 0], tape[row, 1], tape[row, 2], tape[row, 3], tape[row, 4]
        if op == 15:
            for j in range(groups):
                x, y, z = load2(registers, a, j), load2(registers, b, j), load2(registers, c, j)
                store2(registers, multiply_add(x, y, z), to, j)
        elif op == 2:
            for j in range(groups):
                store2(registers, load2(registers, a, j) * load2(registers, b, j), to, j)
        elif op == 0:
            for j in range(groups):
                store2(registers, load2(registers, a, j) + load2(registers, b, j), to, j)
        elif op == 1:
            for j in range(groups):
                store2(registers, load2(registers, a, j) - load2(registers, b, j), to, j)
        elif op == 16:
            for j in range(groups):
                x, y, z = load2(registers, a, j), load2(registers, b, j), load2(registers, c, j)
                store2(registers, multiply_add(x, y, -z), to, j)
        elif op == 17:
            for j in range(groups):
                x, y, z = load2(registers, a, j), load2(registers, b, j), load2(registers, c, j)
                store2(registers, multiply_add(-x, y, z), to, j)
        elif op == 14:
            for j in range(groups):
                yes, no = load2(registers, b, j), load2(registers, c, j)
                store2(registers, select(load2(registers, a, j) > 0.0, yes, no), to, j)
        elif op == 3:
            for j in range(groups):
                store2(registers, load2(registers, a, j) / load2(registers, b, j), to, j)
        elif op == 4:
            for j in range(groups):
                store2(registers, -load2(registers, a, j), to, j)
        elif op == 5:
            for j in range(groups):
                store2(registers, root(load2(registers, a, j)), to, j)
        elif op == 6:
            for j in range(groups):
                store2(registers, exp(load2(registers, a, j)), to, j)
        elif op == 11:
            for j in range(groups):
                store2(registers, tanh(load2(registers, a, j)), to, j)
        elif op == 12:
            for j in range(groups):
                store2(registers, maximum(load2(registers, a, j), load2(registers, b, j)), to, j)
        elif op == 13:
            for j in range(groups):
                store2(registers, minimum(load2(registers, a, j), load2(registers, b, j)), to, j)
        elif op == 18:
            for j in range(groups):
                store2(registers, load2(registers, a, j), to, j)
        elif op == 7:
            for j in range(groups):
                store2(registers, log(load2(registers, a, j)), to, j)
        elif op == 8:
            for j in range(groups):
                store2(registers, sin(load2(registers, a, j)), to, j)
        elif op == 9:
            for j in range(groups):
                store2(registers, cos(load2(registers, a, j)), to, j)
        else:
            for j in range(groups):
                store2(registers, select(load2(registers, a, j) == 0.0, 1.0, 0.0), to, j)


@compiled
def drive(
    registers: Real, first: int, inputs: Real, row: int, places: Whole, shares: Real, past: Real, group: int
) -> None:  # fmt: skip
    """Put inputs and delayed signals at a row into the registers (register, groups, LANES), ``first`` on; ``group`` is the first of them in ``past``."""
    given, delayed, groups = inputs.shape[1], places.shape[1], registers.shape[1]
    for i in range(given):
        for j in range(groups):
            store2(registers, inputs[row, i], first + i, j)
    for i in range(delayed):
        values, slopes, slot = past[i], past[delayed + i], places[row, i]
        for j in range(groups):
            a, b = load2(values, slot, group + j), load2(slopes, slot, group + j)
            c, d = load2(values, slot + 1, group + j), load2(slopes, slot + 1, group + j)
            for kind in range(2):
                share = shares[row, i, 4 * kind : 4 * kind + 4]
                heard = multiply_add(b, spread(share[1]), a * share[0])
                heard = multiply_add(d, spread(share[3]), multiply_add(c, spread(share[2]), heard))
                store2(registers, heard, first + given + kind * delayed + i, j)


@allocating
def march(
    whole: Whole, rates_only: Whole, rates: Whole, read: Whole, entering: Whole, registers: Real, inputs: Real,
    places: Whole, shares: Real, past: Real, first: int, width: float, stride: int, record: Real,
) -> None:  # fmt: skip
    """March over equal steps.

    Parameters
    ----------
    whole : ndarray of int, shape (K, 5)
        The tape for the beginning of a step.
    rates_only : ndarray of int, shape (K, 5)
        That for the stages within it.
    rates, read, entering : ndarray of int
        Registers of x', of what is written down, and of what goes into the delays with its slopes.
    registers : ndarray, shape (registers, groups, LANES)
        The first hold the states, which are at the end when the march is over; those behind hold inputs and delayed signals.
    inputs : ndarray, shape (3 steps + 1, inputs)
        Inputs and their slopes at the beginning, in the middle and at the end of each step, and behind the last one: what
        jumps between two steps has another value at the end of the first than at the beginning of the second.
    places : ndarray of int, shape (3 steps + 1, m)
    shares : ndarray, shape (3 steps + 1, m, 8)
    past : ndarray, shape (2 m, slots, groups, LANES)
    first : int
        What delayed signals are made of; see `engine.batch.nonlinear.lookback`. What goes in at the beginning of each step is put
        into the slots of ``past`` from ``first`` on.
    width : float
        Of a step, s.
    stride : int
        Every so many steps it is written down, at the beginning of the first and at the end of the last.
    record : ndarray, shape (groups, steps / stride + 1, read, LANES)
    """
    states, groups, delayed, steps = rates.shape[0], registers.shape[1], places.shape[1], inputs.shape[0] // 3
    half, third, sixth, full = spread(width * (1 / 2)), spread(width * (1 / 3)), spread(width * (1 / 6)), spread(width)
    begin = np.empty((states, groups, LANES))
    total = np.empty((states, groups, LANES))
    for k in range(steps + 1):
        for stage in range(4 if k < steps else 1):
            row = 3 * k + (stage + 1) // 2
            drive(registers, states, inputs, row, places, shares, past, 0)
            if stage == 0:
                interpret(whole, registers)
                if k % stride == 0:
                    for j in range(groups):
                        line = record[j]
                        for i in range(read.shape[0]):
                            store2(line, load2(registers, read[i], j), k // stride, i)
                for i in range(2 * delayed):
                    line = past[i]
                    for j in range(groups):
                        store2(line, load2(registers, entering[i], j), first + k, j)
            else:
                interpret(rates_only, registers)
            if k == steps:
                break
            if stage == 0:
                for i in range(states):
                    for j in range(groups):
                        x, slope = load2(registers, i, j), load2(registers, rates[i], j)
                        store2(begin, x, i, j)
                        store2(total, multiply_add(slope, sixth, x), i, j)
                        store2(registers, multiply_add(slope, half, x), i, j)
            elif stage < 3:
                part = half if stage == 1 else full
                for i in range(states):
                    for j in range(groups):
                        slope = load2(registers, rates[i], j)
                        store2(total, multiply_add(slope, third, load2(total, i, j)), i, j)
                        store2(registers, multiply_add(slope, part, load2(begin, i, j)), i, j)
            else:
                for i in range(states):
                    for j in range(groups):
                        slope = load2(registers, rates[i], j)
                        store2(registers, multiply_add(slope, sixth, load2(total, i, j)), i, j)
