"""Whether the polynomials of a response hold it: the last coefficients beside the largest value of each signal."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import coefficient_matrix

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem

RESOLUTION = 1e-13
"""What the two last Chebyshev coefficients may be, relative to the largest value of the signal so far."""

_GROWTH = 3e-8  # when coefficients 8 and 9 are below this, twice the segment is resolved as well (5 c8² < tolerance)
_ROUNDING = 4e-15
_NOISE = 5e-11  # what rounding may leave of a mode that has died away in a long segment
_CANCELLED = 1e-15  # what rounding leaves of the terms that a signal is the sum of
_GROWTH_RESTING = 3e-9
_RESTING = 1e-15
"""In place of the first, of what is counted from rest: integrals over a long tail see all of it. Noise then is beside what is left."""


class Resolution:
    """Judges whether the polynomial through the nodes holds every signal that matters."""

    def __init__(self, s: LaneSystem) -> None:
        self._outputs = s.n_out
        self._rows = np.abs(np.concatenate([s.c1[0], s.c2[0]]))
        self._largest: Array = np.zeros(s.n_out + s.m)
        self.largest_state: Array = np.zeros(s.n)
        self._seen: tuple[Array, Array] = self._largest[None], self.largest_state[None]

    def judge(
        self, x: Array, y: Array, z: Array, terms: Callable[[], Array], *, states: bool, resting: bool = False
    ) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Return (held, so well held that a segment of twice the length would be held too), each of shape (segments,).

        Parameters
        ----------
        x, y, z : ndarray, shape (segments, lanes, N + 1, ·)
            States, outputs and signals to be delayed on the nodes.
        terms : callable
            Returns the size of the terms that outputs, delayed signals and, if they count, states are the sum of, shape
            (segments, ·).
        states : bool
            Whether the states, too, must be held.
        resting : bool
            Whether all of them are counted from where the response rests.
        """
        signals = np.concatenate([y[:, 0].real, z[:, 0].real], axis=-1)  # (segments, N + 1, signals)
        x = x[:, 0].real
        largest = np.maximum(self._largest, np.maximum.accumulate(np.abs(signals).max(axis=1, initial=0.0)))
        largest_state = np.maximum(self.largest_state, np.maximum.accumulate(np.abs(x).max(axis=1, initial=0.0)))
        self._seen = largest, largest_state
        floor = _ROUNDING * (largest_state @ self._rows.T)
        scale = np.maximum(largest, floor / RESOLUTION)
        if states:
            signals = np.concatenate([signals, x], axis=-1)
            whole = 1e-8 * largest_state.max(axis=1, keepdims=True, initial=0.0)
            scale = np.concatenate([scale, np.maximum(largest_state, whole)], axis=-1)
        coefficients = np.abs(coefficient_matrix() @ signals)
        scale = np.maximum(scale, 1e-300)
        tail = coefficients[:, -2:].sum(axis=1)
        allowed = np.full(scale.shape[-1], RESOLUTION)
        if resting:
            allowed[: self._outputs] = _RESTING
        resolved = tail <= 2 * allowed * scale
        held = resolved.all(axis=1)
        if not held.all():
            # coefficients that do not fall any more are rounding, which a shorter segment would not make less
            level = coefficients[:, 6:10].max(axis=1) <= 8 * coefficients[:, -3:].max(axis=1)
            noise = _NOISE * (coefficients.sum(axis=1) if resting else scale)
            cancelled = _CANCELLED * terms()
            noise = np.maximum(noise, cancelled)
            held = np.all(resolved | (level & (tail <= noise)), axis=1)
        roomy = np.all(coefficients[:, 8:10].max(axis=1) <= (_GROWTH_RESTING if resting else _GROWTH) * scale, axis=1)
        return held, roomy

    def rests(self, states: Array, signals: Array) -> None:
        """Remember how large states (n,) and signals (outputs + m,) are where the response goes, which is counted from there now."""
        self.largest_state = np.maximum(self.largest_state, np.abs(states))
        self._largest = np.maximum(self._largest, np.abs(signals))

    def accept(self, count: int) -> None:
        """Remember the largest values of the first ``count`` segments judged last."""
        self._largest, self.largest_state = self._seen[0][count - 1], self._seen[1][count - 1]
