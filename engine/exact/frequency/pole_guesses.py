"""Where the poles of a system with delays may be: what Newton's method begins with.

The delay lines, discretised as transport equations, have eigenvalues that are near the rightmost poles as far as their nodes
resolve a wave on a line. Above that frequency the poles solve

    e^{s τ} = M(s) = D22 + C2 (sI - A)⁻¹ B2,

so they lie 2π/τ apart along Re s = ln |M| / τ, the rightmost near the tops of |M(jω)|. Beside a very short delay the poles
without it are the best guesses.

References
----------
D. Breda, S. Maset, R. Vermiglio, "Stability of Linear Delay Differential Equations", Springer 2015, chapter 5.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.linalg import matrix_balance

if TYPE_CHECKING:
    from engine.model.linear_system import LaneSystem

Complex = npt.NDArray[np.complex128]

_MOST = 16
"""So many of the rightmost poles of a delay system are looked for, beside twice its states."""
_SCANNED, _TOPS, _BESIDE = 200, 5, 6
"""Where the loop gain rises again: frequencies that are looked at, tops, and guesses on each side of one, three to a pole."""
_SILENT = 1e-3
"""A gain that makes no poles worth looking for."""


def guesses(system: LaneSystem) -> Complex:
    """Return guesses of the rightmost poles, upper half plane only.

    Parameters
    ----------
    system : LaneSystem
        With delays, all of one circle.
    """
    tau = float(system.delays[0].real.max())
    sure = _nodes(system.m) / tau
    found = _discretised(system)
    found = _rightmost(
        found[found.imag >= -1e-9 * np.abs(found)], most=_MOST + 2 * system.n, sure=sure, leave=60.0 / tau
    )
    slow = _without_delays(system)
    return np.concatenate([found, slow[slow.imag >= 0], _beyond(system, sure)])


def _rightmost(found: Complex, *, most: int, sure: float, leave: float) -> Complex:
    """Return the ``most`` rightmost guesses, and as many of those that are smaller than ``sure``.

    Above ``sure`` rad/s the nodes of a line no longer resolve a wave on it: a large gain then makes guesses far to the
    right where there is nothing, and they must not push out what is there. Poles to the left of the rightmost by ``leave``
    decay so fast within one delay that they leave nothing behind.
    """
    found = found[np.argsort(-found.real)]
    size = np.abs(found)
    rank = np.cumsum(size <= sure)
    wanted = (np.arange(len(found)) < most) | ((size <= sure) & (rank <= most))
    first = found[size <= sure] if rank[-1] else found
    return np.asarray(found[wanted & (found.real > first.real[0] - leave)])


def _beyond(system: LaneSystem, sure: float) -> Complex:
    """Return guesses above ``sure`` rad/s, where a resonance or a high-pass lets the loop gain rise again."""
    own = np.linalg.eigvals(system.a[0].real) if system.n else np.zeros(0)
    top = float(np.abs(own).max(initial=0.0))
    if top <= sure:  # M only falls from there on
        return np.zeros(0, complex)
    swinging = own[own.imag > sure]
    around = swinging.imag + np.abs(swinging.real) * np.array([-4, -2, -1, -0.5, 0, 0.5, 1, 2, 4])[:, None]
    omega = np.concatenate([np.geomspace(sure, 10 * top, _SCANNED), around[around > sure]])
    omega = np.unique(omega)
    # a little to the right of the axis, where a mode without damping has its pole
    f = (1e-9 + 1j) * omega[:, None, None] * np.eye(system.n) - system.a[0].real
    inner = np.linalg.solve(f, np.broadcast_to(system.b2[0].real, (len(f), system.n, system.m)))
    gain = np.abs(system.c2[0].real @ inner + system.d22[0].real)
    gain = np.abs(np.linalg.eigvals(gain)).max(axis=1)
    tops = np.flatnonzero((gain[1:-1] >= gain[:-2]) & (gain[1:-1] >= gain[2:]) & (gain[1:-1] > _SILENT)) + 1
    tops = tops[np.argsort(-gain[tops])][:_TOPS]
    tau = float(system.delays[0].real.max())
    chain = omega[tops, None] + 2 * np.pi / tau * np.arange(-_BESIDE, _BESIDE + 1) / 3
    chain = chain[chain > 0]
    height = np.log(np.clip(np.interp(chain, omega, gain), _SILENT, 1 / _SILENT)) / tau
    return np.concatenate([swinging, height + 1j * chain])


def _without_delays(system: LaneSystem) -> Complex:
    """Return the poles that there would be if all delays were 0; none where that is an ill-posed loop."""
    inner = np.eye(system.m) - system.d22[0].real
    if np.linalg.cond(inner) > 1e12:
        return np.zeros(0, complex)
    closed = system.a[0].real + system.b2[0].real @ np.linalg.solve(inner, system.c2[0].real)
    return np.asarray(np.linalg.eigvals(closed), dtype=complex)


def _nodes(lines: int) -> int:
    """Return on how many nodes each of some delay lines is collocated."""
    return int(np.clip(240 // max(lines, 1), 24, 60))


def _discretised(system: LaneSystem) -> Complex:
    """Return the eigenvalues of the system with each delay line as a Chebyshev-collocated transport equation."""
    n, m = system.n, system.m
    points = _nodes(m)
    theta = np.cos(np.pi * np.arange(points + 1) / points)
    c = np.ones(points + 1)
    c[[0, -1]] = 2
    c *= (-1.0) ** np.arange(points + 1)
    d = np.outer(c, 1 / c) / (theta[:, None] - theta[None, :] + np.eye(points + 1))
    d -= np.diag(d.sum(axis=1))
    size = n + m * points
    big = np.zeros((size, size))
    read = np.zeros((m, size))  # w_i = end of line i
    for i in range(m):
        read[i, n + i * points + points - 1] = 1
    z = np.zeros((m, size))
    z[:, :n] = system.c2[0].real
    z += system.d22[0].real @ read
    big[:n, :n] = system.a[0].real
    big[:n] += system.b2[0].real @ read
    for i, tau in enumerate(system.delays[0].real):
        rows = slice(n + i * points, n + (i + 1) * points)
        big[rows, rows] = 2 / tau * d[1:, 1:]
        big[rows] += 2 / tau * np.outer(d[1:, 0], z[i])
    return np.asarray(np.linalg.eigvals(matrix_balance(big, permute=False)[0]))
