"""Impulse shapers: impulses at t_i of amplitudes A_i, which a command is convolved with so that a mode stays at rest.

    T = 2π / (ω sqrt(1 - ζ²)),   K = exp(-π ζ / sqrt(1 - ζ²))
    ZV, ZVD, ZVDD   t_i = i T/2,   A_i = binom(n, i) K^i / (1 + K)^n,   n = 1, 2, 3
    EI              t_1 = 0, t_2, t_3 = T; vibration V at ω itself, none at a frequency below and at one above it

What vibrates after the impulses, relative to what one impulse leaves of the mode:
V(ω) = exp(-ζ ω t_n) |Σ A_i exp((ζ + j sqrt(1 - ζ²)) ω t_i)|. The EI conditions have a closed form only without damping:
A = ((1 + V)/4, (1 - V)/2, (1 + V)/4), t_2 = T/2; with damping they are followed from there by Newton's method.

References
----------
N. Singer, W. Seering, "Preshaping command inputs to reduce system vibration", ASME J. Dyn. Syst. Meas. Control 112
(1990) 76-82 (ZV, ZVD, ZVDD).
W. Singhose, W. Seering, N. Singer, "Residual vibration reduction using vector diagrams to generate shaped inputs", ASME
J. Mech. Des. 116 (1994) 654-659 (EI).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from engine.model.errors import SignalError
from engine.model.linear_system import Array
from engine.model.tangent import INFINITESIMAL

ORDERS = {"zv": 1, "zvd": 2, "zvdd": 3}
KINDS = (*ORDERS, "ei")

MOST_DAMPED_EI = 0.3
"""Beyond it the published EI shapers end; three positive impulses soon cannot meet its conditions any more."""

_MOST_ITERATIONS = 20
_CONVERGED = 1e-9  # Newton's next step is then below rounding, and one follows
_STEP = 0.05  # of the damping ratio, from one solution to the next


@dataclass(frozen=True, kw_only=True, eq=False)
class Impulses:
    """Instants (s, from 0, increasing) and amplitudes (sum 1) of a shaper; numbers may carry an infinitesimal."""

    times: Array
    amplitudes: Array


def impulses(shaper: str, *, frequency: float, damping_ratio: float, tolerance: float) -> Impulses:
    """Return the impulses of a shaper.

    Parameters
    ----------
    shaper : {"zv", "zvd", "zvdd", "ei"}
    frequency : float
        Undamped angular frequency of the mode, rad/s.
    damping_ratio : float
        0 <= ζ < 1; at most 0.3 for ``ei``.
    tolerance : float
        Vibration that ``ei`` allows at the frequency itself, as a ratio; 0.001 to 0.15.

    Raises
    ------
    SignalError
        If the damping is too high for ``ei``.

    Examples
    --------
    >>> impulses("zv", frequency=1.0, damping_ratio=0.1, tolerance=0.05).amplitudes.round(6).tolist()
    [0.578286, 0.421714]
    """
    root = np.sqrt(1 - damping_ratio**2)
    period = 2 * np.pi / (frequency * root)
    if shaper == "ei":
        first, third, middle = _extra_insensitive(damping_ratio, tolerance)
        amplitudes = np.array([first, 1 - first - third, third])
        return Impulses(times=period * np.array([0.0, middle, 1.0]), amplitudes=amplitudes)
    n = ORDERS[shaper]
    ratio = np.exp(-np.pi * damping_ratio / root)
    amplitudes = np.array([comb(n, i) * ratio**i for i in range(n + 1)]) / (1 + ratio) ** n
    return Impulses(times=period / 2 * np.arange(n + 1), amplitudes=amplitudes)


def _extra_insensitive(damping_ratio: float, tolerance: float) -> tuple[complex, complex, complex]:
    """Return (A_1, A_3, t_2/T) of the EI shaper, with the infinitesimals of its arguments."""
    if damping_ratio.real > MOST_DAMPED_EI:
        msg = f"damping_ratio must be <= {MOST_DAMPED_EI:g} for the shaper ei, got {damping_ratio.real:g}"
        raise SignalError(msg, at=("damping_ratio",))
    zeta, allowed = damping_ratio.real, tolerance.real
    quarter = (1 + allowed) / 4
    beside = np.arccos((1 - allowed) / (1 + allowed)) / np.pi
    unknowns = np.array([quarter, quarter, 0.5, 1 - beside, 1 + beside])
    steps = int(np.ceil(zeta / _STEP))
    for along in np.linspace(0.0, zeta, steps + 1)[1:]:
        for _ in range(_MOST_ITERATIONS):
            correction = _newton(unknowns, along, allowed)
            unknowns = unknowns - correction
            if np.abs(correction).max() < _CONVERGED:
                break
    # one more step carries the infinitesimals: dx = -J⁻¹ ∂r/∂p
    exact = unknowns - _newton(unknowns, damping_ratio, tolerance)
    first, third, middle = exact[:3].tolist()
    return first, third, middle


def _newton(unknowns: Array, damping_ratio: float, tolerance: float) -> Array:
    """Return J⁻¹ r of the EI conditions; J is exact, by infinitesimal steps in the unknowns."""
    real = np.real(unknowns)
    steps = 1j * INFINITESIMAL * np.eye(len(real))
    columns = [_conditions(real + step, damping_ratio.real, tolerance.real).imag / INFINITESIMAL for step in steps]
    residual = _conditions(unknowns, damping_ratio, tolerance)
    inverse = np.linalg.inv(np.array(columns).T)
    return np.asarray(inverse @ residual)


def _conditions(unknowns: Array, damping_ratio: float, tolerance: float) -> Array:
    """Return what is to be zero: both parts of the vibration at two relative frequencies, and V² - tolerance² at 1."""
    first, third, middle, below, above = unknowns
    times = 2 * np.pi * np.stack([0.0 * middle, middle, 1.0 + 0.0 * middle])
    amplitudes = np.stack([first, 1 - first - third, third])
    decay = damping_ratio / np.sqrt(1 - damping_ratio**2)

    def parts(ratio: Array, before: float = 0.0) -> tuple[Array, Array]:
        weights = amplitudes * np.exp(decay * (ratio * times - before))
        return (weights * np.cos(ratio * times)).sum(), (weights * np.sin(ratio * times)).sum()

    cosine, sine = parts(np.asarray(1.0), 2 * np.pi)
    return np.stack([*parts(below), *parts(above), cosine**2 + sine**2 - tolerance**2])
