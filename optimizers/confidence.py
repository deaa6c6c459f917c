"""How sure least-squares estimates are when the residuals are not white.

    cov p = (JᵀJ)⁻¹ JᵀRJ (JᵀJ)⁻¹,    R_ts = w(t - s) c(t - s),   c: autocovariance of the residuals, w: Bartlett's window

White residuals give back s² (JᵀJ)⁻¹. What the data leave undetermined gets an enormous variance instead of an error.

References
----------
W. Newey, K. West, "A simple, positive semi-definite, heteroskedasticity and autocorrelation consistent covariance
matrix", Econometrica 55 (1987) 703-708.
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, section 9.3 (coloured residuals).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import scipy.fft

from engine.fit import correlation

Matrix = npt.NDArray[np.float64]

_UNDETERMINED = 1e-9
"""Directions of the (scaled) parameters that move the residuals less than this, relative to the strongest, are unseen."""


def covariance(jacobian: Matrix, residuals: Matrix) -> Matrix:
    """Return the covariance of least-squares estimates.

    Parameters
    ----------
    jacobian : ndarray, shape (signals, samples, n)
        Derivatives of the residuals at the estimate, signal by signal.
    residuals : ndarray, shape (signals, samples)
        Of mean zero or not; different signals are taken to be uncorrelated.

    Returns
    -------
    ndarray, shape (n, n)
    """
    signals, samples, n = jacobian.shape
    scale = np.linalg.norm(jacobian, axis=(0, 1))
    scale[scale == 0] = 1.0
    left, strength, right = np.linalg.svd((jacobian / scale).reshape(signals * samples, n), full_matrices=False)
    strength = np.maximum(strength, _UNDETERMINED * max(float(strength[0]), 1e-300))
    middle = np.zeros((n, n))
    for block, residual in zip(left.reshape(signals, samples, n), residuals, strict=True):
        middle += block.T @ _coloured(block, residual)
    middle *= signals * samples / max(signals * samples - n, 1)
    root = right.T / strength
    return np.asarray(root @ middle @ root.T / np.outer(scale, scale))


def _coloured(columns: Matrix, residual: Matrix) -> Matrix:
    """Return R times each column, R the banded Toeplitz matrix of the windowed autocovariance."""
    n = residual.size
    # wide enough for the slow errors of a model, narrow enough to average: grows slower than the samples
    width = min(n, math.ceil(4 * math.sqrt(n)))
    lag = np.arange(width)
    autocovariance = correlation(residual, residual)[n - 1 : n - 1 + width] / n * (1 - lag / width)
    size = scipy.fft.next_fast_len(n + width, real=True)
    kernel = np.zeros(size)
    kernel[:width] = autocovariance
    kernel[size - width + 1 :] = autocovariance[:0:-1]
    product = scipy.fft.rfft(kernel)[:, None] * scipy.fft.rfft(columns, size, axis=0)
    return np.asarray(scipy.fft.irfft(product, size, axis=0)[:n])


def correlations(cov: Matrix) -> Matrix:
    """Return the correlation matrix of a covariance matrix; an estimate without variance is correlated with itself alone."""
    deviation = np.sqrt(np.diag(cov))
    deviation[deviation == 0] = np.inf
    result = np.clip(cov / np.outer(deviation, deviation), -1.0, 1.0)
    np.fill_diagonal(result, 1.0)
    return np.asarray(result)
