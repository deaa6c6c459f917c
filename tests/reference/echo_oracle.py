"""An oracle for loops with delays that shares nothing with the engine: the sum of echoes, term by term, at 30 digits.

    Y = (Σ_i F_i e^{-s a_i}) / (1 + Σ_j P_j e^{-s τ_j}) U = Σ_i F_i Σ_k (-1)^k (Σ_j P_j e^{-s τ_j})^k e^{-s a_i} U

Every power is multiplied out; each term is a rational function, shifted, so up to any instant finitely many count. Its
inverse transform is taken on Talbot's contour (A. Talbot, J. Inst. Maths. Applics 23 (1979) 97-120).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import mpmath

mp = mpmath.mp.clone()
mp.dps = 30

Transfer = Callable[[Any], Any]
Delayed = tuple[Transfer, float]
"""A rational function of s and the delay behind it, s."""


def step_response(forward: Sequence[Delayed], loop: Sequence[Delayed], time: float) -> float:
    """Return y(time) for a unit step, exact to some 15 digits."""
    t = mp.mpf(time)
    total = mp.mpf(0)
    for transfer, delay in forward:
        for counts, shift in _powers([tau for _, tau in loop], mp.mpf(delay), t):
            total += _term(transfer, [p for p, _ in loop], counts, t - shift)
    return float(total)


def _powers(delays: Sequence[float], start: Any, end: Any) -> Iterator[tuple[tuple[int, ...], Any]]:
    most = [int((end - start) / mp.mpf(tau)) if end > start else -1 for tau in delays]
    for counts in itertools.product(*(range(n + 1) for n in most)):
        shift = start + sum((n * mp.mpf(tau) for n, tau in zip(counts, delays, strict=True)), mp.mpf(0))
        if shift < end:
            yield counts, shift


def _term(forward: Transfer, factors: Sequence[Transfer], counts: tuple[int, ...], t: Any) -> Any:
    weight = mp.mpf(-1) ** sum(counts) * mp.factorial(sum(counts))
    for n in counts:
        weight /= mp.factorial(n)

    def transform(s: Any) -> Any:
        value = forward(s) / s
        for factor, n in zip(factors, counts, strict=True):
            value *= factor(s) ** n
        return value

    return weight * mp.invertlaplace(transform, t, method="talbot", degree=45)
