"""One output of many candidates: where its response crosses a level and where it turns, polished on the polynomial of a piece.

A crossing is bracketed by samples and found by bisection and Newton; the last Newton step is taken with the infinitesimals,

    t* ← t* - (y(t*, p) - level(p)) / ẏ(t*),

which gives it its exact derivative (implicit-function rule). At a turning point ẏ = 0, so its value needs no such step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from engine.batch.collocation.march import GRID, POINTS, TO_POLYNOMIAL, Responses
from engine.model.linear_system import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """One output of some candidates: ``values`` (B, P, POINTS), ``final`` and ``reference`` (B,); from rest at 0."""

    values: Array
    starts: Array
    lengths: Array
    width: Array
    final: Array
    reference: Array

    @classmethod
    def of(cls, responses: Responses, experiment: int, output: int, reference: Array) -> Trace:
        """Return one output in one experiment."""
        final = responses.final[:, experiment, output]
        return cls(
            values=np.ascontiguousarray(responses.values[:, experiment, output]), starts=responses.starts, lengths=responses.lengths,
            width=responses.width, final=final, reference=np.broadcast_to(reference, final.shape),
        )  # fmt: skip

    @cached_property
    def real(self) -> Array:
        """Samples without infinitesimals, (B, P, POINTS)."""
        return np.ascontiguousarray(self.values.real)

    @property
    def flat(self) -> Array:
        """Samples in the order of time, (B, P * POINTS), real."""
        return np.asarray(self.real.reshape(len(self.values), -1))

    @cached_property
    def tops(self) -> Array:
        """Largest sample of every piece, (B, P)."""
        return _reduced(np.maximum, self.real)

    @cached_property
    def bottoms(self) -> Array:
        """Smallest sample of every piece, (B, P)."""
        return _reduced(np.minimum, self.real)

    @cached_property
    def extent(self) -> Array:
        """Largest absolute sample, (B,)."""
        return np.asarray(np.maximum(self.tops.max(axis=1), -self.bottoms.min(axis=1)))

    def polynomial(self, rows: Array, piece: Array) -> Array:
        """Return the coefficients (k, POINTS) of y on pieces, in 2θ - 1."""
        return np.asarray(self.values[rows, piece] @ TO_POLYNOMIAL.T)

    def instant(self, rows: Array, piece: Array, u: Array) -> Array:
        """Return the time (s) of the place u in [-1, 1] of a piece."""
        return np.asarray(self.width[rows] * (self.starts[piece] + self.lengths[piece] * (u + 1) / 2))


def _reduced(choose: np.ufunc, samples: Array) -> Array:
    """Reduce the last, short axis; numpy's own reduction is several times slower on such an axis."""
    result: Array = samples[..., 0].copy()
    for place in range(1, samples.shape[-1]):
        choose(result, samples[..., place], out=result)
    return result


def evaluate_polynomial(coefficients: Array, u: Array) -> tuple[Array, Array, Array]:
    """Return value, first and second derivative of polynomials (k, degree + 1) at u (k,)."""
    value = coefficients[:, -1]
    first = np.zeros_like(value)
    second = np.zeros_like(value)
    for k in range(coefficients.shape[1] - 2, -1, -1):
        second = second * u + 2 * first
        first = first * u + value
        value = value * u + coefficients[:, k]
    return value, first, second


def root(coefficients: Array, low: Array, high: Array, rises: Array) -> Array:
    """Return where polynomials pass 0 within brackets: upwards where ``rises`` is 1, downwards where it is -1."""
    at_low, at_high = evaluate_polynomial(coefficients, low)[0], evaluate_polynomial(coefficients, high)[0]
    apart = at_low != at_high
    u = low + (high - low) * np.clip(at_low / np.where(apart, at_low - at_high, 1.0), 0.0, 1.0)
    for _ in range(9):
        value, slope, _ = evaluate_polynomial(coefficients, u)
        below = rises * value < 0
        low, high = np.where(below, u, low), np.where(below, high, u)
        newton = u - value / np.where(slope == 0, np.inf, slope)
        u = np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
    return np.asarray(u)


def crossing(trace: Trace, rows: Array, before: Array, level: Array) -> Array:
    """Return the instants at which candidates ``rows`` pass ``level`` between sample ``before`` and the next one."""
    piece, place = before // POINTS, before % POINTS
    coefficients = trace.polynomial(rows, piece)
    coefficients[:, 0] = coefficients[:, 0] - level
    grid = 2 * GRID - 1
    low, high = grid[place], grid[np.minimum(place + 1, POINTS - 1)]
    real = coefficients.real
    sign = np.where(evaluate_polynomial(real, low)[0] < 0, 1.0, -1.0)
    # Between the end of a piece and the start of the next there is either nothing or a jump.
    u = root(real, low, high, sign)
    jumps = place == POINTS - 1
    u = np.where(jumps, 1.0, u)
    value, slope, _ = evaluate_polynomial(coefficients, u.astype(coefficients.dtype))
    scale = trace.extent[rows]
    smooth = (np.abs(slope.real) > 0) & (np.abs(value.real) <= 1e-6 * scale)
    shift = np.where(smooth, value / np.where(smooth, slope, 1.0), 0.0)
    return trace.instant(rows, piece, u - shift)


