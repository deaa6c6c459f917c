"""Which frequencies a reader wants to see: where a response bends, peaks and crosses, and a little beyond.

The range reaches from the lowest to the highest of the corners (poles and zeros), the summit, the crossings of |G| = 1
and of a loop the phase crossing that is nearest to -1, and 1.25 decades beyond both. It ends earlier where the response
has faded: 100 dB below 1 where it crosses that, and otherwise below what it nearly reaches. A delay alone bends no
magnitude: the turns of its phase widen nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.shapes import squared_magnitude

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.exact.frequency.response import FrequencyResponse

Real = npt.NDArray[np.float64]

BEYOND: Final = 10**1.25
"""How far the range goes on beyond what is to be seen, as a factor."""
FADED: Final = 1e-5
"""What is less than this part of the response is shown no further."""
_MOST = 800
_EVEN, _NEARLY_ALL = 200, 0.9


def shown(curve: FrequencyResponse, gain_margins: Sequence[tuple[float, float]] = ()) -> Real:
    """Return frequencies (rad/s, rising) that show a response: evenly on the log axis, and dense where it bends.

    Parameters
    ----------
    curve : FrequencyResponse
    gain_margins : sequence of (frequency, margin), optional
        Of an open loop; the range holds the one that is nearest to 1.
    """
    crossings = [float(w[0].real) for w in curve.crossings(squared_magnitude, 1.0)]
    nearest = min((one for one in gain_margins if one[0] > 0), key=lambda one: abs(np.log(one[1])), default=None)
    told = np.array([*crossings, *([nearest[0]] if nearest else [])])
    low, high = _range(curve, told)
    scan = curve.scan[0]
    inside = scan[(scan >= low) & (scan <= high)]
    stride = max(1, len(inside) // (_MOST // 2))
    return np.unique(np.concatenate([np.geomspace(low, high, _MOST // 2), inside[::stride], told]))


def _range(curve: FrequencyResponse, told: Real) -> tuple[float, float]:
    """Return the ends of what is shown; ``told`` lies inside."""
    scan, values = curve.scan
    magnitude = np.abs(values)
    marks = np.concatenate([told, curve.bends, _summit(scan, magnitude)])
    if not len(marks):
        delay = float(curve.system.delays[0].real.sum())
        marks = np.array([1 / delay if delay else 1.0])
    low, high = max(marks.min() / BEYOND, scan[0]), min(marks.max() * BEYOND, scan[-1])
    # nearly the largest: the tip of a needle is worth nothing to what surrounds it
    even = np.abs(curve(np.geomspace(low, high, _EVEN)))
    worth = 1.0 if len(told) else float(np.quantile(even[np.isfinite(even)], _NEARLY_ALL))
    seen = np.flatnonzero((magnitude > FADED * worth) & (scan >= low) & (scan <= high))
    if not len(seen):  # nothing comes through, a valve that is closed at rest say
        return low, high
    first, last = scan[max(seen[0] - 1, 0)], scan[min(seen[-1] + 1, len(scan) - 1)]
    return max(low, min(first, told.min(initial=np.inf))), min(high, max(last, told.max(initial=0.0)))


def _summit(scan: Real, magnitude: Real) -> Real:
    """Return where the magnitude is largest, unless it is at an end: none, or one frequency."""
    at = int(np.argmax(magnitude))
    return scan[at : at + 1] if 0 < at < len(scan) - 1 and magnitude[at] > magnitude[0] else scan[:0]
