"""Slopes of a nonlinear system along its states and what its laws hold."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent:
    """Slopes of a system at N instants: of the rates ``f`` and of what is held, by states ``x`` and held outputs ``m``.

    Shapes: ``fx`` (N, n, n), ``fm`` (N, n, held); of what is held ``surface`` (N, held, channels) by the laws' inputs,
    ``hold`` (N, held, n) by the states, ``em`` (N, held, held) by the held outputs at once, ``gain`` (N, held, held) of
    its rate by the held outputs.
    """

    fx: Array
    fm: Array
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
    def total(self) -> Array:
        """Slope of the rates by the states when the held inputs stay where they are, (N, n, n)."""
        if not self.gain.shape[-1]:
            return self.fx
        return np.asarray(self.fx - self.fm @ np.linalg.solve(self.gain, self.hold @ self.fx))
