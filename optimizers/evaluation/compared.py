"""What goals compare: the number of a metric, infinite where it is as large as can be, a margin as its distance from instability.

    gain margin g -> max(g, 1/g),   phase margin φ -> |φ|,   every other metric as it is shown

The distances are those of `engine.metrics`; here they are given to values, and by the chain rule to their slopes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.metrics import catalogue
from engine.model.verdicts import Measured, Verdict

if TYPE_CHECKING:
    from engine.analysis.study import Gradient
    from optimizers.problem import Goal

Matrix = npt.NDArray[np.float64]
Exact = tuple[Measured, "Gradient | None"]

_STEP: Final = 1e-30
_UNLIMITED: Final = frozenset({Verdict.NEVER_CROSSES, Verdict.NOT_OSCILLATORY})


def number_of(goal: Goal, measured: Measured) -> float:
    """Return what a goal compares of a measured metric; NaN where there is none.

    An absent value is infinite where the metric is then as large as can be: a margin or bandwidth that is never crossed, the
    damping of a system without poles.
    """
    if measured.value is None:
        return math.inf if goal.unlimited and measured.verdict in _UNLIMITED else math.nan
    return float(compared([goal], np.array([measured.value]))[0])


def numbers_of(goals: Sequence[Goal], rows: Sequence[Sequence[Measured]]) -> Matrix:
    """Return :func:`number_of` for every row of measured goals, (S, G)."""
    found = [[number_of(goal, measured) for goal, measured in zip(goals, row, strict=True)] for row in rows]
    return np.array(found).reshape(len(rows), len(goals))


def exactly(goals: Sequence[Goal], rows: Sequence[Sequence[Exact]], variables: int) -> tuple[Matrix, Matrix]:
    """Return what goals compare of rows of exact measurements, (S, G), with slopes (S, G, V); those are NaN where unknown."""
    shown = np.array([[np.nan if m.value is None else m.value for m, _ in row] for row in rows])
    unknown = np.full(variables, np.nan)
    slopes = np.array([[unknown if slope is None else slope.values for _, slope in row] for row in rows])
    shape = len(rows), len(goals)
    return (
        numbers_of(goals, [[measured for measured, _ in row] for row in rows]),
        compared_slopes(goals, shown.reshape(shape), slopes.reshape(*shape, variables)),
    )


def compared(goals: Sequence[Goal], values: Matrix) -> Matrix:
    """Return what goals compare of values (..., G) as they are shown."""
    found = np.empty_like(values)
    with np.errstate(divide="ignore"):
        for g, goal in enumerate(goals):
            found[..., g] = catalogue()[goal.metric].distance(values[..., g])
    return found


def compared_slopes(goals: Sequence[Goal], values: Matrix, slopes: Matrix) -> Matrix:
    """Return the slopes of what goals compare, (..., G, V), for values (..., G) and slopes as they are shown."""
    found = np.empty_like(slopes)
    with np.errstate(divide="ignore", invalid="ignore"):
        for g, goal in enumerate(goals):
            moving = values[..., g, None] + 1j * _STEP * slopes[..., g, :]
            found[..., g, :] = np.imag(catalogue()[goal.metric].distance(moving)) / _STEP
    return found
