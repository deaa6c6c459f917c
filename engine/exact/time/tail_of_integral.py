"""Whether an integral of all time has come to its end where a run ends: what dies away like 1/t never comes to it.

    before = ∫ from T/4 to T/2,   last = ∫ from T/2 to T,   T since the commands changed for the last time

What dies away as e^(-t/τ) makes `last` a small part q of `before`, and what is left about q² of `last`; what does so as a power of t
makes it one part for ever. What stands still at a small value does not die away within the last window either.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]

_UNSEEN: Final = 1e-9
"""What is below this part of the largest value is as near to 0 as a run comes."""
_NOTHING: Final = 1e-6
"""A last half that brings no more than this part of the whole leaves nothing worth the name."""
_FALLS: Final = 0.2
"""What is left is told from two windows only where the second holds no more than this part of the first,"""
_LEFT: Final = 1e-5
"""and may then be this part of the whole."""


def has_ended(times: Real, values: Real, since: float, of: Callable[[Real, Real], Real]) -> npt.NDArray[np.bool_]:
    """Return whether integrals lack nothing, (B,).

    Parameters
    ----------
    times : ndarray, shape (N,)
        Rising, s; two may be equal.
    values : ndarray, shape (N, B)
        What goes to 0.
    since : float
        When the commands change for the last time, s.
    of : callable
        (values, time since then) -> what is integrated, never negative.
    """
    seen = np.where(np.abs(values) > _UNSEEN * np.abs(values).max(axis=0), values, 0.0)
    sizes = of(seen, (times - since)[:, None])
    middles = 0.5 * (times[1:] + times[:-1])
    areas = 0.5 * np.diff(times)[:, None] * (sizes[1:] + sizes[:-1])
    span = float(times[-1]) - since
    before = areas[(middles >= since + span / 4) & (middles < since + span / 2)].sum(axis=0)
    last, whole = areas[middles >= since + span / 2].sum(axis=0), areas.sum(axis=0)
    end = areas[middles >= since + 3 * span / 4].sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        part = last / before
        falls = (part <= _FALLS) & (part * part * last <= _LEFT * whole) & (end <= _FALLS * last)
    return np.asarray((last <= _NOTHING * whole) | falls)
