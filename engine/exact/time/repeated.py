"""Many equal segments of a system with delays at once, where nothing but what came before moves it any more.

    s = [x; z on the last p pieces],  s⁺ = M s,  [x; w] on the nodes of a segment = N s

p pieces are what the longest delay reaches back over. All is counted from rest, so the powers of M lose nothing of what is left.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import DEGREE, NODES, weights
from engine.exact.time.propagate import Propagator, powers
from engine.model.linear_system import Array, LaneSystem

_SIZE = DEGREE + 1
_LARGEST = 240
"""So many numbers may s have: a power of M costs more than single segments beyond."""


def pieces_of(system: LaneSystem, width: Array) -> int:
    """Return over how many pieces of ``width`` (lanes,) the delays reach back; 0 where they are too many to be taken together."""
    pieces = int(np.ceil(float(system.delays[0].real.max()) / float(width[0].real) - 1e-9))
    return pieces if system.n + pieces * _SIZE * system.m <= _LARGEST else 0


class Repeated:
    """What leads over equal segments of ``width`` (lanes,), of which each is one of the ``propagator``."""

    def __init__(self, system: LaneSystem, propagator: Propagator, width: Array, pieces: int) -> None:
        lanes, n, m = system.lanes, system.n, system.m
        nodes, own = np.zeros((lanes, _SIZE, system.n_in)), _SIZE * m
        units = np.eye(n + own)
        columns = [
            np.concatenate(
                propagator.solve(
                    np.broadcast_to(unit[:n], (lanes, n)), nodes, np.broadcast_to(unit[n:].reshape(_SIZE, m), (lanes, _SIZE, m))
                ), axis=-1,
            )
            for unit in units
        ]  # fmt: skip
        # from x and what is heard of before to x and w on the nodes, (lanes, N + 1, n + m, n + own)
        single = np.stack(columns, axis=-1)
        heard = _heard(system, width, pieces)
        found = np.concatenate(
            [single[..., :n], np.einsum("pjac,pcd->pjad", single[..., n:], heard)], axis=-1
        )  # fmt: skip
        self.nodes: Array = found.reshape(lanes, _SIZE * (n + m), -1)
        back = np.einsum("pia,pjad->pjid", np.concatenate([system.c2, system.d22], axis=-1), found)
        size = found.shape[-1]
        self.step: Array = np.zeros((lanes, size, size), dtype=found.dtype)
        self.step[:, :n] = found[:, -1, :n]
        self.step[:, n : n + own] = back.reshape(lanes, own, size)
        self.step[:, n + own :, n : size - own] = np.eye(size - n - own)
        self._n, self._m = n, m

    def follow(self, state: Array, before: Array, count: int) -> tuple[Array, Array]:
        """Return states and delayed signals at the nodes of ``count`` segments, shapes (count, lanes, N + 1, n or m).

        Parameters
        ----------
        state : ndarray, shape (lanes, n)
            At the start of the first, from rest.
        before : ndarray, shape (pieces, N + 1, lanes, m)
            What went into the delays on the last pieces, from rest; the latest comes last.
        """
        lanes = len(state)
        latest_first = before[::-1].transpose(2, 0, 1, 3).reshape(lanes, -1)
        starts = powers(self.step, np.concatenate([state, latest_first], axis=-1), count)
        found = (self.nodes @ starts).reshape(lanes, _SIZE, self._n + self._m, count).transpose(3, 0, 1, 2)
        return found[..., : self._n], found[..., self._n :]


def _heard(system: LaneSystem, width: Array, pieces: int) -> Array:
    """Return what is heard at the nodes of what went in on the last pieces, (lanes, (N + 1) m, pieces (N + 1) m); 0 what the segment tells."""
    lanes, m = system.lanes, system.m
    out = np.zeros((lanes, _SIZE, m, pieces, _SIZE, m), dtype=system.dtype)
    for channel in range(m):
        delay = system.delays[:, channel] / width  # in segments
        inward = NODES + 1e-9 * (0.5 - NODES)
        piece: npt.NDArray[np.intp] = np.clip(np.ceil(delay[0].real - inward).astype(int), 1, pieces)
        parts = weights(NODES - delay[:, None] + piece)  # (lanes, N + 1, N + 1)
        for node in np.flatnonzero(delay[0].real * (1 + 1e-9) >= NODES):
            out[:, node, channel, piece[node] - 1, :, channel] = parts[:, node]
    return out.reshape(lanes, _SIZE * m, pieces * _SIZE * m)
