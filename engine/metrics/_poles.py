"""Which poles of a system metrics look at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.metrics._base import NEGLIGIBLE
from engine.model.tangent import INFINITESIMAL

_KEPT = np.exp(-1.0)
"""What is left of a pole after the delay of its loop, at least: a loop of integrator and delay that oscillates keeps more."""

if TYPE_CHECKING:
    from engine.exact.frequency.poles import Poles
    from engine.metrics._base import SystemSubject
    from engine.model.linear_system import Array


def oscillatory(subject: SystemSubject) -> list[tuple[Array, Array]]:
    """Return (real part, imaginary part) of the upper pole of every complex pair, with their infinitesimals.

    Of the endless chain of a loop with a delay those count that keep a part of themselves over the delay, and in any case the
    dominant pair: far from the origin the damping ratios go to 0 although the poles decay ever faster. Where all that are
    known keep as much, as of an echo, there may be more of them: then the dominant pair counts.
    """
    poles = subject.poles
    brief = poles.values.real * poles.delay < np.log(_KEPT)
    pairs, chained = [], False
    for k in np.flatnonzero(~_real(poles) & (poles.values.imag > 0)):  # by falling real part
        if not poles.endless[k] or not chained or (brief.any() and not brief[k]):
            chained = chained or bool(poles.endless[k])
            step = INFINITESIMAL * poles.motion[k]
            pairs.append((poles.values[k].real + 1j * step.real, poles.values[k].imag + 1j * step.imag))
    return pairs


def real_poles(subject: SystemSubject) -> list[Array]:
    """Return every real pole with its infinitesimals, but those at 0."""
    poles = subject.poles
    return [
        poles.values[k].real + 1j * INFINITESIMAL * poles.motion[k].real
        for k in np.flatnonzero(_real(poles) & ~poles.at_zero)
    ]


def _real(poles: Poles) -> npt.NDArray[np.bool_]:
    """Return which poles cannot be told from the real axis."""
    return np.asarray(np.abs(poles.values.imag) <= np.maximum(poles.uncertainty, NEGLIGIBLE * np.abs(poles.values)))
