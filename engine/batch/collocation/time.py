"""Metrics of many step responses at once, read off the crossings and turning points of `screening_trace`.

Values carry their infinitesimals, so a metric's derivative comes out of the same lines.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from engine.batch.collocation.march import GRID, POINTS, TO_POLYNOMIAL
from engine.batch.collocation.trace import Trace, crossing, descent, evaluate_polynomial, largest, polished, root
from engine.model.linear_system import Array

NEGLIGIBLE = 1e-9
"""A difference below this part of the signal is not a difference."""
_GRAZING = 0.95
"""A later turning point whose sample reaches this part of the band is looked at closely."""


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
    instants[rows] = crossing(trace, rows, first[rows] - 1, level[rows])
    instants[~reached] = np.nan
    return instants


def rise_time(trace: Trace) -> Readings:
    """t(0.9 y∞) - t(0.1 y∞), first crossings."""
    return _readings(trace, _absent(_passage(trace, 0.9) - _passage(trace, 0.1), _relative(trace)))


def last_entry(trace: Trace, band: float) -> Readings:
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
    entry[normal] = crossing(trace, normal, last[normal], level)
    if rows.size:
        side = np.sign(flat[rows, peak[rows]] - middle[rows])
        top, piece, u = polished(trace, rows, peak[rows], side)
        excess = side * (top - trace.final[rows]).real - half[rows]
        doubtful[rows[np.abs(excess) <= 1e-5 * half[rows]]] = True
        out = excess > 0
        if out.any():
            again = rows[out]
            edges = trace.final[again] + side[out] * band * (way * trace.final)[again]
            entry[again] = descent(trace, again, piece=piece[out], top=u[out], level=edges, side=side[out])
    return _readings(trace, _absent(entry, _relative(trace)), doubtful)


def settling_time(trace: Trace) -> Readings:
    """Last entry into ±2 % of the way."""
    return last_entry(trace, 0.02)


def response_time(trace: Trace) -> Readings:
    """Last entry into ±5 % of the way."""
    return last_entry(trace, 0.05)


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
            best[those] = largest(part, sign * direction)[0]
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
    top, top_piece, top_u = largest(trace, 1.0)
    bottom, bottom_piece, bottom_u = largest(trace, -1.0)
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
        u = root(real, low, high, -before)
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
