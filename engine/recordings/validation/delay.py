"""Is it late?   ŷ(t - τ), τ where the cross-correlation with the measurement peaks, refined between the samples."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from engine.recordings.fit import correlation
from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.remedy import Remedy, worthwhile

_FARTHEST = 0.1
"""The largest delay that is looked for, as a share of the window."""


def delay(comparison: Comparison) -> Remedy | None:
    """Return the time by which the measurement lags the model; None where a shift explains nothing."""
    n, h = comparison.measured.size, comparison.sample_time
    reach = int(_FARTHEST * n)
    if reach < 1:
        return None
    model = comparison.simulated
    shared = correlation(comparison.measured - comparison.measured.mean(), model - model.mean())
    near = shared[n - 1 - reach : n + reach]
    first = int(np.argmax(near)) - reach
    index = np.arange(n, dtype=np.float64)

    def distance(samples: float) -> float:
        left = comparison.free(comparison.measured - np.interp(index - samples, index, model))
        return float(left @ left)

    found = minimize_scalar(distance, bounds=(first - 1.0, first + 1.0), method="bounded", options={"xatol": 1e-3})
    samples = float(found.x)
    left = comparison.relative_error(comparison.measured - np.interp(index - samples, index, model))
    if left is None or not worthwhile(left, comparison.present_error):
        return None
    late = samples > 0
    return Remedy(
        kind="delay",
        relative_error_percent=left,
        values={"delay": samples * h},
        sentence=(
            f"{comparison.name} comes {abs(samples) * h:.4g} s {'later' if late else 'earlier'} than the model: "
            + (
                "a delay, a filter of the measurement or a lag of the valve is missing or too short."
                if late
                else "a delay or lag of the model is too long, or the channels were not sampled together."
            )
        ),
    )
