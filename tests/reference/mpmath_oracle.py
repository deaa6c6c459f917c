"""An oracle that shares nothing with the engine: partial fractions of rational transfer functions at 40 digits.

    y(t) = sum_k c_k exp(p_k t),   c_k = num(p_k) / (p_k den'(p_k)),   c_0 = G(0)

Crossings and extrema are bracketed on a dense grid in floating point and polished at 40 digits; derivatives with
respect to a parameter are central differences with a relative step of 1e-10, hence exact to about 20 digits.
It wants simple poles; a common factor s is cancelled.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

mp = mpmath.mp.clone()
mp.dps = 40

Poly = list[Any]
"""Coefficients, highest power of s first, as mpf."""


def poly(*coefficients: float | str | Any) -> Poly:
    """Return 40-digit coefficients; decimal fractions are read as written (1.4, not its nearest binary)."""
    return [mp.mpf(repr(c)) if isinstance(c, float) else mp.mpf(c) for c in coefficients]


def multiply(*factors: Poly) -> Poly:
    product: Poly = [mp.mpf(1)]
    for factor in factors:
        out = [mp.mpf(0)] * (len(product) + len(factor) - 1)
        for i, a in enumerate(product):
            for j, b in enumerate(factor):
                out[i + j] += a * b
        product = out
    return product


def add(a: Poly, b: Poly) -> Poly:
    n = max(len(a), len(b))
    left, right = [mp.mpf(0)] * (n - len(a)) + a, [mp.mpf(0)] * (n - len(b)) + b
    return [x + y for x, y in zip(left, right, strict=True)]


def evaluate(a: Poly, s: Any) -> Any:
    value = mp.mpf(0)
    for c in a:
        value = value * s + c
    return value


def slope_of(a: Poly) -> Poly:
    return [c * (len(a) - 1 - i) for i, c in enumerate(a[:-1])]


@dataclass(frozen=True)
class Rational:
    """num(s)/den(s)."""

    num: Poly
    den: Poly

    def __call__(self, s: Any) -> Any:
        return evaluate(self.num, s) / evaluate(self.den, s)

    def closed(self) -> Rational:
        """G/(1 + G): unity negative feedback."""
        return Rational(self.num, add(self.num, self.den))

    def poles(self) -> list[Any]:
        den = list(self.den)
        while den[0] == 0:
            den.pop(0)
        return list(mp.polyroots(den[::-1], asc=True, maxsteps=1000, extraprec=600))

    def on_grid(self, frequency: np.ndarray) -> np.ndarray:
        s = 1j * frequency
        return np.polyval([float(c) for c in self.num], s) / np.polyval([float(c) for c in self.den], s)


@dataclass(frozen=True)
class ExponentialSum:
    """f(t) = sum_k c_k exp(p_k t) + slope t, t >= 0; a constant has exponent 0."""

    terms: tuple[tuple[Any, Any], ...]
    slope: Any = 0

    @classmethod
    def step_response(cls, g: Rational) -> ExponentialSum:
        num, den = list(g.num), list(g.den)
        while num[-1] == 0 and den[-1] == 0:
            num.pop(), den.pop()
        slope = slope_of(den)
        terms = [(num[-1] / den[-1], mp.mpf(0))]
        terms += [(evaluate(num, p) / (p * evaluate(slope, p)), p) for p in Rational(num, den).poles()]
        return cls(tuple(terms))

    @classmethod
    def inverse_laplace(cls, g: Rational) -> ExponentialSum:
        """Of a strictly proper g with simple poles, e.g. G(s) U(s)."""
        slope = slope_of(g.den)
        return cls(tuple((evaluate(g.num, p) / evaluate(slope, p), p) for p in g.poles()))

    def __call__(self, t: Any) -> Any:
        return mp.re(sum(c * mp.exp(p * t) for c, p in self.terms)) + self.slope * t

    def on_grid(self, t: np.ndarray) -> np.ndarray:
        return np.real(sum(complex(c) * np.exp(complex(p) * t) for c, p in self.terms)) + float(self.slope) * t

    def derivative(self) -> ExponentialSum:
        return ExponentialSum(tuple((c * p, p) for c, p in self.terms if p != 0))

    def integral(self) -> ExponentialSum:
        """From 0 to t, of a sum without a slope of its own."""
        moving = [(c / p, p) for c, p in self.terms if p != 0]
        constant = (-sum(c for c, _ in moving), mp.mpf(0))
        return ExponentialSum((constant, *moving), slope=self.final())

    def final(self) -> Any:
        return mp.re(sum(c for c, p in self.terms if p == 0))

    def grid(self) -> np.ndarray:
        slowest = min(-float(mp.re(p)) for _, p in self.terms if p != 0)
        horizon = 45.0 / slowest
        return np.union1d(np.linspace(0.0, horizon, 200_001), np.geomspace(horizon * 1e-9, horizon, 20_001))


def polished(f: Callable[[Any], Any], left: float, right: float) -> Any:
    return mp.findroot(f, (mp.mpf(left), mp.mpf(right)), solver="anderson", maxsteps=200)


def step_metrics(g: Rational) -> dict[str, Any]:
    """Metrics of the unit step response of ``g`` from rest, defined as in docs/metrics."""
    y = ExponentialSum.step_response(g)
    dy, final, t = y.derivative(), y.final(), y.grid()
    way = y.on_grid(t) / float(final)

    def crossing(level: str) -> Any:
        k = int(np.argmax(way >= float(level)))
        return mp.mpf(0) if k == 0 else polished(lambda x: y(x) / final - mp.mpf(level), t[k - 1], t[k])

    def last_entry(band: str) -> Any:
        k = int(np.nonzero(np.abs(way - 1) > float(band))[0][-1])
        return polished(lambda x: abs(y(x) / final - 1) - mp.mpf(band), t[k], t[k + 1])

    def extremum(values: np.ndarray) -> tuple[Any, Any]:
        k = int(np.argmax(values))
        if k == 0:
            return mp.mpf(0), y(0)
        if k >= len(t) - 2:
            return mp.inf, final
        if dy(t[k - 1]) * dy(t[k + 1]) >= 0:  # no turning point: rounding of the grid near t = 0 or near the end
            at = mp.mpf(t[k - 1] if values[0] >= values[-1] else t[k + 1])
            return at, y(at)
        at = polished(dy, t[k - 1], t[k + 1])
        return at, y(at)

    _, highest = extremum(way)
    _, lowest = extremum(-way)
    peak_time, peak = extremum(np.abs(way))
    if abs(peak) <= abs(final):
        peak_time, peak = mp.inf, final
    return {
        "rise_time": crossing("0.9") - crossing("0.1"),
        "settling_time": last_entry("0.02"),
        "response_time": last_entry("0.05"),
        "overshoot": max(mp.mpf(0), highest / final - 1),
        "undershoot": max(mp.mpf(0), -lowest / final),
        "peak": abs(peak),
        "peak_time": peak_time,
        "steady_state_error": 1 - final,
    }


def error_integrals(g: Rational) -> dict[str, Any]:
    """IAE, ISE and ITAE of e = 1 - y over 0 to infinity; ``g`` must have unit static gain."""
    y = ExponentialSum.step_response(g)
    error = ExponentialSum(tuple((-c, p) for c, p in y.terms if p != 0))
    t = y.grid()
    values = error.on_grid(t)
    turns = [
        polished(error, t[k], t[k + 1])
        for k in np.nonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0)[0]
        if abs(values[k]) > 1e-11  # beyond, the envelope itself is below what any test resolves
    ]

    def between(primitive: Callable[[Any], Any]) -> Any:
        marks = [primitive(mp.mpf(0)), *(primitive(x) for x in turns), mp.mpf(0)]
        return sum(abs(b - a) for a, b in itertools.pairwise(marks))

    return {
        "iae": between(lambda x: mp.re(sum(c / p * mp.exp(p * x) for c, p in error.terms))),
        "itae": between(lambda x: mp.re(sum(c * mp.exp(p * x) * (x / p - 1 / p**2) for c, p in error.terms))),
        "ise": mp.re(sum(-c * d / (p + q) for c, p in error.terms for d, q in error.terms)),
    }


def frequency_grid(*systems: Rational) -> np.ndarray:
    corners = [abs(complex(p)) for g in systems for p in g.poles() if p != 0] or [1.0]
    return np.geomspace(min(corners) * 1e-4, max(corners) * 1e4, 400_001)


def loop_metrics(loop: Rational) -> dict[str, Any]:
    """Margins of ``loop`` (1 + L = 0 is the characteristic equation) and the peaks of S and T."""
    closed = loop.closed()
    sensitivity = Rational(loop.den, closed.den)
    w = frequency_grid(loop, closed)
    values = loop.on_grid(w)

    def at(x: Any) -> Any:
        return loop(mp.mpc(0, x))

    gain, phase, delay = [], [], []
    for k in np.nonzero(np.diff(np.sign(values.imag)))[0]:
        if values[k].real < 0:
            x = polished(lambda v: mp.im(at(v)), w[k], w[k + 1])
            gain.append((x, 1 / abs(at(x))))
    for k in np.nonzero(np.diff(np.sign(np.abs(values) - 1)))[0]:
        x = polished(lambda v: abs(at(v)) - 1, w[k], w[k + 1])
        margin = mp.arg(-at(x))
        phase.append((x, margin))
        delay.append((x, (margin if margin >= 0 else margin + 2 * mp.pi) / x))
    return {
        "gain_margin": min((v for _, v in gain), key=lambda v: abs(mp.log(v)), default=None),
        "phase_margin": min((v for _, v in phase), key=abs, default=None),
        "delay_margin": min((v for _, v in delay), default=None),
        "sensitivity_peak": magnitude_peak(sensitivity, w)[1],
        "complementary_peak": magnitude_peak(closed, w)[1],
        "margins": {"gain": gain, "phase": phase, "delay": delay},
    }


def magnitude_peak(g: Rational, w: np.ndarray | None = None) -> tuple[Any, Any]:
    """Frequency and value of max |g(j w)|, which may lie at 0 or at infinity."""
    grid = frequency_grid(g) if w is None else w
    k = int(np.argmax(np.abs(g.on_grid(grid))))
    if k == 0:
        return mp.mpf(0), abs(g(mp.mpf(0)))
    if k == len(grid) - 1:
        return mp.inf, abs(g.num[0] / g.den[0]) if len(g.num) == len(g.den) else mp.mpf(0)

    def slope(x: Any) -> Any:
        s = mp.mpc(0, x)
        d_num = evaluate(slope_of(g.num), s) / evaluate(g.num, s)
        d_den = evaluate(slope_of(g.den), s) / evaluate(g.den, s)
        return mp.re(mp.mpc(0, 1) * (d_num - d_den))  # d ln|g| / d w

    x = polished(slope, grid[k - 1], grid[k + 1])
    return x, abs(g(mp.mpc(0, x)))


def bandwidth(g: Rational) -> Any:
    """First frequency where |g| falls 3 dB below |g(0)|; None where it never does."""
    num, den = list(g.num), list(g.den)
    while num[-1] == 0 and den[-1] == 0:
        num.pop(), den.pop()
    level = abs(num[-1] / den[-1]) * mp.mpf(10) ** (mp.mpf(-3) / 20)
    w = frequency_grid(g)
    k = int(np.argmax(np.abs(g.on_grid(w)) < float(level)))
    return polished(lambda x: abs(g(mp.mpc(0, x))) - level, w[k - 1], w[k]) if k else None


def elasticity(value: Callable[[Mapping[str, Any]], Any], at: Mapping[str, Any], parameter: str) -> Any:
    """Return d ln value / d ln parameter by a central difference at 40 digits."""
    h = mp.mpf(10) ** -10
    up, down = ({**at, parameter: at[parameter] * (1 + sign * h)} for sign in (1, -1))
    return (value(up) - value(down)) / (2 * h * value(at))


def state_space_step(
    a: Sequence[Sequence[float]], b: Sequence[float], c: Sequence[float], d: float, times: Sequence[float]
) -> list[float]:
    """Step response of x' = A x + b, y = c x + d from rest, by the exponential of the augmented matrix."""
    n = len(b)
    augmented = mp.matrix(n + 1)
    for i in range(n):
        for j in range(n):
            augmented[i, j] = mp.mpf(a[i][j])
        augmented[i, n] = mp.mpf(b[i])
    out = []
    for t in times:
        x = mp.expm(augmented * mp.mpf(t))[:n, n]
        out.append(float(sum(mp.mpf(c[i]) * x[i] for i in range(n)) + mp.mpf(d)))
    return out
