"""The functions of a frequency program, evaluated for eight candidates at a time: many frequencies, or one of each with slopes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from engine.kernels.compiled import compiled
from engine.kernels.transfer import FrequencyProgram
from engine.kernels.vector import load, load2, spread, store, store2

Real = npt.NDArray[np.float64]


@compiled
def run_program(
    program: FrequencyProgram, registers: Real, omega: Real, tables_re: Real, tables_im: Real, first: int, re: Real,
    im: Real,
) -> None:  # fmt: skip
    """Evaluate all functions at the frequencies ``omega`` (count, LANES); ``re``, ``im`` (places, count, LANES)."""
    count = omega.shape[0]
    for k in range(program.operations.shape[0]):
        code, to = program.operations[k, 0], program.operations[k, 1]
        a, b = program.operations[k, 2], program.operations[k, 3]
        if code == 0:
            for w in range(count):
                s = load(omega, w)
                square = -(s * s)
                even, odd = spread(0.0), spread(0.0)
                last = b - 1
                for j in range(last - (last & 1), -1, -2):
                    even = even * square + load(registers, program.coefficients[a + j])
                for j in range(last - 1 + (last & 1), 0, -2):
                    odd = odd * square + load(registers, program.coefficients[a + j])
                store2(re, even, to, w)
                store2(im, odd * s, to, w)
        elif code == 1:
            for w in range(count):
                store2(re, load2(re, a, w) + load2(re, b, w), to, w)
                store2(im, load2(im, a, w) + load2(im, b, w), to, w)
        elif code == 2:
            for w in range(count):
                store2(re, load2(re, a, w) - load2(re, b, w), to, w)
                store2(im, load2(im, a, w) - load2(im, b, w), to, w)
        elif code == 3:
            for w in range(count):
                x, y, u, v = load2(re, a, w), load2(im, a, w), load2(re, b, w), load2(im, b, w)
                store2(re, x * u - y * v, to, w)
                store2(im, x * v + y * u, to, w)
        elif code == 4:
            for w in range(count):
                x, y, u, v = load2(re, a, w), load2(im, a, w), load2(re, b, w), load2(im, b, w)
                inverse = 1.0 / (u * u + v * v)
                store2(re, (x * u + y * v) * inverse, to, w)
                store2(im, (y * u - x * v) * inverse, to, w)
        elif code == 5:
            factor = load(registers, b)
            for w in range(count):
                store2(re, load2(re, a, w) * factor, to, w)
                store2(im, load2(im, a, w) * factor, to, w)
        elif code == 6:
            shift = load(registers, b)
            for w in range(count):
                store2(re, load2(re, a, w) + shift, to, w)
                store2(im, load2(im, a, w), to, w)
        elif code == 7:
            for w in range(count):
                store2(re, -load2(re, a, w), to, w)
                store2(im, -load2(im, a, w), to, w)
        else:
            for w in range(count):
                store2(re, tables_re[a, first + w], to, w)
                store2(im, tables_im[a, first + w], to, w)


@compiled
def run_point(
    program: FrequencyProgram, registers: Real, omega: Real, re: Real, im: Real, dre: Real, dim: Real
) -> None:
    """Evaluate all functions and their slopes by frequency at one frequency of every lane; arrays (places, LANES)."""
    s = load(omega, 0)
    square = -(s * s)
    for k in range(program.operations.shape[0]):
        code, to = program.operations[k, 0], program.operations[k, 1]
        a, b = program.operations[k, 2], program.operations[k, 3]
        if code == 0:
            even, odd, d_even, d_odd = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            last = b - 1
            for j in range(last - (last & 1), -1, -2):
                d_even = d_even * square + even
                even = even * square + load(registers, program.coefficients[a + j])
            for j in range(last - 1 + (last & 1), 0, -2):
                d_odd = d_odd * square + odd
                odd = odd * square + load(registers, program.coefficients[a + j])
            store(re, even, to)
            store(im, odd * s, to)
            store(dre, -2.0 * s * d_even, to)
            store(dim, odd + 2.0 * square * d_odd, to)
            continue
        x, y, p, q = load(re, a), load(im, a), load(dre, a), load(dim, a)
        if code == 5:
            factor = load(registers, b)
            store(re, x * factor, to)
            store(im, y * factor, to)
            store(dre, p * factor, to)
            store(dim, q * factor, to)
            continue
        if code == 6:
            store(re, x + load(registers, b), to)
            store(im, y, to)
            store(dre, p, to)
            store(dim, q, to)
            continue
        u, v, m, n = load(re, b), load(im, b), load(dre, b), load(dim, b)
        if code == 1:
            store(re, x + u, to)
            store(im, y + v, to)
            store(dre, p + m, to)
            store(dim, q + n, to)
        elif code == 2:
            store(re, x - u, to)
            store(im, y - v, to)
            store(dre, p - m, to)
            store(dim, q - n, to)
        elif code == 3:
            store(re, x * u - y * v, to)
            store(im, x * v + y * u, to)
            store(dre, p * u - q * v + x * m - y * n, to)
            store(dim, p * v + q * u + x * n + y * m, to)
        elif code == 4:
            inverse = 1.0 / (u * u + v * v)
            c, d = (x * u + y * v) * inverse, (y * u - x * v) * inverse
            f, g = p - (c * m - d * n), q - (c * n + d * m)
            store(re, c, to)
            store(im, d, to)
            store(dre, (f * u + g * v) * inverse, to)
            store(dim, (g * u - f * v) * inverse, to)
        else:
            store(re, -x, to)
            store(im, -y, to)
            store(dre, -p, to)
            store(dim, -q, to)
