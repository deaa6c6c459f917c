"""Delays of (nearly) 0, which an estimation may pass through: responded to at a small delay, and moved back.

y(0) = y(τ) - τ ∂y/∂τ + O(τ²),   τ = 1e-4 sampling intervals
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.model.linear_system import ARRAYS
from engine.model.tangent import INFINITESIMAL

if TYPE_CHECKING:
    from engine.model.linear_system import LaneSystem

Real = npt.NDArray[np.float64]

_SHORTEST = 1e-4


def lifted(system: LaneSystem, sample_time: float) -> tuple[LaneSystem, Real]:
    """Return the system with delays below 1e-4 samples lifted to that, and how far each must be moved back.

    Every lifted delay gets a lane of its own behind the others, so that its small rest is one step of first order: what
    this leaves is of the order of 1e-9.

    Returns
    -------
    system : LaneSystem
    moves : ndarray, shape (extra lanes,)
        In s, not positive.
    """
    delays = system.delays[0].real
    tiny = np.flatnonzero(delays < _SHORTEST * sample_time)
    if not tiny.size:
        return system, np.zeros(0)
    floor = _SHORTEST * sample_time
    lanes = np.concatenate([np.arange(system.lanes), np.zeros(tiny.size, dtype=np.intp)])
    parts = {name: getattr(system, name)[lanes].astype(complex) for name in ARRAYS}
    for name, array in parts.items():
        parts[name][system.lanes :] = array[system.lanes :].real
    parts["delays"][:, tiny] += floor - delays[tiny]
    parts["delays"][system.lanes + np.arange(tiny.size), tiny] += 1j * INFINITESIMAL
    return replace(system, **parts), delays[tiny] - floor
