"""Metrics of many step responses at once: crossings and turning points polished on the polynomial of their piece.

A crossing is bracketed by samples and found by bisection and Newton; the last Newton step is taken with the infinitesimals,

    t* ← t* - (y(t*, p) - level(p)) / ẏ(t*),

which gives it its exact derivative (implicit-function rule). At a turning point ẏ = 0, so its value needs no such step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from engine.linear.screening_march import GRID, POINTS, TO_POLYNOMIAL, Responses
from engine.linear.system import Array

NEGLIGIBLE = 1e-9
"""A difference below this part of the signal is not a difference."""
_GRAZING = 0.95
"""A later turning point whose sample reaches this part of the band is looked at closely."""
_WEIGHTS = (TO_POLYNOMIAL.T @ np.array([(1 + (-1) ** k) / (k + 1) for k in range(POINTS)])) / 2
"""Integral over a piece of unit length of the polynomial through its samples."""


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


def _root(coefficients: Array, low: Array, high: Array, rises: Array) -> Array:
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


def _crossing(trace: Trace, rows: Array, before: Array, level: Array) -> Array:
    """Return the instants at which candidates ``rows`` pass ``level`` between sample ``before`` and the next one."""
    piece, place = before // POINTS, before % POINTS
    coefficients = trace.polynomial(rows, piece)
    coefficients[:, 0] = coefficients[:, 0] - level
    grid = 2 * GRID - 1
    low, high = grid[place], grid[np.minimum(place + 1, POINTS - 1)]
    real = coefficients.real
    sign = np.where(evaluate_polynomial(real, low)[0] < 0, 1.0, -1.0)
    # Between the end of a piece and the start of the next there is either nothing or a jump.
    u = _root(real, low, high, sign)
    jumps = place == POINTS - 1
    u = np.where(jumps, 1.0, u)
    value, slope, _ = evaluate_polynomial(coefficients, u.astype(coefficients.dtype))
    scale = trace.extent[rows]
    smooth = (np.abs(slope.real) > 0) & (np.abs(value.real) <= 1e-6 * scale)
    shift = np.where(smooth, value / np.where(smooth, slope, 1.0), 0.0)
    return trace.instant(rows, piece, u - shift)


def _polished(trace: Trace, rows: Array, sample: Array, sign: float | Array) -> tuple[Array, Array, Array]:
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


def _largest(trace: Trace, sign: float) -> tuple[Array, Array, Array]:
    """Return (value of y, piece, u) where sign * y is largest."""
    rows = np.arange(len(trace.values))
    tops = trace.tops if sign > 0 else -trace.bottoms
    piece = tops.argmax(axis=1)
    value, piece, u = _polished(trace, rows, _highest(trace, rows, piece, sign), sign)
    # Two peaks of nearly the same height: samples cannot tell which is higher, their polynomials can.
    padded = np.pad(tops, ((0, 0), (1, 1)), constant_values=-np.inf)
    peaks = (tops > padded[:, :-2]) & (tops > padded[:, 2:])
    peaks[np.abs(np.arange(tops.shape[1]) - piece[:, None]) <= 1] = False
    second = np.where(peaks, tops, -np.inf).argmax(axis=1)
    close = peaks[rows, second] & (tops[rows, second] > tops.max(axis=1) - 0.1 * trace.extent)
    if close.any():
        other = np.flatnonzero(close)
        rival, rival_piece, rival_u = _polished(trace, other, _highest(trace, other, second[other], sign), sign)
        wins = sign * rival.real > sign * value[other].real
        value[other[wins]], piece[other[wins]], u[other[wins]] = rival[wins], rival_piece[wins], rival_u[wins]
    return value, piece, u


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """A metric of many candidates: ``value`` (B,) with infinitesimals, NaN where there is none; ``doubtful`` (B,)."""

    value: Array
    doubtful: Array


def _readings(trace: Trace, value: Array, doubtful: Array | None = None) -> Readings:
    nothing = np.zeros(len(trace.values), dtype=bool)
    return Readings(value=value, doubtful=nothing if doubtful is None else doubtful)


def _relative(trace: Trace) -> Array:
    """Return which candidates have a final value that differs from 0."""
    return np.asarray(np.abs(trace.final.real) > NEGLIGIBLE * trace.extent)


def _absent(value: Array, there: Array) -> Array:
    return np.where(there, value, np.nan)


def _passage(trace: Trace, part: float) -> Array:
    sign = np.where(trace.final.real < 0, -1.0, 1.0)
    level = part * trace.final
    beyond = sign[:, None] * (trace.flat - level.real[:, None]) >= 0
    first = beyond.argmax(axis=1)
    reached = beyond.any(axis=1)
    instants = np.zeros(len(sign), dtype=np.result_type(trace.values, trace.width))
    rows = np.flatnonzero(reached & (first > 0))
    instants[rows] = _crossing(trace, rows, first[rows] - 1, level[rows])
    instants[~reached] = np.nan
    return instants


def rise_time(trace: Trace) -> Readings:
    """t(0.9 y∞) - t(0.1 y∞), first crossings."""
    return _readings(trace, _absent(_passage(trace, 0.9) - _passage(trace, 0.1), _relative(trace)))


def _last_entry(trace: Trace, band: float) -> Readings:
    """Return the last entry into ± band of the way around the final value."""
    batch = len(trace.values)
    size = np.abs(trace.final.real)
    half = band * size
    middle = trace.final.real
    reach = np.maximum(trace.tops - middle[:, None], middle[:, None] - trace.bottoms)
    everyone = np.arange(batch)
    pieces = reach.shape[1]
    outside = reach > half[:, None]
    last_piece = pieces - 1 - outside[:, ::-1].argmax(axis=1)
    inside = np.abs(trace.real[everyone, last_piece] - middle[:, None]) <= half[:, None]
    last = last_piece * POINTS + POINTS - 1 - (~inside[:, ::-1]).argmax(axis=1)
    last = np.where(outside.any(axis=1), last, -1)
    doubtful = last >= pieces * POINTS - 1
    last = np.minimum(last, pieces * POINTS - 2)
    # A turning point between samples may leave the band once more, or just touch it.
    later = np.where(np.arange(pieces) > last_piece[:, None], reach, 0.0)
    own = np.where(
        np.arange(POINTS) > (last % POINTS)[:, None] + 1,
        np.abs(trace.real[everyone, last_piece] - middle[:, None]),
        0.0,
    )
    later[everyone, last_piece] = own.max(axis=1)
    peak_piece = later.argmax(axis=1)
    rows = np.flatnonzero((later[everyone, peak_piece] > _GRAZING * half) & (last >= 0))
    there = np.abs(trace.real[everyone, peak_piece] - middle[:, None])
    there[peak_piece == last_piece] = own[peak_piece == last_piece]
    peak = peak_piece * POINTS + there.argmax(axis=1)
    flat = trace.flat
    entry = np.zeros(batch, dtype=np.result_type(trace.values, trace.width))
    normal = np.flatnonzero(last >= 0)
    edge = np.sign(flat[normal, last[normal]] - middle[normal])
    # The band's edge carries the infinitesimals of the final value.
    way = np.where(trace.final.real < 0, -1.0, 1.0)
    level = trace.final[normal] + edge * band * (way * trace.final)[normal]
    entry[normal] = _crossing(trace, normal, last[normal], level)
    if rows.size:
        side = np.sign(flat[rows, peak[rows]] - middle[rows])
        top, piece, u = _polished(trace, rows, peak[rows], side)
        excess = side * (top - trace.final[rows]).real - half[rows]
        doubtful[rows[np.abs(excess) <= 1e-5 * half[rows]]] = True
        out = excess > 0
        if out.any():
            again = rows[out]
            edges = trace.final[again] + side[out] * band * (way * trace.final)[again]
            entry[again] = _descent(trace, again, piece=piece[out], top=u[out], level=edges, side=side[out])
    return _readings(trace, _absent(entry, _relative(trace)), doubtful)


def _descent(trace: Trace, rows: Array, *, piece: Array, top: Array, level: Array, side: Array) -> Array:
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


def settling_time(trace: Trace) -> Readings:
    """Last entry into ±2 % of the way."""
    return _last_entry(trace, 0.02)


def response_time(trace: Trace) -> Readings:
    """Last entry into ±5 % of the way."""
    return _last_entry(trace, 0.05)


def _excess(trace: Trace, sign: float) -> Readings:
    """Return how far sign * y exceeds sign * final (sign of the way) or the start (against it), by the way."""
    way = np.where(trace.final.real < 0, -1.0, 1.0)
    best = np.empty_like(trace.final)
    for direction in (1.0, -1.0):
        those = np.flatnonzero(way == direction)
        if those.size:
            part = Trace(
                values=trace.values[those], starts=trace.starts, lengths=trace.lengths, width=trace.width[those],
                final=trace.final[those], reference=trace.reference[those],
            )  # fmt: skip
            best[those] = _largest(part, sign * direction)[0]
    there = _relative(trace)
    divisor = np.where(there, trace.final, 1.0)
    beyond = (best - trace.final) / divisor if sign > 0 else -best / divisor
    return _readings(trace, _absent(np.where(beyond.real > 1e-12, beyond, 0.0 * beyond.real), there))


def overshoot(trace: Trace) -> Readings:
    """(max y - y∞) / y∞, 0 if negative."""
    return _excess(trace, 1.0)


def undershoot(trace: Trace) -> Readings:
    """-min y / y∞, 0 if negative."""
    return _excess(trace, -1.0)


def _magnitude(trace: Trace) -> tuple[Array, Array, Array, Array]:
    """Return (largest |y|, approached only, piece, u); the final value counts where it is only approached."""
    top, top_piece, top_u = _largest(trace, 1.0)
    bottom, bottom_piece, bottom_u = _largest(trace, -1.0)
    upward = top.real >= -bottom.real
    value = np.where(upward, top, -bottom)
    limit = np.where(trace.final.real < 0, -1.0, 1.0) * trace.final
    approached = limit.real >= value.real * (1 - 1e-10)
    piece, u = np.where(upward, top_piece, bottom_piece), np.where(upward, top_u, bottom_u)
    return np.where(approached, limit, value), approached, piece, u


def peak(trace: Trace) -> Readings:
    """Return max |y|."""
    return _readings(trace, _magnitude(trace)[0])


def peak_time(trace: Trace) -> Readings:
    """Return the time of max |y|."""
    _, approached, piece, u = _magnitude(trace)
    rows = np.arange(len(piece))
    _, first, second = evaluate_polynomial(trace.polynomial(rows, piece), u.astype(trace.values.dtype))
    inside = (np.abs(u) < 1) & (second.real != 0)
    shift = np.where(inside, first / np.where(inside, second, 1.0), 0.0)
    return _readings(trace, _absent(trace.instant(rows, piece, u - shift), ~approached))


def steady_state_error(trace: Trace) -> Readings:
    """Return r - y∞."""
    return _readings(trace, trace.reference - trace.final)


def _integrable(trace: Trace) -> Array:
    """Return whose error goes to zero."""
    error = trace.reference - trace.final
    size = np.abs(trace.reference.real[:, None] - trace.flat).max(axis=1)
    return np.asarray(np.abs(error.real) <= NEGLIGIBLE * size)


def ise(trace: Trace) -> Readings:
    """∫e²: the square has twice the degree, so it is integrated on its own samples by Gauss's rule."""
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    to_gauss = np.polynomial.polynomial.polyvander(points, POINTS - 1) @ TO_POLYNOMIAL
    error = (trace.reference[:, None, None] - trace.values) @ to_gauss.T
    value = ((error * error) @ (weights / 2)) @ trace.lengths * trace.width
    return _readings(trace, _absent(value, _integrable(trace)))


