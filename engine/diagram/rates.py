"""The interconnection with the rates of states as signals of their own: what is nearly equal is never subtracted.

x' = A x + B u with y = C x + D u + K x'  becomes  x_i' = w_i,  w_i = z_i = (A x + B u)_i,  y = C x + D u + K w

A fast filter's state nearly is its input, and an acceleration is a small rest of large forces: with the rates put in,
y = (C + K A) x + (D + K B) u leaves at rest, or at slow frequencies, the rounding of what cancels. As signals the rates are
unknowns of the same equations as the states, and small by themselves. They are delay channels of length 0, which every
equation for a frequency holds already; what marches in time, and what looks for poles, takes the state space without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from engine.elements import Realization

if TYPE_CHECKING:
    import numpy.typing as npt

    from engine.diagram.realize import Assembled, Interconnection, Wiring
    from engine.elements._base import Array


def assemble_by_rates(
    interconnection: Interconnection,
    realizations: Sequence[Realization],
    wiring: Wiring,
    *,
    admitted: npt.NDArray[np.bool_] | None = None,
) -> Assembled:
    """Return the connected blocks, every rate that an output is read from a channel of length 0; see `Interconnection.assemble`."""
    assembled = interconnection.assemble([_apart(r) for r in realizations], wiring, admitted=admitted)
    matrices = {name: array.copy() for name, array in assembled.matrices.items()}
    x = w = 0
    for realization in realizations:
        for k, state in enumerate(_read(realization)):
            _freed(matrices, x + int(state), w + k)
        w += len(_read(realization)) + realization.delays.shape[-1]
        x += realization.a.shape[-1]
    return replace(assembled, matrices=matrices)


def _read(realization: Realization) -> npt.NDArray[np.intp]:
    """Return the states whose rates are read."""
    reading = realization.reading
    if reading is None:
        return np.zeros(0, dtype=np.intp)
    n = realization.a.shape[-1]
    return np.flatnonzero((reading.k != 0).reshape(-1, n).any(axis=0))


def _apart(realization: Realization) -> Realization:
    """Return the block with its rates read from channels that nothing enters yet."""
    reading, read = realization.reading, _read(realization)
    if reading is None:
        return realization
    return replace(
        realization, c=reading.c, d=reading.d, delays=np.zeros(len(read)), d12=reading.k[..., read],
        d21=np.zeros((len(read), realization.b.shape[-1])), reading=None,
    )  # fmt: skip


def _freed(matrices: dict[str, Array], state: int, channel: int) -> None:
    """Let what drives a state enter a channel, and the channel drive the state."""
    for rows, entering in (("a", "c2"), ("b1", "d21"), ("b2", "d22")):
        matrices[entering][..., channel, :] = matrices[rows][..., state, :]
        matrices[rows][..., state, :] = 0.0
    matrices["b2"][..., state, channel] = 1.0
