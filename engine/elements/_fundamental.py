"""What describing functions share: the fundamental of a sine that is cut off, relative to the sine.

f(r) = (2/π) (arcsin r + r sqrt(1 - r²))   for |r| <= 1, its end values beyond
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def limited(ratio: Any) -> npt.NDArray[np.float64]:
    """Return the gain of a limiter for the sine's fundamental, ``ratio`` being the limit over the amplitude.

    Odd in ``ratio``.

    References
    ----------
    A. Gelb, W. Vander Velde, "Multiple-Input Describing Functions and Nonlinear System Design", McGraw-Hill 1968,
    section 2.3.
    """
    r = np.clip(ratio, -1.0, 1.0)
    return np.asarray(2 / np.pi * (np.arcsin(r) + r * np.sqrt(1 - r * r)))