def _absolute(trace: Trace, power: int) -> Readings:
    """∫ t^power |e| dt, split where e changes its sign."""
    error = trace.reference[:, None, None] - trace.values
    rows, piece = np.divmod(np.arange(error.shape[0] * error.shape[1]), error.shape[1])
    coefficients = error.reshape(-1, POINTS) @ TO_POLYNOMIAL.T
    if power:
        # t = (start + length (u + 1) / 2) width
        start, half = trace.starts[piece] + trace.lengths[piece] / 2, trace.lengths[piece] / 2
        widened = np.pad(coefficients, ((0, 0), (0, 1)))
        weighted = trace.width[rows, None] * (start[:, None] * widened + half[:, None] * np.roll(widened, 1, axis=1))
    else:
        weighted = coefficients
    order = np.arange(1, weighted.shape[1] + 1)
    integral = np.concatenate([np.zeros((len(weighted), 1)), weighted / order], axis=1)
    integral[:, 0] = -evaluate_polynomial(integral, np.full(len(integral), -1.0))[0]
    samples = error.real.reshape(-1, POINTS)
    signs = np.where(samples < 0, -1.0, 1.0)
    total = signs[:, -1] * evaluate_polynomial(integral, np.ones(len(integral)))[0]
    where, place = np.nonzero(signs[:, 1:] != signs[:, :-1])
    if where.size:
        real = coefficients[where].real
        grid = 2 * GRID - 1
        low, high = grid[place], grid[place + 1]
        before = signs[where, place]
        u = _root(real, low, high, -before)
        np.add.at(total, where, 2 * before * evaluate_polynomial(integral[where], u)[0])
    scaled = total * trace.width[rows] * trace.lengths[piece] / 2
    value = scaled.reshape(error.shape[:2]).sum(axis=1)
    return _readings(trace, _absent(value, _integrable(trace)))


def iae(trace: Trace) -> Readings:
    """∫|e|."""
    return _absolute(trace, 0)


def itae(trace: Trace) -> Readings:
    """∫t|e|."""
    return _absolute(trace, 1)


METRICS: Mapping[str, Callable[[Trace], Readings]] = MappingProxyType(
    {
        "rise_time": rise_time,
        "settling_time": settling_time,
        "response_time": response_time,
        "overshoot": overshoot,
        "undershoot": undershoot,
        "peak": peak,
        "peak_time": peak_time,
        "max_velocity": peak,
        "max_acceleration": peak,
        "control_effort": peak,
        "steady_state_error": steady_state_error,
        "iae": iae,
        "ise": ise,
        "itae": itae,
    }
)
"""What screening can read off a step response; everything else belongs to the exact path."""
