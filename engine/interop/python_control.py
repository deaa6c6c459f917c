"""Systems to python-control and back: state spaces, transfer functions, and interconnections block by block.

python-control is imported by the conversions themselves: install the extra `interop`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from engine.interop.matrices import Matrices
from engine.model.errors import DiagramError, IllPosedError

if TYPE_CHECKING:
    import control

Array = npt.NDArray[np.float64]

MAX_PADE_ORDER: Final = 10
"""Beyond it the coefficients lose their digits."""


def to_state_space(matrices: Matrices, *, pade_order: int | None = None) -> control.StateSpace:
    """Return a system as a `control.StateSpace`.

    Inputs and outputs keep their names; states have _ where ours have a dot, which python-control reserves. Initial values
    do not come along: it has no place for them.

    Parameters
    ----------
    matrices : Matrices
        From `engine.interop.matrices`.
    pade_order : int, optional
        Order of the Padé approximation that takes the place of each delay, 1 to 10. python-control has no delays: without
        this a system that has some is refused.

    Raises
    ------
    DiagramError
        Where a delay cannot be kept, or ``pade_order`` is out of its bounds.
    IllPosedError
        If the approximation closes an algebraic loop without a solution.
    """
    import control  # noqa: PLC0415  an optional library, which takes a second to load

    a, b, c, d, states = _without_delays(matrices, pade_order)
    system = matrices.system
    return control.StateSpace(
        a, b, c, d, states=states, inputs=list(system.inputs), outputs=list(system.outputs), remove_useless_states=False
    )


def to_transfer_function(matrices: Matrices, *, pade_order: int | None = None) -> control.TransferFunction:
    """Return a system as a `control.TransferFunction`, every entry over the characteristic polynomial; nothing is cancelled.

    Parameters and exceptions are those of `to_state_space`. Polynomials of high order lose digits that a state space keeps.
    """
    import control  # noqa: PLC0415  as above

    a, b, c, d, _ = _without_delays(matrices, pade_order)
    denominator = np.real(np.poly(a)) if len(a) else np.ones(1)
    numerators = [
        [_numerator(a, b[:, j], c[i], d[i, j], denominator) for j in range(d.shape[1])] for i in range(len(d))
    ]
    denominators = [[denominator] * d.shape[1] for _ in range(len(d))]
    system = matrices.system
    return control.TransferFunction(numerators, denominators, inputs=list(system.inputs), outputs=list(system.outputs))


def _numerator(a: Array, b: Array, c: Array, d: float, denominator: Array) -> Array:
    """Return det(sI - A + b c) + (d - 1) det(sI - A), without leading coefficients that are rounding.

    The relative degree r is the first with c A^(r-1) b other than 0; polynomial roots would make it noise.
    """
    if not len(a):
        return np.array([d])
    numerator = np.real(np.poly(a - np.outer(b, c))) + (d - 1) * denominator
    if d:
        return np.asarray(numerator)
    degree, reach, size = 1, b, np.abs(b)
    while degree <= len(a) and abs(c @ reach) <= 1e-14 * (np.abs(c) @ size):
        degree, reach, size = degree + 1, a @ reach, np.abs(a) @ size
    return np.asarray(numerator[degree:]) if degree <= len(a) else np.zeros(1)


def _without_delays(matrices: Matrices, pade_order: int | None) -> tuple[Array, Array, Array, Array, list[str]]:
    """Return A, B, C, D and the names of the states, each delay replaced by its approximation."""
    s = matrices.system
    states = [name.replace(".", "_") for name in matrices.states]
    if not matrices.delayed:
        return s.a, s.b1, s.c1, s.d11, states
    if pade_order is None:
        named = ", ".join(f"{name} of {time:g} s" for name, time in zip(matrices.channels, s.delays, strict=True))
        raise DiagramError(
            f"system must be free of delays, as python-control has none, got {named}: ask for a pade_order to approximate them"
        )
    if not 1 <= pade_order <= MAX_PADE_ORDER:
        raise DiagramError(f"pade_order must be 1 to {MAX_PADE_ORDER}, got {pade_order}")
    ap, bp, cp, dp = _pade(s.delays, pade_order)
    # w = Cp xp + Dp z and z = C2 x + D21 u + D22 w, solved for z
    loop = np.eye(len(s.delays)) - s.d22 @ dp
    if np.linalg.cond(loop) > 1e12:
        raise IllPosedError(
            "the Padé approximation must leave every loop a solution: ask for an order one higher or lower"
        )
    z = np.linalg.solve(loop, np.hstack([s.c2, s.d22 @ cp, s.d21]))
    n, m = len(s.a), len(ap)
    zx, zp, zu = z[:, :n], z[:, n : n + m], z[:, n + m :]
    wx, wp, wu = dp @ zx, cp + dp @ zp, dp @ zu
    a = np.block([[s.a + s.b2 @ wx, s.b2 @ wp], [bp @ zx, ap + bp @ zp]])
    b = np.vstack([s.b1 + s.b2 @ wu, bp @ zu])
    c = np.hstack([s.c1 + s.d12 @ wx, s.d12 @ wp])
    names = [f"{name.replace('.', '_')}_{k + 1}" for name in matrices.channels for k in range(pade_order)]
    return a, b, c, s.d11 + s.d12 @ wu, states + names


def _pade(delays: Array, order: int) -> tuple[Array, Array, Array, Array]:
    """Return the approximations of all delays side by side; one of 1 s, its time stretched, is all of them."""
    import control  # noqa: PLC0415  as above

    unit: Any = control.tf2ss(control.tf(*control.pade(1.0, order)))
    a, b = (block_diag(*(np.asarray(part) / delay for delay in delays)) for part in (unit.A, unit.B))
    c, d = (block_diag(*(np.asarray(part) for _ in delays)) for part in (unit.C, unit.D))
    return a, b, c, d
