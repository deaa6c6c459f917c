"""By how much a value lies beyond a bound, on a scale on which every number can be compared.

    e = σ (f - bound) / |bound|   (plain where the bound is 0);   as it is up to 100, then 100 + ln(1 + |e| - 100)

The logarithm goes on where the straight line ends, with the same slope: of two points far from feasible the nearer one is still the better one, and
no number overflows. An infinite value, and a metric that has none, lie beyond all numbers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from optimizers.problem import Goal

Matrix = npt.NDArray[np.float64]

BROKEN: Final = 9e2
"""Violation of a goal whose metric has no value, or an infinite one: more than that of any number (810)."""

_STRAIGHT: Final = 1e2


def excess(values: Matrix, bound: float, sign: float) -> Matrix:
    """Return how far values lie beyond a bound, above it where ``sign`` is 1 and below it where it is -1; negative where there is room."""
    raw = sign * (values - bound) / (abs(bound) or 1.0)
    beyond = np.maximum(np.abs(raw) - _STRAIGHT, 0.0)
    graded = np.sign(raw) * (np.minimum(np.abs(raw), _STRAIGHT) + np.log1p(beyond))
    return np.asarray(np.clip(graded, -BROKEN, BROKEN))


def excess_slopes(values: Matrix, slopes: Matrix, bound: float, sign: float) -> Matrix:
    """Return the slopes of :func:`excess`, (..., V), for values (...) with slopes (..., V)."""
    size = abs(bound) or 1.0
    beyond = np.maximum(np.abs(values - bound) / size - _STRAIGHT, 0.0)
    return np.asarray(sign * slopes / size / (1.0 + beyond)[..., None])


def signed_excess(goal: Goal, values: Matrix) -> Matrix:
    """Return :func:`excess` for each bound of a goal (first axis: upper, lower where given)."""
    rows = [excess(values, bound, sign) for bound, sign in goal.bounds]
    return np.array(rows).reshape(len(rows), *np.shape(values))
