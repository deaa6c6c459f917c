"""What repeats, period by period: the common part of the estimators for sines and multisines.

    H = mean Y_k / mean X_k,    var H = Σ |Y_k - H X_k|² / (K (K - 1)) / |mean X|²

References
----------
R. Pintelon, J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed., Wiley 2012, section 2.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.exact.frequency.fourier import Complex, Real

_FEWEST = 4
"""Periods that can be told apart by halves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Repeated:
    """H (lines,), the standard deviation of ln|H| and arg H, and how H changes while the periods pass.

    ``drift`` is the distance of H by the second half of the periods from that by the first, relative to H; ``drifts``
    where the scatter within the second half, when transients have died away, does not explain it. None, None and False
    where there are too few periods to tell.
    """

    value: Complex
    error: Real | None
    drift: Real | None
    drifts: np.ndarray[tuple[int], np.dtype[np.bool_]]


def repeated(x: Complex, y: Complex, *, level: float) -> Repeated:
    """Return the response function of periods.

    Parameters
    ----------
    x, y : ndarray of complex, shape (periods, lines)
        Lines of each period, phases counted from one instant.
    level : float
        Probability with which a line that does not drift is told so.
    """
    count, lines = x.shape
    value = y.mean(axis=0) / x.mean(axis=0)
    steady = np.zeros(lines, dtype=np.bool_)
    if count < 2:
        return Repeated(value=value, error=None, drift=None, drifts=steady)
    left = y - value * x
    size = np.abs(y.mean(axis=0))
    # half of the scatter lies along H, half across
    error = np.sqrt((np.abs(left) ** 2).sum(axis=0) / (count * (count - 1)) / 2) / size
    if count < _FEWEST:
        return Repeated(value=value, error=error, drift=None, drifts=steady)
    from scipy.stats import f  # noqa: PLC0415 - a third of a second

    half = count // 2
    first, last = left[:half], left[half:]
    distance = np.abs(last.mean(axis=0) - first.mean(axis=0))
    scatter = last.var(axis=0, ddof=1) * (1 / len(first) + 1 / len(last))
    limit = float(f.ppf(level, 2, 2 * (len(last) - 1)))
    return Repeated(value=value, error=error, drift=distance / size, drifts=np.asarray(distance**2 > limit * scatter))
