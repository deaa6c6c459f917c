"""What a recorded input does between its samples: polynomials in the part φ (0 … 1) of an interval that has gone by.

    hold            u = u_k                        what a D/A converter puts out
    linear          u = u_k + φ (u_{k+1} - u_k)
    band_limited    u = Σ_i c_i φ^i, i = 0 … 5     a spline through the samples: what an anti-aliasing filter lets through

A sine through a linear interpolation keeps the part sinc²(f h) of its size, 0.967 at a tenth of the sample rate: a model
that is compared with a measurement then lacks it. A quintic spline keeps 0.9997 at a fifth of the sample rate, 0.994 at
three tenths.

References
----------
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, section 13.3 (behaviour of the input
between the samples: zero-order hold, first-order hold, band-limited).
M. Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing Magazine 16 (1999) 22-38.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt

Samples = npt.NDArray[np.float64]

_DEGREE: Final = 5


class BetweenSamples(StrEnum):
    """What an input does between its samples."""

    HOLD = "hold"
    LINEAR = "linear"
    BAND_LIMITED = "band_limited"


def polynomials(values: Samples, way: BetweenSamples, time: Samples | None = None) -> Samples:
    """Return the coefficients of each interval, rising powers of φ.

    Parameters
    ----------
    values : ndarray, shape (samples,)
    way : BetweenSamples
    time : ndarray, shape (samples,), optional
        Instants in s, increasing; equal intervals by default.

    Returns
    -------
    ndarray, shape (degree + 1, samples - 1)
    """
    if way is BetweenSamples.HOLD:
        return values[None, :-1]
    if way is BetweenSamples.LINEAR or values.size < 3:
        return np.array([values[:-1], np.diff(values)])
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - a tenth of a second

    instants = np.arange(values.size, dtype=np.float64) if time is None else time
    degree = min(_DEGREE, values.size // 2 * 2 - 1)
    spline, width = make_interp_spline(instants, values, k=degree), np.diff(instants)
    return np.array([spline(instants[:-1], i) * width**i / math.factorial(i) for i in range(degree + 1)])


def told(between: Mapping[str, BetweenSamples] | BetweenSamples, names: Sequence[str]) -> tuple[BetweenSamples, ...]:
    """Return the way of each input: one for all of them, or by name and linear where none is given."""
    if isinstance(between, BetweenSamples):
        return (between,) * len(names)
    return tuple(between.get(name, BetweenSamples.LINEAR) for name in names)


def tried(undecided: Sequence[str]) -> tuple[BetweenSamples, ...]:
    """Return the ways that are tried on inputs of which nobody knows it, the one of equals that is taken first."""
    every = (BetweenSamples.LINEAR, BetweenSamples.HOLD, BetweenSamples.BAND_LIMITED)
    return every if undecided else every[:1]
