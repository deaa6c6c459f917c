"""First-order lags solved by hand, so that no test compares the engine with itself."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

H = 0.001


def lag(u: np.ndarray, *, k: float = 1.0, tau: float = 0.05, h: float = H) -> np.ndarray:
    """Return k / (tau s + 1) driven by an input held between its samples: y[n] = a y[n - 1] + (1 - a) k u[n - 1]."""
    a = np.exp(-h / tau)
    return lfilter([0.0, (1 - a) * k], [1.0, -a], u)


def chirp(samples: int = 4000) -> np.ndarray:
    """Return a chirp from 0.5 to 8.5 Hz at 1 kHz."""
    time = H * np.arange(samples)
    return np.sin(2 * np.pi * (0.5 * time + time**2))
