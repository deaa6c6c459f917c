"""Candidates for poles: one denominator for all responses by linear least squares, at many orders; what stays is physical.

    N_o(z) - H_o D(z) ≈ 0,   z = e^{jωT},  D of order n,   T = π/ω_max,   s = ln(z)/T at the roots of D

References
----------
P. Guillaume, P. Verboven, S. Vanlanduit, Proc. ISMA 23 (1998) 359-366 (least-squares complex frequency estimator).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.exact.frequency.fourier import Complex, Real

MOST_ORDER = 80
"""Of the denominator: room for 20 modes in a band, also in its lower half alone, and for what noise needs."""

_SAME_FREQUENCY = 0.01
_SAME_DAMPING = 0.1
_MOST_DAMPED = 0.9
_STAYS = 4
"""Orders at which a pole comes back before it is believed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A pole that comes back at several orders: undamped frequency (rad/s), damping ratio, at how many orders."""

    frequency: float
    damping: float
    orders: int


def candidates(w: Real, responses: Complex, weights: Real, *, order: int) -> list[Candidate]:
    """Return poles that do not depend on the order of the model, by frequency.

    Parameters
    ----------
    w : ndarray, shape (lines,)
        rad/s, increasing, > 0.
    responses : ndarray of complex, shape (responses, lines)
    weights : ndarray, shape (responses, lines)
    order : int
        Highest order.
    """
    reduced = _reduced(w, responses, weights, order)
    before: list[complex] = []
    staying: list[complex] = []
    for n in range(2, order + 1):
        found = _poles(reduced, n, w)
        staying += [pole for pole in found if any(_same(pole, other) for other in before)]
        before = found
    return _clusters(staying)


def _reduced(w: Real, responses: Complex, weights: Real, order: int) -> list[Real]:
    """Return, for each response, the triangle of its equations: numerator columns first, denominator columns last."""
    basis = np.exp(1j * np.multiply.outer(w * (np.pi / w[-1]), np.arange(order + 1)))
    triangles = []
    for response, weight in zip(responses, weights, strict=True):
        columns = np.concatenate([basis, -response[:, None] * basis], axis=1) * weight[:, None]
        stacked = np.concatenate([columns.real, columns.imag])
        triangles.append(_triangle(stacked))
    return triangles


def _triangle(columns: Real) -> Real:
    return np.asarray(np.linalg.qr(columns, mode="reduced").R)


def _poles(triangles: Sequence[Real], n: int, w: Real) -> list[complex]:
    """Return the stable, oscillating poles of the model of order ``n`` within the band."""
    full = triangles[0].shape[1] // 2
    chosen = np.r_[0 : n + 1, full : full + n + 1]
    rest = [_triangle(triangle[:, chosen])[n + 1 :, n + 1 :] for triangle in triangles]
    equations = np.concatenate(rest)
    # with the constant coefficient fixed, roots that noise makes lie outside of the unit circle: they are no poles
    tail, *_ = np.linalg.lstsq(equations[:, 1:], -equations[:, 0], rcond=None)
    roots = np.roots(np.concatenate([[1.0], tail])[::-1])
    with np.errstate(divide="ignore"):
        poles = np.log(roots[roots != 0].astype(complex)) * (w[-1] / np.pi)
    # e^{sT} stands for e^{-jωt} in some conventions: here z = e^{+jωT}, so that poles are inside of the circle
    size = np.abs(poles)
    inside = (
        (poles.imag > 0) & (poles.real < 0) & (size >= w[0]) & (size <= w[-1]) & (-poles.real < _MOST_DAMPED * size)
    )
    return [complex(pole) for pole in poles[inside]]


def _same(one: complex, other: complex) -> bool:
    near = abs(abs(one) - abs(other)) < _SAME_FREQUENCY * abs(one)
    first, second = -one.real / abs(one), -other.real / abs(other)
    return near and abs(first - second) < _SAME_DAMPING * max(first, second)


def _clusters(poles: list[complex]) -> list[Candidate]:
    """Return groups of poles whose frequencies follow one another closely."""
    groups: list[list[complex]] = []
    for pole in sorted(poles, key=abs):
        if groups and abs(pole) - abs(groups[-1][-1]) < _SAME_FREQUENCY / 2 * abs(pole):
            groups[-1].append(pole)
        else:
            groups.append([pole])
    return [
        Candidate(
            frequency=float(np.median([abs(pole) for pole in group])),
            damping=float(np.median([-pole.real / abs(pole) for pole in group])),
            orders=len(group),
        )
        for group in groups
        if len(group) >= _STAYS
    ]
