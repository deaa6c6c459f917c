"""Delays far shorter than the samples and than every lag, as lags themselves: no segment then needs to be that short.

    e^{-sτ} ≈ N(sτ) / D(sτ)  of degrees 4 and 5, with |sτ|¹⁰ / 4.6e8 left: 1e-14 for |s| τ = 0.3

The two differ for high frequencies only: in a step, for a few τ after its edge. The mean over a sampling interval of at
least 8 τ does not see that, because the first ten moments are the delay's own.

References
----------
H. Padé's table of the exponential function: G. Golub, C. Van Loan, "Matrix Computations", 4th ed., 2013, section 9.3.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.linear.system import ARRAYS
from engine.linear.tangent import INFINITESIMAL

if TYPE_CHECKING:
    from engine.linear.system import Array, LaneSystem

Real = npt.NDArray[np.float64]

ORDER = 5
SAMPLES = 8.0
"""How many such delays at least fit into a sampling interval."""
REACH = 0.3
"""Largest product of a delay with the fastest rate of the system."""

_SHORTEST = 1e-4


def without_short_delays(system: LaneSystem, sample_time: float) -> LaneSystem:
    """Return the system with its shortest delays replaced by lags of the fifth order, exact to rounding at the samples.

    Parameters
    ----------
    system : LaneSystem
    sample_time : float
        Distance (s) of the instants at which the response to a line between samples is asked for.
    """
    if not system.m:
        return system
    delays = system.delays[0].real
    short = (delays <= sample_time / SAMPLES) & (delays * _fastest(system) <= REACH)
    if not short.any():
        return system
    s, k = np.flatnonzero(short), np.flatnonzero(~short)
    lanes, n, q = system.lanes, system.n, ORDER * len(s)
    state, drive, read = (np.kron(np.eye(len(s)), block) for block in _lag())
    rate = np.repeat(1 / system.delays[:, s], ORDER, axis=1)[:, :, None]  # (lanes, q, 1)
    enter = rate * drive  # what the delayed signals' sources do to the new states

    def empty(rows: int, columns: int) -> Array:
        return np.zeros((lanes, rows, columns), dtype=system.dtype)

    a = empty(n + q, n + q)
    a[:, :n, :n] = system.a
    a[:, :n, n:] = system.b2[:, :, s] @ read
    a[:, n:, :n] = enter @ system.c2[:, s]
    a[:, n:, n:] = rate * state + enter @ system.d22[:, s][:, :, s] @ read
    return replace(
        system,
        a=a,
        b1=np.concatenate([system.b1, enter @ system.d21[:, s]], axis=1),
        b2=np.concatenate([system.b2[:, :, k], enter @ system.d22[:, s][:, :, k]], axis=1),
        c1=np.concatenate([system.c1, system.d12[:, :, s] @ read], axis=2),
        c2=np.concatenate([system.c2[:, k], system.d22[:, k][:, :, s] @ read], axis=2),
        d12=system.d12[:, :, k],
        d21=system.d21[:, k],
        d22=system.d22[:, k][:, :, k],
        delays=system.delays[:, k],
        x0=np.concatenate([system.x0, np.zeros((lanes, q))], axis=1),
    )


def lifted(system: LaneSystem, sample_time: float) -> tuple[LaneSystem, Real]:
    """Return the system with delays below 1e-4 samples lifted to that, and how far each must be moved back.

    Lags of the fifth order that are still faster would be lost in rounding. Every lifted delay gets a lane of its own
    behind the others, so that its small rest is one step of first order: what this leaves is of the order of 1e-9.

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


def _fastest(system: LaneSystem) -> float:
    """Return the fastest rate (1/s) of the system with its delays cut open, and with none."""
    a, b, c, d = system.a[0].real, system.b2[0].real, system.c2[0].real, system.d22[0].real
    inner = np.eye(system.m) - d
    if abs(np.linalg.det(inner)) < 1e-9:
        return np.inf
    closed = a + b @ np.linalg.solve(inner, c)
    return float(max((np.abs(np.linalg.eigvals(m)).max(initial=0.0) for m in (a, closed)), default=0.0))


@cache
def _lag() -> tuple[Real, Real, Real]:
    """Return state matrix, input column and output row of the lag for a delay of 1."""
    p, q = ORDER - 1, ORDER
    numerator = [(-1) ** j * _coefficient(p, q, j) for j in range(p + 1)]
    denominator = [_coefficient(q, p, j) for j in range(q + 1)]
    # its poles lie near |s| = 6: states scaled by powers of 6 are of like size
    size = 6.0 ** np.arange(q)
    state = np.diag(np.full(q - 1, 6.0), 1)
    state[-1] = -np.array(denominator[:q]) / denominator[q] * size / size[-1]
    drive = np.zeros((q, 1))
    drive[-1] = 1 / denominator[q] / size[-1]
    return state, drive, (np.array(numerator) * size)[None]


def _coefficient(own: int, other: int, j: int) -> float:
    return factorial(own + other - j) * factorial(own) / (factorial(own + other) * factorial(j) * factorial(own - j))
