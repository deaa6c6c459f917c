"""The energy of an impulse response, ∫ g² dt: what a path makes of white noise.

    ‖G‖₂² = ∫₀^∞ g(t)² dt = (1/2π) ∫ |G(jω)|² dω = C P Cᵀ = Bᵀ Q B,
    A P + P Aᵀ + B Bᵀ = 0,   Aᵀ Q + Q A + Cᵀ C = 0,   d‖G‖₂² = 2 tr(Q dA P) + 2 Bᵀ Q dB + 2 dC P Cᵀ

With delays there is no such pair of equations: g is then the slope of the exact response to a step.

References
----------
K. Zhou, J. Doyle, K. Glover, Robust and Optimal Control, section 4.6.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from engine.exact.frequency.path import evenly_scaled
from engine.exact.frequency.poles import poles
from engine.exact.time.horizon import followed
from engine.model.errors import UnresolvedError
from engine.model.tangent import INFINITESIMAL, slopes
from engine.signals.step import Step

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem

_AGREE = 1e-10
"""Relative difference of the two ways to say the same below which both are right."""


def squared_norm(system: LaneSystem, static: Array) -> Array:
    """Return ∫ g² dt with its infinitesimals, shape (lanes,).

    Parameters
    ----------
    system : LaneSystem
        One input, one output; all its poles decay, and it passes no impulse on (`passes_impulses`).
    static : ndarray, shape (lanes,)
        Its gain at rest.
    """
    found = None if system.m else _by_gramians(system)
    return _by_response(system, static) if found is None else found


def passes_impulses(system: LaneSystem) -> bool:
    """Return whether an impulse at the input is one at the output, at once or behind delays: its energy is infinite."""
    if np.any(system.d11[0].real != 0):
        return True
    heard = np.any(system.d21[0].real != 0, axis=1)
    for _ in range(system.m):
        heard = heard | ((system.d22[0].real != 0) @ heard)
    return bool(np.any((system.d12[0].real != 0)[:, heard]))


def _by_gramians(system: LaneSystem) -> Array | None:
    """Return ∫ g² dt of a system without delays; None where rounding parts the two ways to say it."""
    if not system.n:
        return np.zeros(system.lanes)
    even = evenly_scaled(system)
    a, b, c = (matrix[0].real for matrix in (even.a, even.b1, even.c1))
    driven = solve_continuous_lyapunov(a, -b @ b.T)
    seen = solve_continuous_lyapunov(a.T, -c.T @ c)
    value, other = (c @ driven @ c.T).item(), (b.T @ seen @ b).item()
    if not abs(value - other) <= _AGREE * abs(value):
        return None
    if system.dtype is np.float64:
        return np.full(system.lanes, value)
    moved = np.einsum("ij,pjk,ki->p", seen, slopes(even.a), driven)
    moved = moved + np.einsum("ij,pjk->pk", b.T @ seen, slopes(even.b1))[:, 0]
    moved = moved + np.einsum("pij,jk->p", slopes(even.c1), driven @ c.T)
    return np.asarray(value + 2j * INFINITESIMAL * moved)


def _by_response(system: LaneSystem, static: Array) -> Array:
    """Return ∫ g² dt from the response to a step, whose slope g is."""
    answer = followed(system, {"u": Step(amplitude=1.0, start=0.0)}, poles(system.value).lifetime, [static])
    if not answer.rounded.all():
        msg = (
            f"a response must settle, but it stays {answer.left[0]:.2g} from rest: its time constants lie too far apart"
        )
        raise UnresolvedError(msg)
    return answer.response.output(0).slope.squared().integral()
