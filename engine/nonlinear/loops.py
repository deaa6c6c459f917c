"""Algebraic loops through nonlinear laws, solved by Newton's method with exact slopes.

v = g(e_0 + D33 v):   (1 - ∂g/∂e D33) Δv = g(e_0 + D33 v) - v
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import slopes
from engine.errors import IllPosedError, UnresolvedError

if TYPE_CHECKING:
    from engine.nonlinear.system import Instants, NonlinearSystem

Array = npt.NDArray[Any]

_ITERATIONS = 40
_SINGULAR = 1e-12


def solve_loop(
    system: NonlinearSystem, group: Sequence[int], at: Instants, base: Array, v: Array, *, skip: frozenset[int]
) -> None:
    """Write the outputs of the laws of one loop into ``v``.

    Parameters
    ----------
    system : NonlinearSystem
    group : sequence of int
        The laws on the loop.
    at : Instants
    base : ndarray, shape (lanes, N, channels)
        The laws' inputs without what the laws' outputs add to them.
    v : ndarray, shape (lanes, N, channels)
        The laws' outputs; what comes before the loop is known.
    skip : frozenset of int
        Outputs that are held.

    Raises
    ------
    IllPosedError
        If the loop gain is 1 somewhere.
    UnresolvedError
        If no solution is found.
    """
    laws = [system.laws[i] for i in group]
    outputs = [k for law in laws for k in range(law.outputs.start, law.outputs.stop) if k not in skip]
    link = system.value.matrices["d33"][0]
    real = at.real
    settled = 0
    for _ in range(_ITERATIONS):
        before = v.copy()
        for i in group:
            system.apply(i, at, base, v, skip=skip, given=before)
        excess = v[..., outputs] - before[..., outputs]
        size = max(np.abs(before[..., outputs].real).max(initial=0.0), np.abs(base.real).max(initial=0.0))
        settled = settled + 1 if np.abs(excess.real).max(initial=0.0) <= 1e-14 * size else 0
        if settled == 2 or (settled and not np.iscomplexobj(v)):
            return
        e = base[:1].real + before[:1].real @ link.T[None]
        gain = np.zeros((e.shape[1], v.shape[-1], e.shape[-1]))
        for i, law in zip(group, laws, strict=True):
            moment = system.moment(law, real.t, real.x, e)
            gain[:, law.outputs, law.inputs] = slopes(law.element, moment, at.modes[i], law.real).gz
        matrix = np.eye(len(outputs)) - (gain @ link)[:, outputs][:, :, outputs]
        spread = np.linalg.svd(matrix, compute_uv=False)
        if np.any(spread[:, -1] <= _SINGULAR * np.maximum(1.0, spread[:, 0])):
            raise _ill_posed(system, group)
        v[..., outputs] = before[..., outputs] + np.linalg.solve(matrix[None], excess[..., None])[..., 0]
    names = ", ".join(law.label for law in laws)
    msg = f"the algebraic loop through {names} must have a solution that can be found; put a lag or a delay into it"
    raise UnresolvedError(msg, at=laws[0].at)


def _ill_posed(system: NonlinearSystem, group: Sequence[int]) -> IllPosedError:
    ports = system.ports(group)
    return IllPosedError(
        f"the algebraic loop {' -> '.join((*ports, ports[0]))} must have a loop gain other than 1 to have a solution; "
        "change a gain on it, or put a lag or a delay into it",
        at=system.laws[group[0]].at,
        ports=ports,
    )
