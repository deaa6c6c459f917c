"""Which parameter would have to move?   One Gauss-Newton step for each alone, and for all together.

    alone        δ_k = J_kᵀe / J_kᵀJ_k                error left  ||e - J_k δ_k||
    together     δ = (JᵀJ)⁺ Jᵀe                       error left  ||e - J δ||

J are the exact derivatives of the response. Nothing is fitted again: a step tells the direction and about how far, and
a large one is only as good as the straight line is; the new value keeps to the parameter's bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.recordings.validation.comparison import Comparison

Matrix = npt.NDArray[np.float64]

_UNSEEN = 1e-6
"""Directions of the (scaled) parameters that move the response less than this, relative to the strongest, stay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Movable:
    """A parameter that may move: value, bounds and unit in SI."""

    parameter: str
    value: float
    lower: float
    upper: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Where a parameter would move.

    Attributes
    ----------
    value, suggested : float
        SI.
    relative_error_percent : float
        Predicted when it moves alone: the root of the mean square over the outputs.
    """

    parameter: str
    unit: str
    value: float
    suggested: float
    relative_error_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """All single steps, the most helpful first, and the one of all parameters together."""

    present_error_percent: float
    alone: tuple[Step, ...]
    together: Mapping[str, float]
    together_error_percent: float


def steps(comparisons: Sequence[Comparison], movable: Sequence[Movable]) -> Steps | None:
    """Return which parameters would have to move, None where no parameter may or nothing was measured.

    Parameters
    ----------
    comparisons : sequence of Comparison
        One for each output, with the derivatives of every parameter in ``movable``. Each counts by its relative error.
    movable : sequence of Movable
    """
    weights = [float(np.linalg.norm(c.measured)) for c in comparisons]
    if not movable or not all(weight > 0.0 for weight in weights):
        return None
    share = 1 / np.sqrt(len(comparisons))
    error = share * np.concatenate([c.residual / w for c, w in zip(comparisons, weights, strict=True)])
    columns = share * np.column_stack(
        [
            np.concatenate([c.free(c.tangents[m.parameter]) / w for c, w in zip(comparisons, weights, strict=True)])
            for m in movable
        ]
    )
    size = np.linalg.norm(columns, axis=0)
    alone = []
    for k, parameter in enumerate(movable):
        step = float(columns[:, k] @ error) / size[k] ** 2 if size[k] > 0.0 else 0.0
        new = float(min(max(parameter.value + step, parameter.lower), parameter.upper))
        left = float(np.linalg.norm(error - columns[:, k] * (new - parameter.value)))
        alone.append(
            Step(
                parameter=parameter.parameter, unit=parameter.unit, value=parameter.value, suggested=new,
                relative_error_percent=100 * left,
            )
        )  # fmt: skip
    scale = np.where(size > 0.0, size, 1.0)
    joint = np.linalg.lstsq(columns / scale, error, rcond=_UNSEEN)[0] / scale
    lower, upper, value = (np.array([getattr(m, key) for m in movable]) for key in ("lower", "upper", "value"))
    together = np.clip(value + joint, lower, upper)
    return Steps(
        present_error_percent=100 * float(np.linalg.norm(error)),
        alone=tuple(sorted(alone, key=lambda step: step.relative_error_percent)),
        together={m.parameter: float(new) for m, new in zip(movable, together, strict=True)},
        together_error_percent=100 * float(np.linalg.norm(error - columns @ (together - value))),
    )
