"""Characteristic roots of parts of many systems, found once each: several evaluators ask how the same part decays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.batch.linear.generator import eigenvalues_of

if TYPE_CHECKING:
    from engine.model.linear_system import Array, StackedSystem

Flags = npt.NDArray[np.bool_]


class Spectra:
    """A stack of systems, and the roots of its parts as they are asked for.

    Attributes
    ----------
    stack : StackedSystem
    told : ndarray of int
        The members that exist, begin at rest and have no delay of 0.
    flow : ndarray, shape (B, n + m, n + m)
        What states and signals to be delayed, n + m in all, become of states and delayed signals.
    """

    def __init__(self, stack: StackedSystem) -> None:
        self.stack = stack
        self.told = np.flatnonzero(stack.valid & ~np.any(stack.x0 != 0, axis=1) & (stack.delays.real > 0).all(axis=1))
        upper, lower = (np.concatenate(pair, axis=2) for pair in ((stack.a, stack.b2), (stack.c2, stack.d22)))
        self.flow = np.concatenate([upper, lower], axis=1)
        self._known: dict[tuple[bytes, bytes], Array] = {}

    def roots(self, members: Array, kept: Array | None = None) -> Array:
        """Return the rightmost characteristic roots (K, N), 1/s, of some members, or of a part of each: NaN where they cannot be told.

        Parameters
        ----------
        members : ndarray of int, shape (K,)
        kept : ndarray of int, optional
            Rows of ``flow`` that the part consists of, rising; all by default.
        """
        n = self.stack.a.shape[1]
        kept = np.arange(self.flow.shape[1]) if kept is None else kept
        key = members.tobytes(), kept.tobytes()
        if key not in self._known:
            flow = self.flow[members][:, kept][:, :, kept].real
            count, lines = int((kept < n).sum()), kept[kept >= n] - n
            if len(lines):
                parts = (
                    flow[:, :count, :count],
                    flow[:, :count, count:],
                    flow[:, count:, :count],
                    flow[:, count:, count:],
                )
                self._known[key] = eigenvalues_of(*parts, self.stack.delays[members][:, lines].real)
            else:
                self._known[key] = np.linalg.eigvals(flow)
        return self._known[key]


def between(acts: Flags, driven: Flags, seen: Flags) -> npt.NDArray[np.intp]:
    """Return the states and delayed signals that an input reaches and from which an output is reached.

    Parameters
    ----------
    acts : ndarray of bool, shape (N, N)
        Which column acts on which row.
    driven, seen : ndarray of bool, shape (N,)
        On which the input acts directly, and which the output sees.
    """
    for _ in range(len(acts)):
        driven = driven | (acts @ driven)
        seen = seen | (acts.T @ seen)
    return np.flatnonzero(driven & seen)
