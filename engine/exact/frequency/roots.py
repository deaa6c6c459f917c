"""Roots of a function in many brackets at once, to rounding."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]

SAME: Final = 4e-16
"""Two numbers that are nearer than this, relative to themselves, are one."""


def roots(function: Callable[[Real], Real], a: Real, b: Real) -> Real:
    """Return the root between each pair of ``a`` and ``b``, by Ridders' method to rounding.

    Where there is no change of sign between them: that one of the two at which the function is nearer to 0.

    References
    ----------
    C. Ridders, "A new algorithm for computing a single root of a real continuous function", IEEE Trans. Circuits and
    Systems 26 (1979) 979-980.
    """
    if not len(a):
        return a
    low, high, f_low, f_high = a.copy(), b.copy(), function(a), function(b)
    found = np.where(np.abs(f_low) <= np.abs(f_high), low, high)
    active = np.flatnonzero((f_low < 0) & (f_high > 0) | (f_low > 0) & (f_high < 0))
    for _ in range(100):
        if not len(active):
            break
        middle = 0.5 * (low[active] + high[active])
        f = function(middle)
        root = np.sqrt(f * f - f_low[active] * f_high[active])
        with np.errstate(invalid="ignore", divide="ignore"):
            new = middle + (middle - low[active]) * np.sign(f_low[active] - f_high[active]) * f / root
        new = np.where(np.isfinite(new), new, middle)
        f_new = function(new)
        last, found[active] = found[active], new
        for x, value in ((middle, f), (new, f_new)):
            inside = (x > low[active]) & (x < high[active])
            below = inside & ((value < 0) == (f_low[active] < 0))
            above = inside & ~below
            low[active[below]], f_low[active[below]] = x[below], value[below]
            high[active[above]], f_high[active[above]] = x[above], value[above]
        same = np.abs(new - last) <= SAME * new
        active = active[(f_new != 0) & ~same & (high[active] - low[active] > SAME * new)]
    return found
