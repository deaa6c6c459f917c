"""The functions of a frequency program, evaluated for eight candidates at a time: many frequencies, or one of each with slopes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import compiled, merged
from engine.batch.kernels.frequency_program import FrequencyProgram
from engine.batch.kernels.vector import load, load2, spread, store2

Real = npt.NDArray[np.float64]


@compiled
def _polynomial(program: FrequencyProgram, registers: Real, first: int, terms: int, omega: Any) -> Any:
    """Return the real and the imaginary part of a polynomial in jω; ``terms`` coefficients begin at ``first``."""
    merged()
    square, even, odd, last = -(omega * omega), spread(0.0), spread(0.0), terms - 1
    for j in range(last - (last & 1), -1, -2):
        even = even * square + load(registers, program.coefficients[first + j])
    for j in range(last - 1 + (last & 1), 0, -2):
        odd = odd * square + load(registers, program.coefficients[first + j])
    return even, odd * omega


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
                even, odd = _polynomial(program, registers, a, b, load(omega, w))
                store2(re, even, to, w)
                store2(im, odd, to, w)
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
        elif code == 8:
            for w in range(count):
                store2(re, tables_re[a, first + w], to, w)
                store2(im, tables_im[a, first + w], to, w)
        elif code == 9:
            for w in range(count):
                x, y = load2(re, a, w), load2(im, a, w)
                p, q = tables_re[b, first + w], tables_im[b, first + w]
                store2(re, x * p - y * q, to, w)
                store2(im, x * q + y * p, to, w)
        elif code == 10:
            for w in range(count):
                u, v = load2(re, b, w), load2(im, b, w)
                p, q = tables_re[a, first + w], tables_im[a, first + w]
                inverse = 1.0 / (u * u + v * v)
                store2(re, (u * p + v * q) * inverse, to, w)
                store2(im, (u * q - v * p) * inverse, to, w)
        elif code == 11:
            factor = load(registers, b)
            for w in range(count):
                store2(re, factor * tables_re[a, first + w], to, w)
                store2(im, factor * tables_im[a, first + w], to, w)
        else:
            terms = program.operations[k, 4]
            for w in range(count):
                even, odd = _polynomial(program, registers, b, terms, load(omega, w))
                p, q = tables_re[a, first + w], tables_im[a, first + w]
                inverse = 1.0 / (even * even + odd * odd)
                store2(re, (even * p + odd * q) * inverse, to, w)
                store2(im, (even * q - odd * p) * inverse, to, w)


@compiled
def run_points(
    program: FrequencyProgram, registers: Real, omega: Real, count: int, re: Real, im: Real, dre: Real, dim: Real
) -> None:
    """Evaluate all functions and their slopes by frequency at ``count`` frequencies of every lane.

    ``omega`` is (count or more, LANES), the other arrays (places, as many, LANES).
    """
    for k in range(program.operations.shape[0]):
        code, to = program.operations[k, 0], program.operations[k, 1]
        a, b = program.operations[k, 2], program.operations[k, 3]
        if code == 0:
            for w in range(count):
                s = load(omega, w)
                square = -(s * s)
                even, odd, d_even, d_odd = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
                last = b - 1
                for j in range(last - (last & 1), -1, -2):
                    d_even = d_even * square + even
                    even = even * square + load(registers, program.coefficients[a + j])
                for j in range(last - 1 + (last & 1), 0, -2):
                    d_odd = d_odd * square + odd
                    odd = odd * square + load(registers, program.coefficients[a + j])
                store2(re, even, to, w)
                store2(im, odd * s, to, w)
                store2(dre, -2.0 * s * d_even, to, w)
                store2(dim, odd + 2.0 * square * d_odd, to, w)
        elif code == 1:
            for w in range(count):
                store2(re, load2(re, a, w) + load2(re, b, w), to, w)
                store2(im, load2(im, a, w) + load2(im, b, w), to, w)
                store2(dre, load2(dre, a, w) + load2(dre, b, w), to, w)
                store2(dim, load2(dim, a, w) + load2(dim, b, w), to, w)
        elif code == 2:
            for w in range(count):
                store2(re, load2(re, a, w) - load2(re, b, w), to, w)
                store2(im, load2(im, a, w) - load2(im, b, w), to, w)
                store2(dre, load2(dre, a, w) - load2(dre, b, w), to, w)
                store2(dim, load2(dim, a, w) - load2(dim, b, w), to, w)
        elif code == 3:
            for w in range(count):
                x, y, p, q = load2(re, a, w), load2(im, a, w), load2(dre, a, w), load2(dim, a, w)
                u, v, m, n = load2(re, b, w), load2(im, b, w), load2(dre, b, w), load2(dim, b, w)
                store2(re, x * u - y * v, to, w)
                store2(im, x * v + y * u, to, w)
                store2(dre, p * u - q * v + x * m - y * n, to, w)
                store2(dim, p * v + q * u + x * n + y * m, to, w)
        elif code == 4:
            for w in range(count):
                x, y, p, q = load2(re, a, w), load2(im, a, w), load2(dre, a, w), load2(dim, a, w)
                u, v, m, n = load2(re, b, w), load2(im, b, w), load2(dre, b, w), load2(dim, b, w)
                inverse = 1.0 / (u * u + v * v)
                c, d = (x * u + y * v) * inverse, (y * u - x * v) * inverse
                f, g = p - (c * m - d * n), q - (c * n + d * m)
                store2(re, c, to, w)
                store2(im, d, to, w)
                store2(dre, (f * u + g * v) * inverse, to, w)
                store2(dim, (g * u - f * v) * inverse, to, w)
        elif code == 5:
            factor = load(registers, b)
            for w in range(count):
                store2(re, load2(re, a, w) * factor, to, w)
                store2(im, load2(im, a, w) * factor, to, w)
                store2(dre, load2(dre, a, w) * factor, to, w)
                store2(dim, load2(dim, a, w) * factor, to, w)
        elif code == 6:
            shift = load(registers, b)
            for w in range(count):
                store2(re, load2(re, a, w) + shift, to, w)
                store2(im, load2(im, a, w), to, w)
                store2(dre, load2(dre, a, w), to, w)
                store2(dim, load2(dim, a, w), to, w)
        else:
            for w in range(count):
                store2(re, -load2(re, a, w), to, w)
                store2(im, -load2(im, a, w), to, w)
                store2(dre, -load2(dre, a, w), to, w)
                store2(dim, -load2(dim, a, w), to, w)
