"""Frequency response functions under a periodic input, on the lines that it excites: no window, no leakage.

X_k(ω_n) = 2/p Σ_i x_{kp+i} e^{-j2πni/p},   p samples of one period,   ω_n = 2π n rate/p
"""

from __future__ import annotations

import numpy as np

from engine.exact.frequency.fourier import Real
from engine.model.errors import SpectrumError
from engine.recordings.spectra.doubts import fading_doubts
from engine.recordings.spectra.frf import Doubt, Frf, check_pair
from engine.recordings.spectra.periodic import repeated

_WHOLE = 1e-6  # of a sample
_QUIET = 1e-3  # of the largest line: what is not excited
_LOUD = 10.0  # times the variance of its mean: what stands out of the noise
_ALIKE = 0.3  # part of a period that may differ from the next one
_STEADY = 0.99  # probability of a line that does not drift
_DRIFT = 0.005  # of H: less does not matter


def multisine_frf(x: Real, y: Real, rate: float, *, period: float, settle: float = 0.0) -> Frf:
    """Return the response function on the lines that the input excites.

    Parameters
    ----------
    x, y : ndarray, shape (samples,)
        Input and response.
    rate : float
        Samples per second.
    period : float
        Of the input, s: a whole number of samples.
    settle : float
        s at the beginning that are left out, rounded up to whole periods.

    Raises
    ------
    SpectrumError
        If the period is no whole number of samples, does not fit, or is not that of the input.
    """
    check_pair(x, y)
    length = round(period * rate)
    if length < 4 or abs(period * rate - length) > _WHOLE * max(length, 1):
        msg = (
            f"period must be a whole number >= 4 of samples at {rate:.10g} samples/s, got {period:.10g} s, "
            f"{period * rate:.8g} samples (has the card changed the sample rate?)"
        )
        raise SpectrumError(msg, at=("period",))
    if settle < 0:
        raise SpectrumError(f"settle must be >= 0 s, got {settle:g}", at=("settle",))
    first = int(np.ceil(settle / period - 1e-9))
    count = x.size // length - first
    if count < 1:
        msg = f"the recording must hold {first + 1} periods of {period:g} s, got {x.size / rate:g} s"
        raise SpectrumError(msg, at=("period",))
    span = slice(first * length, (first + count) * length)
    left, right = (2 / length * np.fft.rfft(v[span].reshape(count, length)) for v in (x, y))
    _check_alike(left, period)
    lines = _excited(left, length)
    found = repeated(left[:, lines], right[:, lines], level=_STEADY)
    doubts: tuple[Doubt, ...] = ()
    if found.drift is not None:
        share = float((found.drifts & (found.drift > _DRIFT)).mean())
        if share > 5 * (1 - _STEADY):
            detail = (
                f"{share:.0%} of the lines change between the first and the second half of the periods: the response had "
                "not settled (leave more out by `settle`), or the system changes"
            )
            doubts = (Doubt(kind="not_settled", detail=detail),)
    doubts = doubts or tuple(fading_doubts(left[:, lines], right[:, lines]))
    return Frf(
        frequency=2 * np.pi * rate / length * lines.astype(np.float64),
        value=found.value,
        magnitude_error=found.error,
        phase_error=found.error,
        freedom=2.0 * (count - 1),
        averages=count,
        effective_averages=float(count),
        resolution=2 * np.pi * rate / length,
        doubts=doubts,
    )


def _excited(
    left: np.ndarray[tuple[int, int], np.dtype[np.complex128]], length: int
) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the numbers of the lines that the input drives, those at 0 and at half the rate left out."""
    mean = np.abs(left.mean(axis=0))
    mean[0] = 0.0
    if length % 2 == 0:
        mean[-1] = 0.0
    driven = mean > _QUIET * mean.max()
    if len(left) > 1:
        driven &= mean**2 > _LOUD * left.var(axis=0, ddof=1) / len(left)
    return np.flatnonzero(driven)


def _check_alike(left: np.ndarray[tuple[int, int], np.dtype[np.complex128]], period: float) -> None:
    moving = left[:, 1:]
    if len(left) < 2:
        return
    differing = float(np.sqrt(moving.var(axis=0, ddof=1).sum() / (np.abs(moving) ** 2).mean(axis=0).sum()))
    if differing > _ALIKE:
        msg = f"input must repeat with the period of {period:g} s, but {differing:.0%} of one differ from the next"
        raise SpectrumError(msg, at=("period",))