def polished(trace: Trace, rows: Array, sample: Array, sign: float | Array) -> tuple[Array, Array, Array]:
    """Return (value, piece, u) of the maximum of sign * y near samples; the value carries its infinitesimals."""
    pieces = trace.values.shape[1]
    piece, place = sample // POINTS, sample % POINTS
    grid = 2 * GRID - 1
    # At a joint the turning point may lie on the other side.
    slope = sign * evaluate_polynomial(trace.polynomial(rows, piece).real, grid[place])[1]
    onward = (place == POINTS - 1) & (slope > 0) & (piece + 1 < pieces)
    back = (place == 0) & (slope < 0) & (piece > 0)
    piece = piece + onward - back
    place = np.where(onward, 0, np.where(back, POINTS - 1, place))
    coefficients = trace.polynomial(rows, piece)
    real = sign * coefficients.real.T
    real = real.T
    low, high = grid[np.maximum(place - 1, 0)], grid[np.minimum(place + 1, POINTS - 1)]
    u = grid[place]
    for _ in range(8):
        _, first, second = evaluate_polynomial(real, u)
        concave = second < 0
        u = np.clip(np.where(concave, u - first / np.where(concave, second, -1.0), u), low, high)
    here = grid[place]
    better = evaluate_polynomial(real, u)[0] >= evaluate_polynomial(real, here)[0]
    u = np.where(better, u, here)
    value = evaluate_polynomial(coefficients, u)[0]
    # A jump: the sample on this side may be higher than anything on the other.
    original = trace.values[rows, sample // POINTS, sample % POINTS]
    jump = sign * original.real > sign * value.real
    return (
        np.where(jump, original, value),
        np.where(jump, sample // POINTS, piece),
        np.where(jump, grid[sample % POINTS], u),
    )


def _highest(trace: Trace, rows: Array, piece: Array, sign: float) -> Array:
    """Return the number of the sample of a piece at which sign * y is largest."""
    return np.asarray(piece * POINTS + (sign * trace.real[rows, piece]).argmax(axis=1))


def largest(trace: Trace, sign: float) -> tuple[Array, Array, Array]:
    """Return (value of y, piece, u) where sign * y is largest."""
    rows = np.arange(len(trace.values))
    tops = trace.tops if sign > 0 else -trace.bottoms
    piece = tops.argmax(axis=1)
    value, piece, u = polished(trace, rows, _highest(trace, rows, piece, sign), sign)
    # Two peaks of nearly the same height: samples cannot tell which is higher, their polynomials can.
    padded = np.pad(tops, ((0, 0), (1, 1)), constant_values=-np.inf)
    peaks = (tops > padded[:, :-2]) & (tops > padded[:, 2:])
    peaks[np.abs(np.arange(tops.shape[1]) - piece[:, None]) <= 1] = False
    second = np.where(peaks, tops, -np.inf).argmax(axis=1)
    close = peaks[rows, second] & (tops[rows, second] > tops.max(axis=1) - 0.1 * trace.extent)
    if close.any():
        other = np.flatnonzero(close)
        rival, rival_piece, rival_u = polished(trace, other, _highest(trace, other, second[other], sign), sign)
        wins = sign * rival.real > sign * value[other].real
        value[other[wins]], piece[other[wins]], u[other[wins]] = rival[wins], rival_piece[wins], rival_u[wins]
    return value, piece, u


def descent(trace: Trace, rows: Array, *, piece: Array, top: Array, level: Array, side: Array) -> Array:
    """Return when y comes back to ``level`` after a turning point that exceeds it by less than the samples show."""
    coefficients = trace.polynomial(rows, piece)
    coefficients[:, 0] = coefficients[:, 0] - level
    real = coefficients.real
    _, _, second = evaluate_polynomial(real, top)
    value = evaluate_polynomial(real, top)[0]
    u = top + np.sqrt(np.maximum(2 * value * side, 0.0) / np.maximum(-side * second, 1e-300))
    u = np.clip(u, top, 1.0)
    for _ in range(8):
        value, slope, _ = evaluate_polynomial(real, u)
        u = np.clip(u - value / np.where(slope == 0, np.inf, slope), top, 1.0)
    value, slope, _ = evaluate_polynomial(coefficients, u)
    shift = np.where(np.abs(value.real) < 1e-6 * np.abs(level.real), value / np.where(slope == 0, np.inf, slope), 0.0)
    return trace.instant(rows, piece, u - shift)
