"""How many poles of a closed loop are unstable, counted without looking for one: the Nyquist criterion.

    Z = P - N,   2π N = the angle that 1 + L(jω) turns through, counter-clockwise, from ω = -∞ to ∞

P are the unstable poles of the open loop. Its poles on the imaginary axis are passed on their right, where each turns
1 + L back by π. The scan of L holds ln (1 + L) straight between neighbours, so the angle between them is certain.

References
----------
H. Nyquist, "Regeneration Theory", Bell System Technical Journal 11 (1932) 126-147; K. J. Astrom, R. M. Murray,
"Feedback Systems", 2nd ed., section 10.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.exact.frequency.response import SMALLEST_LOOP_GAIN

if TYPE_CHECKING:
    from engine.exact.frequency.poles import Poles
    from engine.exact.frequency.response import FrequencyResponse

_NEAR = 1e-10

_WHOLE = 0.1
"""How far a count may be from a whole number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NyquistCount:
    """``encirclements`` of -1 by L, counter-clockwise, and the unstable poles of the loop open and closed."""

    encirclements: int
    open_loop: int
    closed_loop: int


def nyquist_count(response: FrequencyResponse, opened: Poles, closed: Poles) -> NyquistCount | None:
    """Return the count, or None where L passes through -1, or goes round it further than its scan follows its phase.

    Parameters
    ----------
    response : FrequencyResponse
        L, signed so that 1 + L = 0 is the characteristic equation.
    opened, closed : Poles
        The poles of the loop; of the closed one only whether an echo without end is among them.
    """
    if opened.neutral or closed.neutral:
        return None
    omega, values = response.scan
    followed = omega <= response.resolved
    if np.any(np.abs(values[~followed]) >= 1):
        return None
    omega, values = omega[followed], values[followed]
    on_axis = opened.on_axis & ~opened.at_zero & (opened.values.imag > 0)
    passed = np.sort(opened.values.imag[on_axis])
    near = (np.abs(omega[:, None] - passed) < _NEAR * omega[:, None]).any(axis=1)  # there the phase is rounding
    seen = np.isfinite(values) & ~near
    omega, difference = omega[seen], 1 + values[seen]
    if np.any(np.abs(difference) < _NEAR):
        return None
    turns = np.angle(difference[1:] / difference[:-1])
    interval = np.searchsorted(passed, omega)
    turned = float(turns[interval[1:] == interval[:-1]].sum())  # over a pole on the axis the angle is known, not seen
    # a delay with a direct gain goes on turning about 1 + L(∞)
    end = 1 + float(response.direct[0].real)
    turned += float(np.angle(end / difference[-1]))
    whole = turned / np.pi - 0.5 * int(opened.at_zero.sum()) - len(passed)
    if abs(whole - round(whole)) > _WHOLE:
        return None
    unstable = int(((opened.values.real > 0) & ~opened.on_axis & ~opened.at_zero).sum())
    return NyquistCount(encirclements=round(whole), open_loop=unstable, closed_loop=unstable - round(whole))


def listed_to(response: FrequencyResponse) -> float | None:
    """Return the frequency, rad/s, up to which crossings are listed, where the loop gain has not faded by then."""
    omega, values = response.scan
    if response.resolved < omega[-1]:
        return response.resolved
    return float(omega[-1]) if response.system.m and abs(values[-1]) >= SMALLEST_LOOP_GAIN else None
