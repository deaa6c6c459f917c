"""Do both directions have the same dynamics?   One step of a parameter for v > 0 and another for v < 0.

At rest the direction is that of the motion before. Where the offset of the output is unknown, each direction has its own:
a load that hangs, or friction, lets a drive stop on either side of its target.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine.recordings.validation.comparison import Comparison, Signal, held_directions
from engine.recordings.validation.remedy import WORTHWHILE, Remedy, worthwhile
from engine.recordings.validation.steps import Movable


def direction(comparison: Comparison, movable: Sequence[Movable]) -> Remedy | None:
    """Return the parameter that two values, one for each direction of the output, explain best; None where none does.

    Parameters
    ----------
    comparison : Comparison
        With the derivatives of every parameter in ``movable``.
    movable : sequence of Movable
    """
    sign = held_directions(comparison.velocity)
    rising = sign > 0.0
    if rising.all() or not rising.any():
        return None
    side = [sign] if comparison.constant else []
    best: Remedy | None = None
    for parameter in movable:
        tangent = comparison.tangents[parameter.parameter]
        one = _left(comparison, [tangent, *side])[0]
        left, found = _left(comparison, [np.where(rising, tangent, 0.0), np.where(rising, 0.0, tangent), *side])
        # two values always fit better than one: they must do so clearly
        if left is None or one is None or left > WORTHWHILE * one or not worthwhile(left, comparison.present_error):
            continue
        if best is None or left < best.relative_error_percent:
            up, down = (float(min(max(parameter.value + step, parameter.lower), parameter.upper)) for step in found[:2])
            name = parameter.parameter
            best = Remedy(
                kind="direction",
                relative_error_percent=left,
                values={f"{name} rising": up, f"{name} falling": down},
                sentence=(
                    f"{comparison.name} moves otherwise up than down: {name} about {up:.4g} while it rises and "
                    f"{down:.4g} {parameter.unit} while it falls; one value for both cannot fit."
                ),
            )
    return best


def _left(comparison: Comparison, columns: Sequence[Signal]) -> tuple[float | None, tuple[float, ...]]:
    """Return the error that one step in these columns leaves, and the step."""
    matrix = np.column_stack([comparison.free(column) for column in columns])
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale == 0.0] = 1.0
    found = np.linalg.lstsq(matrix / scale, comparison.residual, rcond=None)[0] / scale
    return comparison.relative_error(comparison.residual - matrix @ found), tuple(float(step) for step in found)
