"""How near a gain comes to its bounds over frequency: the worst ratio, found on the response itself.

    max over ω of |q| / u  and  l / |q|,   met at 1

The scan brackets; inside its bracket the summit is found on q(jω) itself. A bound bends at its corners, so they are looked
at one by one; at both ends of a bound that has none the limits count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from engine.metrics._base import Absent, Found, unclosed, unsettled
from engine.model.masks import FrequencyBounds, Magnitude
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.frequency.response import FrequencyResponse
    from engine.exact.frequency.shapes import Shape
    from engine.metrics._base import Finding, LoopSubject, PathSubject
    from engine.model.linear_system import Array
    from engine.model.masks import Real

_INFINITE, _DIVERGED = 1e100, 1e90
"""Stands for the infinite gain of an integrator at rest, and what of it is left in a ratio."""

_BESIDE = 1e-12

_NEAR_THE_TOP = 0.98
"""Summits that the scan, straight to one percent, shows below this part of the highest cannot be it."""


def path_ratio(subject: PathSubject, square: Shape) -> Finding:
    """Return the worst ratio of a path's gain, of which ``square`` is the square, to its bounds."""
    if subject.verdict is Verdict.UNSTABLE:
        refusal = unsettled(subject.verdict)
        assert refusal is not None
        return refusal
    assert isinstance(subject.mask, FrequencyBounds)
    return _worst(subject.response, square, subject.mask, static=subject.static)


def loop_ratio(subject: LoopSubject, square: Shape) -> Finding:
    """Return the worst ratio of a gain of the loop, of which ``square`` is the square, to its bounds."""
    refusal = unclosed(subject)
    if refusal is not None:
        return refusal
    assert isinstance(subject.mask, FrequencyBounds)
    return _worst(subject.response, square, subject.mask, static=subject.static)


def _worst(response: FrequencyResponse, square: Shape, bounds: FrequencyBounds, *, static: Array | None) -> Finding:
    best: tuple[float, float, Magnitude, float] | None = None
    for bound, power in bounds.sides:
        height, at = _highest(response, square, bound, power)
        if best is None or height > best[0]:
            best = height, at, bound, power
    limit = _limits(response, square, bounds, static)
    assert best is not None
    if limit is not None and float(limit[0][0].real) >= best[0] * (1 - 1e-12):
        return _found(*limit)
    _, at, bound, power = best
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt(response.shape(square, np.asarray(at))) / float(bound(np.array([at]))[0])
        return _found(ratio if power > 0 else 1 / ratio, at)


def _found(value: Array, at: float | None) -> Finding:
    if not value[0].real < _DIVERGED:
        return Absent(
            verdict=Verdict.DIVERGES,
            advice="the gain is infinite, or 0 where it must not be, at a frequency within the bounds",
        )
    return Found(value=value, at=at)


def _highest(response: FrequencyResponse, square: Shape, bound: Magnitude, power: float) -> tuple[float, float]:
    """Return the worst ratio to one bound and its frequency (rad/s)."""

    def height(omega: Real) -> Real:
        g = response(omega)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            ratio = np.sqrt(square(g.real, g.imag)) / bound(omega)
            return np.asarray(ratio if power > 0 else 1 / ratio)

    scan, _ = response.scan
    low, high = bound.span
    inside = scan[(scan >= low) & (scan <= high)]
    marks = np.array([corner for corner in bound.corners if corner > 0])
    omega = np.unique(np.concatenate([inside, marks, _between(scan, low, high)]))
    heights = height(omega)
    # an infinite gain is no height to be compared: it is the answer
    if not np.isfinite(heights).all():
        place = int(np.flatnonzero(~np.isfinite(heights))[0])
        return np.inf, float(omega[place])
    place = int(heights.argmax())
    best = float(heights[place]), float(omega[place])
    summits = np.flatnonzero((heights[1:-1] >= heights[:-2]) & (heights[1:-1] >= heights[2:])) + 1
    for k in summits[heights[summits] >= _NEAR_THE_TOP * best[0]]:
        # at a bend of the bound there are two sides, each of them smooth
        for a, b in [(k - 1, k), (k, k + 1)] if omega[k] in marks else [(k - 1, k + 1)]:
            top = _summit(response, square, bound, float(omega[a]), float(omega[b]))
            if top is not None:
                best = max(best, (float(height(np.array([top]))[0]), top))
    return best


def _summit(response: FrequencyResponse, square: Shape, bound: Magnitude, low: float, high: float) -> float | None:
    """Return where the ratio is stationary between two frequencies, None where it is not."""
    from scipy.optimize import brentq  # noqa: PLC0415 - a fifth of a second

    def tilt(omega: float) -> float:
        at = np.array([omega])
        g = response(at)
        size = float(square(g.real, g.imag)[0])
        return omega * float(response.slope(square, at)[0]) / (2 * size) - bound.steepness(omega)

    low, high = low * (1 + _BESIDE), high * (1 - _BESIDE)  # on a bend itself there are two slopes
    if not low < high:
        return None
    first, last = tilt(low), tilt(high)
    if not (np.isfinite(first) and np.isfinite(last)) or (first < 0) == (last < 0):
        return None
    return float(brentq(tilt, low, high, xtol=1e-15 * low, rtol=1e-15))


def _between(scan: Real, low: float, high: float) -> Real:
    """Return points from a bound's ends to where the scan begins and ends."""
    points = [np.zeros(0)]
    if 0 < low < scan[0]:
        points.append(np.geomspace(low, min(scan[0], high), 50))
    if scan[-1] < high < np.inf:
        points.append(np.geomspace(max(scan[-1], low), high, 50))
    return np.concatenate(points)


def _limits(
    response: FrequencyResponse, square: Shape, bounds: FrequencyBounds, static: Array | None
) -> tuple[Array, float | None] | None:
    """Return the worst ratio at rest and at infinite frequency, for bounds that reach there."""
    found: list[tuple[Array, float | None]] = []
    at_rest = np.full(1, _INFINITE) if static is None else static
    for bound, power in bounds.sides:
        low, high = bound.span
        if low == 0.0:
            found.append((_ratio(square, at_rest, bound.ends[0], power), 0.0))
        if np.isinf(high) and not response.system.m:
            found.append((_ratio(square, response.direct, bound.ends[1], power), None))
    found = [one for one in found if not np.isnan(one[0][0].real)]
    return max(found, key=lambda one: float(one[0][0].real)) if found else None


def _ratio(square: Shape, gain: Array, bound: float, power: float) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt(square(gain, np.zeros(1))) / bound
        return np.asarray(ratio if power > 0 else 1 / ratio)
