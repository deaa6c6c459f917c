"""How sure least-squares estimates are when the residuals are not white.

    cov p = (JᵀJ)⁻¹ JᵀRJ (JᵀJ)⁻¹,    R_ts = c(t - s),   c: autocovariance of the autoregression fitted to the residuals

White residuals give back s² (JᵀJ)⁻¹. What the data leave undetermined gets an enormous variance instead of an error.

References
----------
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, section 9.3 (coloured residuals).
D. Andrews, J. Monahan, "An improved heteroskedasticity and autocorrelation consistent covariance matrix estimator",
Econometrica 60 (1992) 953-966 (why an autoregression: windowed sample autocovariances are too small in strong colour).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy.fft

from optimizers.estimation.noise import fitted

Matrix = npt.NDArray[np.float64]

_UNDETERMINED = 1e-9
"""Directions of the (scaled) parameters that move the residuals less than this, relative to the strongest, are unseen."""


def covariance(jacobians: Sequence[Matrix] | Matrix, residuals: Sequence[Matrix] | Matrix) -> Matrix:
    """Return the covariance of least-squares estimates.

    Parameters
    ----------
    jacobians : sequence of ndarray, each (samples, n)
        Derivatives of the residuals at the estimate, signal by signal; the parts of a signal one after the other.
    residuals : sequence of ndarray, each (samples,) or (parts, samples)
        Different signals are taken to be uncorrelated, and so are the parts of one, which have one variance and colour.

    Returns
    -------
    ndarray, shape (n, n)
    """
    lengths = [len(block) for block in jacobians]
    joint = np.concatenate(list(jacobians))
    samples, n = joint.shape
    scale = np.linalg.norm(joint, axis=0)
    scale[scale == 0] = 1.0
    left, strength, right = np.linalg.svd(joint / scale, full_matrices=False)
    strength = np.maximum(strength, _UNDETERMINED * max(float(strength[0]), 1e-300))
    middle = np.zeros((n, n))
    for block, residual in zip(np.split(left, np.cumsum(lengths)[:-1]), residuals, strict=True):
        middle += block.T @ _coloured(block, residual)
    middle *= samples / max(samples - n, 1)
    root = right.T / strength
    return np.asarray(root @ middle @ root.T / np.outer(scale, scale))


def _coloured(columns: Matrix, residual: Matrix) -> Matrix:
    """Return R times each column, R the Toeplitz matrix of the residuals' autocovariance."""
    n = residual.shape[-1]
    noise = fitted(residual)
    if noise.order == 0:
        return noise.variance * columns
    parts = columns.reshape(-1, n, columns.shape[1])
    autocovariance = noise.autocovariance(n)
    size = scipy.fft.next_fast_len(2 * n, real=True)
    kernel = np.zeros(size)
    kernel[:n] = autocovariance
    kernel[size - n + 1 :] = autocovariance[:0:-1]
    product = scipy.fft.rfft(kernel)[:, None] * scipy.fft.rfft(parts, size, axis=1)
    return np.asarray(scipy.fft.irfft(product, size, axis=1)[:, :n]).reshape(columns.shape)


def correlations(cov: Matrix) -> Matrix:
    """Return the correlation matrix of a covariance matrix; an estimate without variance is correlated with itself alone."""
    deviation = np.sqrt(np.diag(cov))
    deviation[deviation == 0] = np.inf
    result = np.clip(cov / np.outer(deviation, deviation), -1.0, 1.0)
    np.fill_diagonal(result, 1.0)
    return np.asarray(result)
