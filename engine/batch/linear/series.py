"""One piece of a response: a Chebyshev series of degree 16 on [-1, 1]. Roots by bounds, not by samples.

    |c_0| > Σ |c_k|  =>  no root;   |d_0| > Σ |d_k| of the derivative  =>  one root at most, told by the signs at the ends

Where neither holds the piece is cut in half, so that no pair of roots is overlooked. Decisions look at real parts: a series may be
complex and carry infinitesimals.

References
----------
J. P. Boyd, "Solving Transcendental Equations", SIAM 2014, chapters 2-3 (Chebyshev proxies, subdivision).
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from numpy.polynomial import chebyshev

from engine.batch.linear.compiled import compiled

Real = npt.NDArray[np.float64]
Series = npt.NDArray[Any]

DEGREE: Final = 16
SIZE: Final = DEGREE + 1
NODES: Final = np.array([0, 1, 3, 6, 10, 14, 20, 26, 32, 38, 44, 50, 54, 58, 61, 63, 64])
"""Of 64 parts of a piece: near to Chebyshev's points (Lebesgue constant 2.8), and halves of each other's places."""
PARTS: Final = 64
DEPTH: Final = 48
MOST_ROOTS: Final = 64


def _to_series() -> tuple[Real, Real]:
    """Return the even coefficients of sums, (9, 9), and the odd ones of differences, (8, 8), of values at mirrored nodes."""
    whole: Real = np.linalg.inv(chebyshev.chebvander(2.0 * NODES / PARTS - 1.0, DEGREE)).astype(np.float64)
    even = whole[0::2, : DEGREE // 2 + 1].copy()
    even[:, -1] /= 2  # the node in the middle is its own mirror
    return np.asarray(even), np.asarray(whole[1::2, : DEGREE // 2].copy())


def _halves() -> Real:
    """Return the matrices that give the series on the left and the right half, (2, 17, 17)."""
    points = np.cos(np.pi * np.arange(SIZE) / DEGREE)
    inverse = np.linalg.inv(chebyshev.chebvander(points, DEGREE))
    return np.stack([np.triu(inverse @ chebyshev.chebvander((points + side) / 2, DEGREE)) for side in (-1.0, 1.0)])


def _squares() -> Real:
    """Return ∫ T_i T_j over [-1, 1], (17, 17)."""
    points, weights = np.polynomial.legendre.leggauss(SIZE)
    at = chebyshev.chebvander(points, DEGREE)
    return np.asarray(at.T @ (weights[:, None] * at))


EVEN, ODD = _to_series()
HALVES: Final = _halves()
SQUARES: Final = _squares()


@compiled
def to_series(nodes: Series, out: Series) -> None:
    """Write the coefficients of the series through values at the nodes."""
    half = DEGREE // 2
    for i in range(half + 1):
        total = 0.0 * nodes[0]
        for k in range(half + 1):
            total = total + EVEN[i, k] * (nodes[k] + nodes[DEGREE - k])
        out[2 * i] = total
    for i in range(half):
        total = 0.0 * nodes[0]
        for k in range(half):
            total = total + ODD[i, k] * (nodes[k] - nodes[DEGREE - k])
        out[2 * i + 1] = total


@compiled
def value_at(c: Series, size: int, u: Any) -> Any:
    """Return a series of ``size`` coefficients at u (Clenshaw)."""
    first, second = 0.0 * c[0], 0.0 * c[0]
    for k in range(size - 1, 0, -1):
        first, second = 2.0 * u * first - second + c[k], first
    return u * first - second + c[0]


@compiled
def differentiate(c: Series, d: Series) -> None:
    """Write the derivative by u of a series, both of 17 coefficients."""
    d[DEGREE] = 0.0 * c[0]
    d[DEGREE - 1] = 2.0 * DEGREE * c[DEGREE]
    for k in range(DEGREE - 1, 0, -1):
        d[k - 1] = d[k + 1] + 2.0 * k * c[k]
    d[0] *= 0.5


@compiled
def spread_of(c: Series) -> float:
    """Return a bound of how far a series goes from its mean coefficient."""
    total = 0.0
    for k in range(1, SIZE):
        total += abs(c[k].real)
    return total


@compiled
def left_end(c: Series) -> Any:
    """Return the value at -1."""
    total = c[0]
    for k in range(1, SIZE):
        total = total - c[k] if k % 2 else total + c[k]
    return total


@compiled
def right_end(c: Series) -> Any:
    """Return the value at 1."""
    total = c[0]
    for k in range(1, SIZE):
        total = total + c[k]
    return total


@compiled
def bracketed(c: Series, d: Series, a: float, b: float, below: bool) -> float:
    """Return the root of a real series between a and b by Newton kept in the bracket; ``below``: it is negative at a."""
    u = 0.5 * (a + b)
    for _ in range(80):
        f = value_at(c, SIZE, u)
        if f == 0.0:
            break
        if (f < 0.0) == below:
            a = u
        else:
            b = u
        slope = value_at(d, SIZE, u)
        new = u - f / slope if slope != 0.0 else 0.5 * (a + b)
        if not (a <= new <= b):
            new = 0.5 * (a + b)
        if abs(new - u) <= 4e-16:
            break
        u = new
    return u


@compiled
def roots(c: Series, least: float, work: Real, found: Real) -> int:
    """Write the roots in [-1, 1] of the real parts of a series, rising, and return how many; -1 where they cannot be told.

    Parameters
    ----------
    c : ndarray, shape (17,)
    least : float
        A part of the piece on which the series stays below this is rounding: only a change of sign from end to end counts there.
    work : ndarray, shape (DEPTH + 4, 19)
    found : ndarray, shape (MOST_ROOTS,)
    """
    whole, slope, right = work[DEPTH], work[DEPTH + 1], work[DEPTH + 2]
    for k in range(SIZE):
        whole[k] = c[k].real
        work[0, k] = whole[k]
    work[0, SIZE], work[0, SIZE + 1] = -1.0, 1.0
    known = False
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        part = work[depth]
        rest = spread_of(part)
        if abs(part[0]) > rest:
            continue
        a, b = part[SIZE], part[SIZE + 1]
        local = work[DEPTH + 3]
        differentiate(part, local)
        if abs(local[0]) > spread_of(local) or abs(part[0]) + rest <= least or b - a < 1e-9:
            below, above = value_at(whole, SIZE, a) < 0.0, value_at(whole, SIZE, b) < 0.0
            if below != above:
                if count == MOST_ROOTS:
                    return -1
                if not known:
                    differentiate(whole, slope)
                    known = True
                found[count] = bracketed(whole, slope, a, b, below)
                count += 1
            continue
        if depth + 2 >= DEPTH:
            return -1
        for i in range(SIZE):
            left, other = 0.0, 0.0
            for k in range(i, SIZE):
                left += HALVES[0, i, k] * part[k]
                other += HALVES[1, i, k] * part[k]
            right[i] = other
            work[depth + 1, i] = left
        middle = 0.5 * (a + b)
        work[depth + 1, SIZE], work[depth + 1, SIZE + 1] = a, middle
        for i in range(SIZE):
            part[i] = right[i]
        part[SIZE], part[SIZE + 1] = middle, b
        depth += 2
    return count


@compiled
def integral_of(c: Series) -> Any:
    """Return ∫ over [-1, 1]."""
    total = 2.0 * c[0]
    for k in range(2, SIZE, 2):
        total = total + c[k] * (2.0 / (1.0 - k * k))
    return total


@compiled
def integral_of_square(c: Series) -> Any:
    """Return ∫ of the square over [-1, 1]."""
    total = 0.0 * c[0]
    for i in range(SIZE):
        row = 0.0 * c[0]
        for k in range(i % 2, SIZE, 2):
            row = row + SQUARES[i, k] * c[k]
        total = total + row * c[i]
    return total


@compiled
def timed(c: Series, start: float, half: float, out: Series) -> None:
    """Write (start + half (u + 1)) c(u), 18 coefficients."""
    for k in range(SIZE + 1):
        out[k] = 0.0 * c[0]
    for k in range(SIZE):
        out[k] += (start + half) * c[k]
        out[k + 1] += (half if k == 0 else 0.5 * half) * c[k]
        if k > 0:
            out[k - 1] += 0.5 * half * c[k]


@compiled
def antiderivative(c: Series, size: int, out: Series) -> None:
    """Write the series of ∫ from -1 to u, ``size`` + 1 coefficients."""
    for k in range(1, size + 1):
        before = c[k - 1] * (2.0 if k == 1 else 1.0)
        after = c[k + 1] if k + 1 < size else 0.0 * c[0]
        out[k] = (before - after) / (2.0 * k)
    first = 0.0 * c[0]
    for k in range(1, size + 1):
        first = first + (out[k] if k % 2 else -out[k])
    out[0] = first


@compiled
def finite(c: Series) -> bool:
    """Whether all coefficients are numbers."""
    total = 0.0
    for k in range(SIZE):
        total += abs(c[k].real)
    return total < math.inf
