"""One-step prediction, so that nobody takes it for a simulation.

    ŷ(t | t - 1) = ŷ(t) + Σ_k a_k e(t - k),   e = measured - simulated

A prediction knows the measurement up to the sample before; between two samples little happens, and even "nothing changes"
(the last sample repeated) scores high. It says how well the disturbances are described, not the system.

References
----------
L. Ljung, "System Identification: Theory for the User", 2nd ed., Prentice Hall 1999, section 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

from engine.recordings.fit import Fit, compare, correlation
from engine.recordings.validation.comparison import Comparison

ORDER = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class OneStep:
    """How well the next sample is foretold.

    ``model`` by the simulation and an autoregression of its residual, ``last_sample`` by the sample before.
    """

    model: Fit
    last_sample: Fit
    order: int


def one_step(comparison: Comparison, *, order: int = ORDER) -> OneStep | None:
    """Return the fits of one-step predictions, None for a window of fewer than 10 samples for each coefficient.

    Parameters
    ----------
    comparison : Comparison
    order : int
        Of the autoregression (Yule and Walker).
    """
    measured, residual = comparison.measured, comparison.residual
    n = measured.size
    if n < 10 * order:
        return None
    own = correlation(residual, residual)[n - 1 : n + order] / n
    expected = np.zeros(n)
    if own[0] > 0.0:
        # a touch of white noise keeps the equations solvable for residuals that one frequency makes
        column = own[:order].copy()
        column[0] *= 1 + 1e-9
        for k, weight in enumerate(solve_toeplitz(column, own[1:]), start=1):
            expected[k:] += weight * residual[:-k]
    offset = float(np.mean(measured - comparison.simulated)) if comparison.constant else 0.0
    predicted = comparison.simulated + offset + expected
    return OneStep(
        model=compare(measured[order:], predicted[order:]),
        last_sample=compare(measured[order:], measured[order - 1 : -1]),
        order=order,
    )
