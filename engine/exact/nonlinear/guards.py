"""Where the first guard of a step becomes positive: the root of a polynomial, bracketed by a scan finer than its nodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import DEGREE, coefficient_matrix, differentiation_matrix, weights

Real = npt.NDArray[np.float64]

_ORDERS = np.arange(DEGREE + 1)
_SCAN = np.linspace(0.0, 1.0, 4 * DEGREE + 1)
_TO_SCAN = weights(_SCAN)
_NEARLY = 1e-2  # a polynomial that stays so far below 0 between two points of the scan does not reach it
_NEWTON = 4
_ROUNDING = 1e-14
"""Of a guard's largest value on a step: a start so near to 0 is on either side of it."""
_STEEPER = 100.0
"""By so much a slope is worse known than the values that it is made of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Guard number ``index`` becomes positive at ``theta`` of the step."""

    index: int
    theta: float


def crosses(values: Real, tolerance: float) -> npt.NDArray[np.bool_]:
    """Return for each step whether a guard, (K, 17) at its nodes, becomes positive on it."""
    return np.asarray((values @ _TO_SCAN.T > tolerance).any(axis=1) | (values[:, [0, -1]] > tolerance).any(axis=1))


def touches(values: Real, tolerance: float) -> bool:
    """Return whether a guard (17,) reaches 0 inside a step without passing it: a little more, and there is an event."""
    scan = _TO_SCAN @ values
    place = int(np.argmax(scan))
    ends = max(float(scan[0]), float(scan[-1]))
    if not 0 < place < len(scan) - 1 or scan[place] - ends <= 10 * tolerance or scan[place] > tolerance:
        return False
    if scan[place] < -_NEARLY * float(np.abs(scan).max()):
        return False
    slope = np.polynomial.chebyshev.chebder(coefficient_matrix() @ values)
    bend = np.polynomial.chebyshev.chebder(slope)
    x = 2 * float(_SCAN[place]) - 1
    for _ in range(_NEWTON):
        x -= float(np.polynomial.chebyshev.chebval(x, slope) / np.polynomial.chebyshev.chebval(x, bend))
    top = float(weights(np.asarray((min(max(x, -1.0), 1.0) + 1) / 2)) @ values)
    return abs(top) <= tolerance


def first_crossing(guards: Sequence[tuple[int, int, Real]], tolerances: Sequence[float]) -> Crossing | None:
    """Return the first crossing on a step.

    Parameters
    ----------
    guards : sequence of (law, guard, values)
        Values at the Chebyshev nodes of the step, shape (17,).
    tolerances : sequence of float
        What counts as 0 for each of them.
    """
    if not guards:
        return None
    nodes = np.array([values for _, _, values in guards])
    limits = np.array(tolerances)[:, None]
    scan = nodes @ _TO_SCAN.T
    scan[:, 0], scan[:, -1] = nodes[:, 0], nodes[:, -1]
    positive = scan > limits
    best: Crossing | None = None
    for index in np.flatnonzero(positive.any(axis=1)):
        place = _passed(scan[index], int(np.argmax(positive[index])))
        if best is not None and _SCAN[max(place - 1, 0)] >= best.theta:
            continue
        theta = _root(nodes[index], scan[index], place)
        if best is None or theta < best.theta:
            best = Crossing(index=int(index), theta=theta)
    return best


def _passed(scan: Real, place: int) -> int:
    """Return the scan point behind the one at which a guard, positive at ``place``, was last below 0; ``place`` where it never was."""
    below = np.flatnonzero(scan[:place] < 0.0)
    return int(below[-1]) + 1 if len(below) else place


def _root(nodes: Real, scan: Real, place: int) -> float:
    """Return where the polynomial passes 0 before scan point ``place``, where it is not below 0."""
    from scipy.optimize import brentq  # noqa: PLC0415 - a fifth of a second

    if place == 0:
        return 0.0
    low, high = float(_SCAN[place - 1]), float(_SCAN[place])
    coefficients = coefficient_matrix() @ nodes

    def value(theta: float) -> float:
        return float(np.cos(_ORDERS * math.acos(2 * theta - 1)) @ coefficients)

    before, fall = max(float(scan[place - 1]), value(low)), float(differentiation_matrix()[0] @ nodes)
    noise = _ROUNDING * float(np.abs(nodes).max())
    if before >= 0.0 or (place == 1 and before >= -noise and fall < -_STEEPER * noise):  # the two differ by rounding
        if place > 1 or fall >= 0.0:
            return low
        # it leaves 0 at the start and is back before the scan looks again: a bounce shorter than its steps
        first = float(nodes[0])

        def rest(theta: float) -> float:
            return fall if theta == 0.0 else (value(theta) - first) / theta

        return float(brentq(rest, 0.0, high, xtol=1e-16, rtol=1e-15)) if rest(high) > 0.0 else low
    if value(high) <= 0.0:
        return high
    return float(brentq(value, low, high, xtol=1e-16, rtol=1e-15))
