"""The colour of what a model leaves unexplained: an autoregression, its order chosen by the Bayesian criterion.

    e_t + a_1 e_{t-1} + ... + a_n e_{t-n} = w_t,   w white;   n minimises N ln σ_w² + n ln N

It says how sure estimates are in coloured noise, and what a one-step prediction would make of the last residuals.

References
----------
S. M. Kay, "Modern Spectral Estimation", Prentice Hall 1988, section 7.5 (Burg's method).
G. Schwarz, "Estimating the dimension of a model", Ann. Statist. 6 (1978) 461-464.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.fft

from optimizers.estimation.filters import filtered

Samples = npt.NDArray[np.float64]

_MOST = 60
_SAMPLES_PER_COEFFICIENT = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class Autoregression:
    """Coefficients (1, a_1 ... a_n) and the variance of the innovations w."""

    coefficients: Samples
    variance: float

    @property
    def order(self) -> int:
        """How many earlier residuals the next one remembers."""
        return self.coefficients.size - 1

    def innovations(self, residuals: Samples) -> Samples:
        """Return w; at the beginning, where what it remembers was not recorded, the residuals themselves."""
        found = filtered(self.coefficients, [1.0], residuals)
        found[: self.order] = residuals[: self.order]
        return found

    def autocovariance(self, count: int) -> Samples:
        """Return the autocovariance at lags 0 … count - 1."""
        size = scipy.fft.next_fast_len(4 * max(count, 256), real=True)
        spectrum = self.variance / np.abs(scipy.fft.rfft(self.coefficients, size)) ** 2
        return np.asarray(scipy.fft.irfft(spectrum, size)[:count])


def fitted(residuals: Samples) -> Autoregression:
    """Return the autoregression of residuals by Burg's method, which is stable whatever they are.

    Parameters
    ----------
    residuals : ndarray, shape (samples,) or (parts, samples)
        Parts of a signal that have one variance and one colour: the real and the imaginary part of complex errors.
    """
    n, length = residuals.size, residuals.shape[-1]
    forward, backward = residuals[..., 1:], residuals[..., :-1]
    power = float(np.vdot(residuals, residuals)) / max(n, 1)
    coefficients = best = np.ones(1)
    variance = power
    if power == 0:
        return Autoregression(coefficients=best, variance=0.0)
    least = n * math.log(power)
    for order in range(1, min(_MOST, length // _SAMPLES_PER_COEFFICIENT) + 1):
        energy = float(np.vdot(forward, forward) + np.vdot(backward, backward))
        if energy <= 1e-28 * n * variance:
            break  # predicted exactly already
        reflection = -2 * float(np.vdot(forward, backward)) / energy
        padded = np.append(coefficients, 0.0)
        coefficients = padded + reflection * padded[::-1]
        forward, backward = (forward + reflection * backward)[..., 1:], (backward + reflection * forward)[..., :-1]
        power *= 1 - reflection**2
        if power <= 0:
            break
        criterion = n * math.log(power) + order * math.log(n)
        if criterion < least:
            least, best, variance = criterion, coefficients, power
    return Autoregression(coefficients=best, variance=variance)
