"""Slopes of a nonlinear system along its states, its delayed signals and what its laws hold."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent:
    """Slopes of a system at N instants, by states ``x``, m delayed signals ``w`` and held outputs.

    Shapes: of rates and then of what goes into the delays ``by_x`` (N, n + m, n), ``by_w`` (N, n + m, m) and ``by_held``
    (N, n + m, held); of what is held ``surface`` (N, held, channels) by the laws' inputs, ``hold`` (N, held, n) by the states,
    ``em`` (N, held, held) by the held outputs at once, ``gain`` (N, held, held) of its rate by the held outputs.
    """

    by_x: Array
    by_w: Array
    by_held: Array
    em: Array
    surface: Array
    hold: Array
    gain: Array

    def at(self, count: int) -> Tangent:
        """Return the slopes of one instant as those of ``count`` instants."""
        if count == 1:
            return self
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        return Tangent(**{name: np.broadcast_to(array, (count, *array.shape[1:])) for name, array in parts.items()})

    @property
    def fx(self) -> Array:
        """Slope of the rates by the states, (N, n, n)."""
        return self.by_x[:, : self.by_x.shape[2]]

    @property
    def fm(self) -> Array:
        """Slope of the rates by what is held, (N, n, held)."""
        return self.by_held[:, : self.by_x.shape[2]]

    @property
    def total(self) -> Array:
        """Slope of the rates by the states when the held inputs stay where they are, (N, n, n)."""
        if not self.gain.shape[-1]:
            return self.fx
        return np.asarray(self.fx - self.fm @ np.linalg.solve(self.gain, self.hold @ self.fx))

    @property
    def joint(self) -> Array:
        """Slope of rates and what goes into the delays by states and delayed signals, likewise, (N, n + m, n + m)."""
        free = np.concatenate([self.by_x, self.by_w], axis=2)
        if not self.gain.shape[-1]:
            return free
        moves = self.hold @ free[:, : self.by_x.shape[2]]
        return np.asarray(free - self.by_held @ np.linalg.solve(self.gain, moves))
