"""Is it the direction?   e ≈ a sign(v) + b v:  dry friction, backlash and hysteresis change sign with the motion."""

from __future__ import annotations

import numpy as np

from engine.recordings.validation.comparison import Comparison, held_directions, rate
from engine.recordings.validation.remedy import Remedy, worthwhile


def friction(comparison: Comparison) -> Remedy | None:
    """Return the half width of the loop that the residual makes over a motion; None where it makes none.

    The motion is that of the output itself, or of an input (a damper is given its displacement).
    """
    moving = {comparison.name: comparison.velocity}
    moving |= {name: rate(signal, comparison.sample_time) for name, signal in comparison.inputs.items()}
    best: Remedy | None = None
    for name, velocity in moving.items():
        sign = held_directions(velocity)
        if not (sign > 0).any() or not (sign < 0).any():
            continue
        columns = np.column_stack([comparison.free(sign), comparison.free(velocity)])
        scale = np.linalg.norm(columns, axis=0)
        scale[scale == 0.0] = 1.0
        found = np.linalg.lstsq(columns / scale, comparison.residual, rcond=None)[0] / scale
        viscous_only = comparison.relative_error(comparison.residual - _projection(comparison, columns[:, 1]))
        left = comparison.relative_error(comparison.residual - columns @ found)
        # what a viscous term explains as well is a matter of a parameter, not of dry friction
        if left is None or not worthwhile(left, comparison.present_error) or not worthwhile(left, viscous_only):
            continue
        if best is None or left < best.relative_error_percent:
            best = Remedy(
                kind="friction",
                relative_error_percent=left,
                values={"half_width": float(found[0]), "slope": float(found[1])},
                sentence=(
                    f"the error of {comparison.name} changes sign with the direction of {name} (± {abs(found[0]):.4g}): "
                    "dry friction, backlash or hysteresis is missing or too small."
                ),
            )
    return best


def _projection(
    comparison: Comparison, column: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    power = float(column @ column)
    return column * (float(column @ comparison.residual) / power) if power > 0.0 else np.zeros_like(column)
