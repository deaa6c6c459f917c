"""How often a mode turns within the common period: several rates see more than the slowest.

x(t) = z^{t/P} Σ_m x_m e^{2πj m t/P}: a mode that turns several times within a period is told at the frequency of its strongest part.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.sampled_data.period import Period

if TYPE_CHECKING:
    from engine.exact.sampled_data.system import SampledSystem

Complex = npt.NDArray[np.complex128]


def marked(system: SampledSystem, looks: int) -> Period:
    """Return a period that is looked at several times between two of its events, at equal distances."""
    period = Period(system)
    count = looks * (len(period.events) + 1)
    return Period(system, np.arange(count) * (float(period.length[0].real) / count), period.events)


def turns(eigenvalues: Complex, seen: Complex) -> npt.NDArray[np.int64]:
    """Return how many turns per period each mode (k,) makes more than ln z says.

    Parameters
    ----------
    eigenvalues : ndarray, shape (k,)
        z of each mode.
    seen : ndarray, shape (times, signals, k)
        What is seen of the modes at equal distances over the period; every signal counts alike.
    """
    count = len(seen)
    shares = np.arange(count)[:, None] / count
    upright = seen * np.exp(-np.log(eigenvalues.astype(complex)) * shares)[:, None]
    parts = np.fft.fft(upright / np.maximum(np.abs(upright).max(axis=0), 1e-300), axis=0)
    listed = np.arange(-count // 4, count // 4 + 1)
    strength = (np.abs(parts[listed]) ** 2).sum(axis=1)
    away = np.abs(np.angle(eigenvalues) + 2 * np.pi * listed[:, None])
    away[strength < strength.max(axis=0) * (1 - 1e-9)] = np.inf
    return np.asarray(listed[away.argmin(axis=0)])
