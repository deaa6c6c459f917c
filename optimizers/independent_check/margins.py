"""What is read off gains over frequency: peaks, margins, bandwidth and ratios to bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optimizers.independent_check.sweep import Complex, Height, Sweep

if TYPE_CHECKING:
    from engine.model.masks import FrequencyBounds, Magnitude
    from optimizers.independent_check.march import Real

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_QUIET = 1e-9
"""Crossings of a loop gain below this do not count."""


def _size(g: Complex, _w: Real) -> Real:
    return np.asarray(np.abs(g))


def _sensitivity(g: Complex, _w: Real) -> Real:
    return np.asarray(np.abs(1 / (1 + g)))


def _complementary(g: Complex, _w: Real) -> Real:
    return np.asarray(np.abs(g / (1 + g)))


def _error(g: Complex, _w: Real) -> Real:
    return np.asarray(np.abs(1 - g))


PEAKS: dict[str, Height] = {
    "sensitivity_peak": _sensitivity,
    "complementary_peak": _complementary,
    "control_sensitivity_peak": _size,
    "compliance_peak": _size,
    "resonance_peak": _size,
}
BOUNDED: dict[str, Height] = {
    "sensitivity_bound": _sensitivity,
    "complementary_bound": _complementary,
    "loop_bound": _size,
    "path_bound": _size,
    "error_bound": _error,
}


def ratio(sweep: Sweep, quantity: Height, bounds: FrequencyBounds) -> float:
    """Return the worst ratio of a quantity to its bounds."""
    worst = -np.inf
    for line, power in bounds.sides:
        marks = np.array([corner for corner in line.corners if corner > 0])
        low, high = line.span
        ends = np.array([x for x in (low, high) if 0 < x < np.inf])

        worst = max(worst, sweep.highest(_ratio(quantity, line, power), np.concatenate([marks, ends]), line.span))
    return worst


def _ratio(quantity: Height, line: Magnitude, power: float) -> Height:
    def height(g: Complex, w: Real) -> Real:
        return np.asarray((quantity(g, w) / line(w)) ** power)

    return height


def h2_norm(sweep: Sweep) -> float:
    """Return √((1/π) ∫ |G|² dω), by Gauss in each interval of ln ω; below all corners |G| stands, above it falls with 1/ω."""
    w = sweep.frequencies
    middles, halves = 0.5 * np.log(w[1:] * w[:-1]), 0.5 * np.log(w[1:] / w[:-1])
    places = np.exp(middles[:, None] + halves[:, None] * _POINTS)
    sizes = np.abs(sweep(places.ravel()).reshape(places.shape)) ** 2
    ends = np.abs(sweep.gains[[0, -1]]) ** 2 * w[[0, -1]]
    return float(np.sqrt((halves @ ((sizes * places) @ _WEIGHTS) + ends.sum()) / np.pi))


def bandwidth(sweep: Sweep) -> float:
    """Return the first frequency at which the gain has fallen by 3 dB."""
    rest = abs(sweep(np.array([1e-7 * sweep.frequencies[0]]))[0])
    level = rest * 10 ** (-3 / 20)
    return min(sweep.crossings(lambda g, _: np.abs(g) - level), default=np.inf)


def _gain_margins(sweep: Sweep) -> list[float]:
    """Return every factor that brings L through -1."""
    places = sweep.crossings(lambda g, _: g.imag)
    gains = [sweep(np.array([w]))[0].real for w in places]
    margins = [-1 / g for g in gains if g < -_QUIET]
    first, last = sweep.frequencies[[0, -1]]
    for inside, end in ((first, first / 10), (last, 10 * last)):
        near, limit = sweep(np.array([inside, end]))
        if limit.real < -_QUIET and abs(limit - near) < 1e-3 * abs(near):
            margins.append(float(-1 / limit.real))  # finite and negative at an end of the axis
    return [float(margin) for margin in margins]


def gain_margin(sweep: Sweep) -> float:
    """Return the factor nearest to 1, on a logarithmic scale, that brings L through -1."""
    return min(_gain_margins(sweep), key=lambda margin: abs(np.log(margin)), default=np.inf)


def gain_margin_up(sweep: Sweep) -> float:
    """Return the least factor above 1 that brings L through -1."""
    return min((margin for margin in _gain_margins(sweep) if margin >= 1), default=np.inf)


def gain_margin_down(sweep: Sweep) -> float:
    """Return the largest factor below 1 that brings L through -1."""
    return max((margin for margin in _gain_margins(sweep) if margin <= 1), default=0.0)


def disk_margin(sweep: Sweep) -> float:
    """Return 1 / max |S - 1/2|; where L vanishes or is infinite, at an end of the axis, that is 2."""
    return 1 / sweep.highest(lambda g, _: np.asarray(np.abs(0.5 * (1 - g) / (1 + g))))


def _phases(sweep: Sweep) -> list[tuple[float, float]]:
    places = sweep.crossings(lambda g, _: np.abs(g) - 1)
    return [(w, float(np.angle(-sweep(np.array([w]))[0]))) for w in places]


def phase_margin(sweep: Sweep) -> float:
    """Return the angle that is nearest to 0."""
    return min((angle for _, angle in _phases(sweep)), key=abs, default=np.inf)


def delay_margin(sweep: Sweep) -> float:
    """Return the least delay that brings L through -1."""
    return min(((angle if angle >= -1e-12 else angle + 2 * np.pi) / w for w, angle in _phases(sweep)), default=np.inf)


def damping_ratio(modes: Complex) -> float:
    """Return the least -Re p / |p| of modes that all decay."""
    return float((-modes.real / np.abs(modes)).min(initial=np.inf))


def spectral_abscissa(modes: Complex) -> float:
    """Return the largest real part."""
    return float(modes.real.max())


def critical_frequency(modes: Complex) -> float:
    """Return |p| of the complex pair that decays last."""
    pairs = _pairs(modes)
    return float(np.abs(pairs[pairs.real.argmax()]))


def _pairs(modes: Complex) -> Complex:
    pairs = modes[modes.imag > 1e-9 * np.abs(modes)]
    if not len(pairs):
        raise ValueError("no mode oscillates")
    return pairs
