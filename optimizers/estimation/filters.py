"""Linear recursions along a recording:  a_0 y_n = Σ b_k x_{n-k} - Σ a_k y_{n-k}.

To load `scipy.signal`, which loads `scipy.stats`, is a fifth of a service's start: only who identifies pays for it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Samples = npt.NDArray[np.float64]


def filtered(b: Any, a: Any, x: Samples) -> Samples:
    """Return y, shape of ``x``: at rest before it."""
    from scipy.signal import lfilter  # noqa: PLC0415 -- see above

    return np.asarray(lfilter(b, a, x), dtype=np.float64)
