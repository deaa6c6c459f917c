"""Step metrics read off a sampled curve, for peers that return curves and no metrics."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]


def step_metrics(time: Real, curve: Real) -> dict[str, float]:
    """Return the metrics of a response to a unit step that ends at 1, crossings interpolated linearly.

    Parameters
    ----------
    time, curve : ndarray, shape (samples,)
    """
    outside = np.flatnonzero(np.abs(curve - 1.0) > 0.02)
    last = int(outside[-1])
    edge = 1.0 + 0.02 * np.sign(curve[last] - 1.0)
    top = int(np.argmax(curve))
    return {
        "rise_time": first_crossing(time, curve, 0.9) - first_crossing(time, curve, 0.1),
        "settling_time": _between(time, curve, last, edge),
        "overshoot": float(curve[top]) - 1.0,
        "peak_time": float(time[top]),
    }


def first_crossing(time: Real, curve: Real, level: float) -> float:
    """Return when the curve first reaches the level."""
    return _between(time, curve, int(np.argmax(curve >= level)) - 1, level)


def _between(time: Real, curve: Real, index: int, level: float) -> float:
    share = (level - curve[index]) / (curve[index + 1] - curve[index])
    return float(time[index] + share * (time[index + 1] - time[index]))
