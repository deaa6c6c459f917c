"""Points of a design of experiments: full grids, even samples, and the cells around good points."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from optimizers.problem import Axis, Vector
from optimizers.search.sampling_plan import latin_hypercubes, sobol_sequence

Matrix = npt.NDArray[np.float64]


def places(axis: Axis, count: int) -> Vector:
    """Return ``count`` positions from one end of an axis to the other; of a discrete one as many levels as there are."""
    if not axis.discrete:
        return np.linspace(0.0, 1.0, count)
    last = len(axis.levels) - 1
    return np.unique(np.rint(np.linspace(0.0, last, min(count, last + 1)))) / last


def around(axis: Axis, centre: float, width: float, count: int) -> Vector:
    """Return positions within ``width`` of a place; of a discrete axis the levels there, its neighbours at least."""
    if not axis.discrete:
        return np.clip(np.linspace(centre - width, centre + width, count), 0.0, 1.0)
    last = len(axis.levels) - 1
    reach = max(1, int(width * last))
    near = np.arange(round(centre * last) - reach, round(centre * last) + reach + 1)
    near = near[(near >= 0) & (near <= last)]
    return np.unique(near[np.rint(np.linspace(0, len(near) - 1, min(count, len(near)))).astype(int)]) / last


class Combinations:
    """Every combination of positions on each axis, made row by row when asked for: first axis slowest."""

    def __init__(self, axes: Sequence[Vector]) -> None:
        self.axes = tuple(axes)
        self.shape = tuple(len(axis) for axis in axes)

    def __len__(self) -> int:
        return math.prod(self.shape)

    def rows(self, first: int, last: int) -> Matrix:
        """Return the combinations number ``first`` up to ``last``, shape (last - first, V)."""
        indices = np.unravel_index(np.arange(first, last), self.shape)
        return np.stack([axis[index] for axis, index in zip(self.axes, indices, strict=True)], axis=1)


def sample(kind: str, total: int, dimensions: int, rng: np.random.Generator) -> Matrix:
    """Return ``total`` evenly spread points of the unit cube: a scrambled Sobol sequence or a Latin hypercube."""
    if kind == "sobol":
        return np.asarray(sobol_sequence(dimensions, rng).random_base2(math.ceil(math.log2(total)))[:total])
    return np.asarray(latin_hypercubes(dimensions, rng).random(total))
