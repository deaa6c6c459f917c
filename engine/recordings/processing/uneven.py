"""Samples at uneven instants, brought to an even axis by interpolation.

    y_k = x(t_0 + k / rate),   x linear between two samples, or the cubic spline through all of them (not-a-knot)

Interpolation is no low pass: a rate below the mean one of the samples would fold what is above half of it, and is refused.
Nothing is invented across a hole: between two samples that are further apart than ten usual steps, or one of which is
missing, the samples are missing.

References
----------
C. de Boor, "A Practical Guide to Splines", Springer 2001, chapter IV.
"""

from __future__ import annotations

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Real

METHODS = ("linear", "cubic")
_HOLE = 10.0
_SAME = 1e-9


def evened(time: Real, values: Real, *, rate: float, method: str = "linear", longest: float | None = None) -> Real:
    """Return samples on an even axis that begins with the first one.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Instants, s, rising; n >= 2, for cubic 4.
    values : ndarray, shape (n,)
        NaN where one is missing.
    rate : float
        Samples per second, at least the mean rate (n - 1) / (time[-1] - time[0]).
    method : str
        "linear" or "cubic".
    longest : float, optional
        Longest distance of two samples that is bridged, s; ten times the median one unless given.

    Returns
    -------
    ndarray, shape (floor((time[-1] - time[0]) rate) + 1,)

    Raises
    ------
    ProcessingError
        For instants that do not rise, too few samples, a method that does not exist, a rate below the mean one.
    """
    if method not in METHODS:
        raise ProcessingError(f"method must be one of {', '.join(METHODS)}, got {method!r}", at=("method",))
    steps = np.diff(time)
    if time.size < 2 or not np.all(steps > 0.0):
        at = int(np.flatnonzero(~(steps > 0.0))[0]) + 1 if time.size > 1 else 0
        raise ProcessingError(f"instants must rise to be resampled, and be at least 2, they do not at sample {at}")
    span = float(time[-1] - time[0])
    mean = (time.size - 1) / span
    if not (np.isfinite(rate) and rate >= mean * (1.0 - _SAME)):
        raise ProcessingError(
            f"rate must be at least the mean one of the uneven instants ({mean:.6g} samples/s: interpolation is no low "
            f"pass; resample again from there), got {rate:.6g}",
            at=("rate",),
        )
    grid = time[0] + np.arange(int(np.floor(span * rate * (1.0 + _SAME))) + 1) / rate
    there = np.isfinite(values)
    if there.sum() < (4 if method == "cubic" else 2):
        return np.full(grid.size, np.nan)
    found = _interpolated(time[there], values[there], np.minimum(grid, time[-1]), method)
    widest = _HOLE * float(np.median(steps)) if longest is None else longest
    # the step that an instant lies in; on a sample itself, that sample alone counts
    after = np.clip(np.searchsorted(time, grid, side="left"), 0, time.size - 1)
    exact = np.isclose(time[after], grid, rtol=0.0, atol=_SAME / rate)
    before = np.where(exact, after, np.maximum(after - 1, 0))
    hole = ~there[after] | ~there[before] | (time[after] - time[before] > widest)
    return np.where(hole, np.nan, found)


def _interpolated(time: Real, values: Real, grid: Real, method: str) -> Real:
    if method == "linear":
        return np.asarray(np.interp(grid, time, values), dtype=np.float64)
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - a tenth of a second

    return np.asarray(CubicSpline(time, values)(grid), dtype=np.float64)
