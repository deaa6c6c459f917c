"""Where a quantity passes 0 between two places at which it was seen on either side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from scipy.optimize import brentq


def passage(of: Callable[[float], Any], a: float, b: float, *, xtol: float = 2e-12, rtol: float = 1e-15) -> float:
    """Return the place to an absolute and a relative tolerance; seen again, by other operations, an end may be on the other side by rounding: it is that one then."""
    first, last = float(of(a)), float(of(b))
    if (first < 0) == (last < 0):
        return a if abs(first) < abs(last) else b
    return float(brentq(of, a, b, xtol=xtol, rtol=rtol))
