"""Many candidates against bounds at once: envelopes and references over time, ratios to bounds over frequency.

Over time a bound is a straight line between two instants: the excess over it is a polynomial on every piece of a response, its
greatest value lies at a turning point or at an end of the line. Over frequency a bound bends at its corners, which are looked
at besides the summit that the scan brackets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from engine.batch.collocation.frequency import solved
from engine.batch.collocation.march import GRID, POINTS
from engine.batch.collocation.scan import Path, Scan
from engine.batch.collocation.time import Readings
from engine.batch.collocation.trace import Trace, evaluate_polynomial
from engine.model.linear_system import Array
from engine.model.masks import Envelope, FrequencyBounds, Magnitude, Mask, Polyline, Segment

_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_STEPS = 8
_OUTSIDE = -1.0
"""Below every ratio."""


def envelope(trace: Trace, mask: Mask, start: float) -> Readings:
    """1 + worst excess over an envelope, for a command that begins at ``start`` (s)."""
    assert isinstance(mask, Envelope)
    worst: Array | None = None
    for line, sign in mask.sides:
        for part in line.segments:
            highest = _highest(trace, _Over(part, sign, start))
            worst = highest if worst is None else np.where(highest.real > worst.real, highest, worst)
    assert worst is not None
    return _certain(1 + worst / mask.unit)


def tracking_error(trace: Trace, mask: Mask, start: float) -> Readings:
    """Root of the mean square of y - r, for a command that begins at ``start`` (s)."""
    assert isinstance(mask, Polyline)
    total = np.zeros(len(trace.values), dtype=np.result_type(trace.values, trace.width))
    for part in mask.segments:
        total = total + _squares(trace, part, start)
    span = sum(part.end - part.start for part in mask.segments)
    return _certain(np.sqrt(total / span))


def _certain(value: Array) -> Readings:
    return Readings(value=value, doubtful=~np.isfinite(value.real))


@dataclass(frozen=True, slots=True)
class _Over:
    """One straight line, the side of it that counts, and when the command begins (s)."""

    part: Segment
    sign: float
    start: float

    def excess(self, y: Array | float, time: Array | float) -> Array:
        """Return sign (y - line) at instants."""
        return np.asarray(self.sign * (y - _line(self.part, time)))


def _line(part: Segment, time: Array | float) -> Array:
    return np.asarray(part.value + part.slope * (time - part.start))


def _end(trace: Trace, start: float) -> Array:
    """Return when each response has come to rest, s."""
    return np.asarray(start + trace.width.real * (trace.starts[-1] + trace.lengths[-1]))


def _highest(trace: Trace, over: _Over) -> Array:
    """Return the greatest excess over one line, (B,)."""
    part, start = over.part, over.start
    first, last = (_excess_at(trace, over, t) for t in (part.start, part.end))
    best = np.where(first.real >= last.real, first, last)
    if part.start < start:  # at rest before the command
        ends = max(float(over.excess(0.0, t)) for t in (part.start, min(part.end, start)))
        best = np.where(best.real >= ends, best, ends)
    grid = (trace.starts[:, None] + trace.lengths[:, None] * GRID).ravel()
    time = start + trace.width.real[:, None] * grid
    inside = (time >= part.start) & (time <= part.end)
    heights = np.where(inside, over.excess(trace.flat, time), -np.inf)
    rows = np.flatnonzero(inside.any(axis=1))
    if rows.size:
        value = _summit(trace, rows, heights[rows].argmax(axis=1), over)
        best = best.astype(np.result_type(best, value))
        best[rows] = np.where(value.real > best[rows].real, value, best[rows])
    return best


def _summit(trace: Trace, rows: Array, sample: Array, over: _Over) -> Array:
    """Return the greatest excess beside samples, on the polynomial of their piece."""
    piece, place = sample // POINTS, sample % POINTS
    width = trace.width[rows].real
    rate = width * trace.lengths[piece] / 2  # seconds for each unit of u
    middle = over.start + width * (trace.starts[piece] + trace.lengths[piece] / 2)
    coefficients = over.sign * trace.polynomial(rows, piece).real
    coefficients[:, 0] -= over.sign * _line(over.part, middle)
    coefficients[:, 1] -= over.sign * over.part.slope * rate
    grid = 2 * GRID - 1
    low = np.maximum(grid[np.maximum(place - 1, 0)], (over.part.start - middle) / rate)
    high = np.minimum(grid[np.minimum(place + 1, POINTS - 1)], (over.part.end - middle) / rate)
    here = np.clip(grid[place], low, high)
    u = here
    for _ in range(_STEPS):
        _, slope, bend = evaluate_polynomial(coefficients, u)
        u = np.clip(np.where(bend < 0, u - slope / np.where(bend < 0, bend, -1.0), u), low, high)
    u = np.where(evaluate_polynomial(coefficients, u)[0] >= evaluate_polynomial(coefficients, here)[0], u, here)
    time = middle + rate * u
    return over.excess(_value_at(trace, rows, piece, time - over.start), time)


def _excess_at(trace: Trace, over: _Over, time: float) -> Array:
    """Return the excess at one instant, (B,)."""
    rows = np.arange(len(trace.values))
    local = np.clip((time - over.start) / trace.width.real, 0.0, None)
    piece = np.clip(np.searchsorted(trace.starts, local, side="right") - 1, 0, len(trace.starts) - 1)
    y = _value_at(trace, rows, piece, np.full(len(rows), time - over.start))
    y = np.where(time >= _end(trace, over.start), trace.final, y)
    return over.excess(np.where(time < over.start, 0.0, y), time)


def _value_at(trace: Trace, rows: Array, piece: Array, since: Array) -> Array:
    """Return y at fixed instants since the command: the place on the piece moves with its width."""
    u = 2 * (since / trace.width[rows] - trace.starts[piece]) / trace.lengths[piece] - 1
    return evaluate_polynomial(trace.polynomial(rows, piece), u)[0]


def _squares(trace: Trace, part: Segment, start: float) -> Array:
    """Return ∫ (y - line)² over one line, (B,)."""
    total = np.zeros(len(trace.values), dtype=np.result_type(trace.values, trace.width))
    if part.start < start:  # at rest before the command
        a, b = _line(part, part.start), _line(part, min(part.end, start))
        total = total + (min(part.end, start) - part.start) * (a * a + a * b + b * b) / 3
    begin, finish = (max(t - start, 0.0) / trace.width for t in (part.start, part.end))
    for k in range(len(trace.starts)):
        low, high = trace.starts[k], trace.starts[k] + trace.lengths[k]
        first = np.where(begin.real > low, begin, low)
        last = np.where(finish.real < high, finish, high)
        rows = np.flatnonzero(last.real > first.real)
        if rows.size:
            place = 0.5 * (first + last)[rows, None] + 0.5 * (last - first)[rows, None] * _GAUSS
            u = 2 * (place - low) / trace.lengths[k] - 1
            y = _many(trace.polynomial(rows, np.full(len(rows), k)), u)
            away = y - _line(part, start + trace.width[rows, None] * place)
            total[rows] += 0.5 * (last - first)[rows] * trace.width[rows] * ((away * away) @ _WEIGHTS)
    rest = np.maximum(_end(trace, start), max(part.start, start))
    after = rest < part.end
    a, b = trace.final - _line(part, rest), trace.final - _line(part, part.end)
    return np.asarray(total + np.where(after, (part.end - rest) * (a * a + a * b + b * b) / 3, 0.0))


def _many(coefficients: Array, u: Array) -> Array:
    """Return polynomials (k, degree + 1) at places (k, q)."""
    value = np.zeros(u.shape, dtype=np.result_type(coefficients, u)) + coefficients[:, -1:]
    for k in range(coefficients.shape[1] - 2, -1, -1):
        value = value * u + coefficients[:, k : k + 1]
    return value


@dataclass(frozen=True, slots=True)
class Quantity:
    """What of a gain G is bounded, and its derivative by G."""

    shape: Callable[[Array], Array]
    slope: Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class _Height:
    """The ratio of a quantity to one bound, nothing outside the span of the bound."""

    quantity: Quantity
    line: Magnitude
    power: float

    def __call__(self, g: Array, omega: Array) -> Array:
        low, high = self.line.span
        inside = (omega >= low) & (omega <= high)
        with np.errstate(all="ignore"):
            bound = self.line(np.where(inside, omega, max(low, 1e-300)))
            ratio = (np.abs(self.quantity.shape(g)) / bound) ** self.power
        return np.where(inside, ratio, _OUTSIDE)


def ratio(path: Path, scan: Scan, mask: Mask, quantity: Quantity) -> Readings:
    """Return the worst ratio of a quantity to its bounds."""
    assert isinstance(mask, FrequencyBounds)
    everyone = np.arange(path.batch)
    worst: Array | None = None
    for line, power in mask.sides:
        height = _Height(quantity, line, power)
        omega = scan.peak(height)
        top = height(scan.at(everyone, omega[:, None]), omega[:, None])[:, 0]
        marks = np.array([corner for corner in line.corners if corner > 0])
        if marks.size:
            at = np.broadcast_to(marks, (path.batch, marks.size))
            beside = np.nan_to_num(height(scan.at(everyone, at), at), nan=np.inf)
            best = beside.argmax(axis=1)
            omega = np.where(beside[everyone, best] > top, marks[best], omega)
        g, tangent, _ = solved(path, everyone, omega)
        shaped = quantity.shape(g)
        size = np.abs(shaped)
        moved = (np.conj(shaped) * quantity.slope(g) * tangent).real / np.where(size > 0, size, 1.0)
        with np.errstate(all="ignore"):
            here = ((size + 1j * moved) / line(omega)) ** power
        worst = here if worst is None else np.where(here.real > worst.real, here, worst)
    assert worst is not None
    return Readings(value=worst, doubtful=~np.isfinite(worst.real))


_GAIN = Quantity(lambda g: g, np.ones_like)
_ERROR = Quantity(lambda g: 1 - g, lambda g: -np.ones_like(g))
_SENSITIVITY = Quantity(lambda g: 1 / (1 + g), lambda g: -1 / (1 + g) ** 2)
_COMPLEMENTARY = Quantity(lambda g: g / (1 + g), lambda g: 1 / (1 + g) ** 2)

TIME_MASKS: Mapping[str, Callable[[Trace, Mask, float], Readings]] = MappingProxyType(
    {"envelope": envelope, "tracking_error": tracking_error}
)
"""What screening can hold a step response against."""
PATH_MASKS: Mapping[str, Quantity] = MappingProxyType({"path_bound": _GAIN, "error_bound": _ERROR})
LOOP_MASKS: Mapping[str, Quantity] = MappingProxyType(
    {"sensitivity_bound": _SENSITIVITY, "complementary_bound": _COMPLEMENTARY, "loop_bound": _GAIN}
)
"""What screening can bound of paths and loops."""
