"""Measured against simulated: fit measures by name, trivial baselines, the worst interval, what the residuals still hold.

    fit = 100 (1 - ||y - ŷ|| / ||y - mean y||)          relative error = 100 ||y - ŷ|| / ||y||
    vaf = 100 (1 - var(y - ŷ) / var y)                  nrmse = 100 rms(y - ŷ) / max y

Papers call different ones of these "fit": 95 % of one is not 95 % of another, so all are reported, each under its name.
A measure whose denominator vanishes (a constant measurement has no variance) does not exist and is None.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

Signal = npt.NDArray[np.float64]

DEFINITIONS: Mapping[str, str] = MappingProxyType(
    {
        "fit_percent": "100 (1 - ||y - ŷ|| / ||y - mean y||): 100 is perfect, 0 the mean of the measurement",
        "relative_error_percent": "100 ||y - ŷ|| / ||y||: 0 is perfect; the verdict is about this one",
        "vaf_percent": "100 (1 - var(y - ŷ) / var y): 100 is perfect; blind to a constant error",
        "nrmse_percent": "100 rms(y - ŷ) / max y: 0 is perfect",
    }
)
"""Each measure of :class:`Fit` by name, y measured and ŷ simulated (never a one-step prediction)."""

_ROUNDING = 1e-14
"""Below this share of its own size a spread is the rounding of a constant."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """How well one signal reproduces another, in percent; None where a measure does not exist.

    ``fit_percent`` is 100 for a perfect model, 0 for the mean of the measurement, negative for worse;
    ``relative_error_percent`` and ``nrmse_percent`` are 0 for a perfect model.
    """

    fit_percent: float | None
    relative_error_percent: float | None
    vaf_percent: float | None
    nrmse_percent: float | None


def compare(measured: Signal, simulated: Signal) -> Fit:
    """Return the fit measures of a simulated signal.

    Parameters
    ----------
    measured, simulated : ndarray, shape (samples,)
        In the same unit.

    Raises
    ------
    ValueError
        For signals of different length, or without a sample.

    References
    ----------
    L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, section 16.4 (fit);
    R. Babuška, "Fuzzy Modeling for Control", Kluwer 1998 (variance accounted for).

    Examples
    --------
    >>> compare(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0])).relative_error_percent
    44.721359549995796
    """
    _check(measured, simulated)
    error = measured - simulated
    spread = float(np.linalg.norm(measured - measured.mean()))
    size = float(np.linalg.norm(measured))
    varies = spread > _ROUNDING * size
    peak = float(measured.max())
    distance = float(np.linalg.norm(error))
    return Fit(
        fit_percent=100 * (1 - distance / spread) if varies else None,
        relative_error_percent=100 * distance / size if size > 0 else None,
        vaf_percent=100 * (1 - float(error.var()) / float(measured.var())) if varies else None,
        nrmse_percent=100 * distance / math.sqrt(measured.size) / peak if peak > 0 else None,
    )


def baselines(measured: Signal, inputs: Signal, *, constant: bool = False) -> Mapping[str, Fit]:
    """Return what models without any dynamics achieve on the same samples: a model must beat them to say something.

    Parameters
    ----------
    measured : ndarray, shape (samples,)
    inputs : ndarray, shape (inputs, samples)
        What drove the system.
    constant : bool
        Whether each baseline may add its own best constant, as a model does whose offset is estimated.

    Returns
    -------
    mapping of str to Fit
        ``mean``: the mean of the measurement; ``input``: the input itself (the best of several); ``static_gain``:
        the best combination of the inputs with constant gains.
    """
    columns = inputs.T
    level = measured.mean() if constant else 0.0
    copies = [u + (level - u.mean() if constant else 0.0) for u in inputs]
    regressors = np.column_stack([columns, np.ones(measured.size)]) if constant else columns
    gains = np.linalg.lstsq(regressors, measured, rcond=None)[0]
    return {
        "mean": compare(measured, np.full(measured.size, measured.mean())),
        "input": compare(measured, min(copies, key=lambda u: float(np.linalg.norm(measured - u)))),
        "static_gain": compare(measured, regressors @ gains),
    }


def worst_interval(
    measured: Signal, simulated: Signal, *, sample_time: float, share: float = 0.05
) -> tuple[float, float]:
    """Return begin and end (s from the first sample) of the interval with the largest mean squared error.

    Parameters
    ----------
    measured, simulated : ndarray, shape (samples,)
    sample_time : float
        Distance of two samples in s.
    share : float
        Length of the interval as a share of the whole.
    """
    _check(measured, simulated)
    length = min(max(round(share * measured.size), 2), measured.size)
    energy = np.concatenate([[0.0], np.cumsum((measured - simulated) ** 2)])
    first = int(np.argmax(energy[length:] - energy[:-length]))
    return first * sample_time, (first + length - 1) * sample_time


def passes(fits: Mapping[str, Fit], limit_percent: float) -> bool:
    """Return whether the relative error of every output exists and stays within the limit, in percent."""
    return all(
        fit.relative_error_percent is not None and fit.relative_error_percent <= limit_percent for fit in fits.values()
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResidualTests:
    """Whether the residuals of one output hold what a better model would explain.

    Attributes
    ----------
    autocorrelation : ndarray, shape (lags + 1,)
        Of the residuals, normalised; from lag 0.
    autocorrelation_bound : float
        What 99 % of the values stay below in size when the residuals are white.
    ljung_box, ljung_box_limit : float
        n (n + 2) Σ_k r_k² / (n - k) over the lags k, and what it stays below in 99 % of white residuals.
    white : bool
        Whether it does. A model can be good and its residuals not white: the disturbances of a real drive are coloured.
    cross_correlation : ndarray, shape (inputs, 2 lags + 1)
        Between each input (earlier samples for positive lags) and the residuals, normalised; from -lags.
    cross_correlation_bound : ndarray, shape (inputs,)
        The same 99 % bound for each input; it allows for the colour of residuals and input.
    independent : bool
        Whether at most 1 in 20 of the lags from 0 on exceeds the bound: nothing is left that the input would explain linearly.
    """

    autocorrelation: Signal
    autocorrelation_bound: float
    ljung_box: float
    ljung_box_limit: float
    white: bool
    cross_correlation: Signal
    cross_correlation_bound: Signal
    independent: bool


def examine_residuals(residuals: Signal, inputs: Signal, *, lags: int = 25) -> ResidualTests:
    """Return the whiteness of the residuals and their correlation with the inputs.

    Parameters
    ----------
    residuals : ndarray, shape (samples,)
    inputs : ndarray, shape (inputs, samples)
    lags : int
        Largest lag in samples.

    References
    ----------
    L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, section 16.6.
    G. M. Ljung, G. E. P. Box, "On a measure of lack of fit in time series models", Biometrika 65 (1978) 297-303.
    """
    from scipy.special import chdtri  # noqa: PLC0415 - a tenth of a second

    n = residuals.size
    lags = min(lags, n - 1)
    e = residuals - residuals.mean()
    own = correlation(e, e)
    power = own[n - 1]
    autocorrelation = own[n - 1 : n + lags] / power if power > 0 else np.zeros(lags + 1)
    bound = 2.576 / np.sqrt(n)
    statistic = n * (n + 2) * float(np.sum(autocorrelation[1:] ** 2 / (n - np.arange(1, lags + 1))))
    limit = float(chdtri(lags, 0.01)) if lags else 0.0
    rows, bounds = [], []
    for signal in inputs:
        u = signal - signal.mean()
        other = correlation(u, u)
        scale = np.sqrt(power * other[n - 1])
        rows.append(correlation(e, u)[n - 1 - lags : n + lags] / scale if scale > 0 else np.zeros(2 * lags + 1))
        # Bartlett: the variance of the estimate is the sum of the products of both autocorrelations
        colour = float(own @ other) / (scale**2) if scale > 0 else 1.0
        bounds.append(2.576 * np.sqrt(max(colour, 1.0) / n))
    cross = np.array(rows).reshape(len(inputs), 2 * lags + 1)
    cross_bound = np.array(bounds)
    return ResidualTests(
        autocorrelation=autocorrelation,
        autocorrelation_bound=float(bound),
        ljung_box=statistic,
        ljung_box_limit=limit,
        white=statistic <= limit,
        cross_correlation=cross,
        cross_correlation_bound=cross_bound,
        independent=bool(np.all(np.mean(np.abs(cross[:, lags:]) > cross_bound[:, None], axis=1) <= 0.05)),
    )


def correlation(first: Signal, second: Signal) -> Signal:
    """Return Σ_t first(t + k) second(t) for k = -(n - 1) … n - 1, by the fast Fourier transform."""
    n = first.size
    size = 1 << (2 * n - 1).bit_length()
    product = np.fft.rfft(first, size) * np.conj(np.fft.rfft(second, size))
    circular = np.fft.irfft(product, size)
    return np.concatenate([circular[-(n - 1) :] if n > 1 else circular[:0], circular[:n]])


def _check(measured: Signal, simulated: Signal) -> None:
    if measured.ndim != 1 or measured.shape != simulated.shape or measured.size == 0:
        raise ValueError(
            f"measured and simulated must be signals of equal length, got shapes {measured.shape} and {simulated.shape}"
        )
