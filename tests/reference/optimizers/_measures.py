"""Metrics of a unity loop from its polynomials: with numpy alone for a search, with python-control for a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import control
import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import expm
from scipy.optimize import brentq

_COARSE, _FINE = 0.15, 0.05
"""Step of a response in units of the fastest mode that is still there: in a search, and for a verdict."""
_GONE = 25.0
"""Time constants after which a mode has gone."""
_BANDS = {"settling_time": 0.02, "response_time": 0.05}


@dataclass(frozen=True, kw_only=True)
class Loop:
    """r -> C -> P -> y with unity negative feedback; ``exact`` measures with python-control.

    ``lenient`` widens the band of a time to settle by that part: beside a jump of such a time both of its values count.
    """

    controller: tuple[np.ndarray, np.ndarray]
    plant: tuple[np.ndarray, np.ndarray]
    exact: bool = False
    lenient: float = 0.0

    @cached_property
    def open(self) -> tuple[np.ndarray, np.ndarray]:
        """Return numerator and denominator of L = C P."""
        return np.convolve(self.controller[0], self.plant[0]), np.convolve(self.controller[1], self.plant[1])

    @cached_property
    def closed(self) -> np.ndarray:
        """Return the characteristic polynomial."""
        return np.polyadd(*self.open)

    @cached_property
    def poles(self) -> np.ndarray:
        """Return the closed loop's."""
        if self.exact:
            return control.feedback(control.tf(*self.open), 1).poles()
        return np.roots(self.closed)

    def measure(self, metric: str) -> float:
        """Return a metric of the loop as goals compare it; NaN where it is not stable, infinite where never crossed."""
        poles = self.poles
        if poles.real.max() >= -1e-9 * np.abs(poles).max():
            return math.nan
        if metric == "damping_ratio":
            return float((-poles.real / np.abs(poles)).min())
        if metric in {"gain_margin", "phase_margin"}:
            gains, phases = self._margins()
            distances = np.exp(np.abs(np.log(gains))) if metric == "gain_margin" else np.abs(phases)
            return float(distances.min(initial=math.inf))
        if metric in {"sensitivity_peak", "bandwidth"}:
            return self._peak_of_sensitivity(poles) if metric == "sensitivity_peak" else self._bandwidth(poles)
        return self._of_a_step(metric)

    def _of_a_step(self, metric: str) -> float:
        numerator = np.convolve(self.controller[0], self.plant[1]) if metric == "control_effort" else self.open[0]
        times, values, slopes, final = self._step(numerator, self.poles)
        if metric == "control_effort":
            return float(np.abs(values).max())
        if metric == "overshoot":
            return max(float((values / final).max()) - 1.0, 0.0)
        return _last_entry(times, values / final - 1.0, slopes / final, _BANDS[metric] * (1.0 + self.lenient))

    def _margins(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the factors of the gain, and the phases (rad, in (-π, π]), that bring the loop to its limit."""
        if self.exact:
            gains, degrees, *_ = control.stability_margins(control.tf(*self.open), returnall=True)
            phases = np.radians((np.asarray(degrees) + 180.0) % 360.0 - 180.0)
            gains = np.asarray(gains)
            return gains[np.isfinite(gains) & (gains > 0)], phases
        numerator, denominator = (_on_the_axis(one) for one in self.open)
        turned = np.convolve(numerator, np.conj(denominator))
        across = _positive(np.imag(turned))
        cut = np.polyval(numerator, across) / np.polyval(denominator, across)
        unity = _positive(
            np.real(
                np.polysub(np.convolve(numerator, np.conj(numerator)), np.convolve(denominator, np.conj(denominator)))
            )
        )
        phases = np.angle(-np.polyval(numerator, unity) / np.polyval(denominator, unity))
        static = np.polyval(numerator, 0.0).real, np.polyval(denominator, 0.0).real
        gains = [-1.0 / value for value in cut.real if value < 0]
        if static[1] != 0 and static[0] / static[1] < 0:
            gains.append(-static[1] / static[0])
        return np.array(gains), phases

    def _response(self, numerator: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """Return numerator / (characteristic polynomial) over frequency."""
        if self.exact:
            return control.tf(numerator, self.closed)(1j * omega)
        return np.polyval(numerator, 1j * omega) / np.polyval(self.closed, 1j * omega)

    def _frequencies(self, poles: np.ndarray) -> np.ndarray:
        sizes = np.concatenate([np.abs(poles), np.abs(np.roots(self.open[1])), np.abs(np.roots(self.open[0]))])
        sizes = sizes[sizes > 0]
        grid = np.geomspace(sizes.min() / 1e3, sizes.max() * 1e3, 20_000 if self.exact else 1500)
        near = [np.abs(p.imag) + p.real * np.linspace(-3, 3, 41) for p in poles if p.imag > 0]  # narrow peaks
        return np.unique(np.concatenate([grid, *[one[one > 0] for one in near]]))

    def _peak_of_sensitivity(self, poles: np.ndarray) -> float:
        numerator, omega = self.open[1], self._frequencies(poles)
        found = np.abs(self._response(numerator, omega))
        for _ in range(3):
            at = int(found.argmax())
            omega = np.linspace(omega[max(at - 1, 0)], omega[min(at + 1, len(omega) - 1)], 41)
            found = np.abs(self._response(numerator, omega))
        far = abs(numerator[0] / self.closed[0]) if len(numerator) == len(self.closed) else 0.0
        return max(float(found.max()), far)

    def _bandwidth(self, poles: np.ndarray) -> float:
        numerator, omega = self.open[0], self._frequencies(poles)
        limit = 10 ** (-3 / 20) * abs(numerator[-1] / self.closed[-1])
        for _ in range(5):
            below = np.flatnonzero(np.abs(self._response(numerator, omega)) < limit)
            if not len(below):
                return math.inf
            omega = np.linspace(omega[max(below[0] - 1, 0)], omega[below[0]], 41)
        return float(omega[-1])

    def _step(self, numerator: np.ndarray, poles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Return times, values and slopes of a unit step's response, turning points included, and its end."""
        scale = float(np.exp(np.log(np.abs(poles)).mean()))  # time in its own unit
        powers = scale ** np.arange(len(self.closed))[::-1]
        denominator = self.closed * powers
        numerator = np.pad(numerator, (len(self.closed) - len(numerator), 0)) * powers
        a, b, c, d = _companion(numerator / denominator[0], denominator / denominator[0])
        times, states = self._states(a, b, poles / scale)
        values, slopes = (c @ states)[0] + d, (c @ (a @ states + b))[0]
        between, turned = _turning(times, values, slopes)
        order = np.argsort(np.concatenate([times, between]), kind="stable")
        times, values = np.concatenate([times, between])[order] / scale, np.concatenate([values, turned])[order]
        slopes = np.concatenate([slopes * scale, np.zeros_like(between)])[order]
        return times, values, slopes, float(numerator[-1] / denominator[-1])

    def _states(self, a: np.ndarray, b: np.ndarray, poles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return times (T,) and states (n, T) under a unit step: when a mode has gone, the steps are those of the slower ones."""
        poles = poles[np.argsort(poles.real)]
        ends = _GONE / -poles.real
        times, states, start = [np.zeros(1)], [np.zeros((len(a), 1))], 0.0
        for k, end in enumerate(ends):
            if end <= start * (1.0 + 1e-9):
                continue
            step = (_FINE if self.exact else _COARSE) / np.abs(poles[k:]).max()
            local = np.linspace(0.0, end - start, min(int((end - start) / step), 50_000) + 2)
            if self.exact:
                system = control.ss(a, b, np.zeros((1, len(a))), 0.0)
                found = control.forced_response(system, local, np.ones_like(local), states[-1][:, -1], return_x=True)[2]
            else:
                found = _driven(a, b, local, states[-1][:, -1])
            times.append(start + local[1:])
            states.append(found[:, 1:])
            start = end
        return np.concatenate(times), np.hstack(states)


def _on_the_axis(polynomial: np.ndarray) -> np.ndarray:
    """Return the polynomial in ω for s = jω."""
    return polynomial * 1j ** np.arange(len(polynomial))[::-1]


def _positive(polynomial: np.ndarray) -> np.ndarray:
    roots = np.roots(polynomial)
    return roots.real[(roots.real > 0) & (np.abs(roots.imag) < 1e-9 * np.abs(roots))]


def _companion(numerator: np.ndarray, denominator: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the controllable canonical form of polynomials of equal length, the denominator's first number 1."""
    n = len(denominator) - 1
    a, b = np.eye(n, k=-1), np.zeros((n, 1))
    a[0], b[0] = -denominator[1:], 1.0
    return a, b, (numerator[1:] - numerator[0] * denominator[1:])[None], float(numerator[0])


def _driven(a: np.ndarray, b: np.ndarray, times: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return the states (n, T) under a unit step: the first 1, 2, 4, … instants give as many more."""
    n = len(a)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = a, b
    power = expm(whole * (times[1] - times[0]))
    found = np.append(first, 1.0)[:, None]
    while found.shape[1] < len(times):
        found, power = np.hstack([found, power @ found]), power @ power
    return found[:n, : len(times)]


def _turning(times: np.ndarray, values: np.ndarray, slopes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the extremes of the cubic between two instants wherever the slope changes its sign."""
    at = np.flatnonzero(slopes[:-1] * slopes[1:] < 0)
    h, y0, y1 = times[at + 1] - times[at], values[at], values[at + 1]
    m0, m1 = slopes[at] * h, slopes[at + 1] * h
    a, b = 2 * y0 - 2 * y1 + m0 + m1, -3 * y0 + 3 * y1 - 2 * m0 - m1
    low, high = np.zeros_like(h), np.ones_like(h)
    for _ in range(50):
        middle = (low + high) / 2
        same = (3 * a * middle**2 + 2 * b * middle + m0) * m0 > 0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return times[at] + low * h, ((a * low + b) * low + m0) * low + y0


def _last_entry(times: np.ndarray, errors: np.ndarray, slopes: np.ndarray, band: float) -> float:
    """Return when the error is within the band for good, on the cubic between two instants."""
    out = np.flatnonzero(np.abs(errors) > band)
    if not len(out):
        return 0.0
    last = int(out[-1])
    if last + 1 == len(times):
        return math.nan
    course = CubicHermiteSpline(times[last : last + 2], errors[last : last + 2], slopes[last : last + 2])
    edge = math.copysign(band, errors[last])
    return float(brentq(lambda t: course(t) - edge, times[last], times[last + 1], xtol=1e-14 * times[last + 1]))
