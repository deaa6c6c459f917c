"""Is it the scale?   y ≈ g ŷ (+ c);  a g near 1000, 25.4, 57.3 ... is a unit, no model."""

from __future__ import annotations

import math

import numpy as np

from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.remedy import Remedy, worthwhile

_UNITS = {
    1000.0: "a prefix: milli",
    1e6: "a prefix: micro",
    100.0: "centimetres or percent",
    10.0: "centimetres for millimetres, or 10 V for 1",
    25.4: "inches",
    180 / math.pi: "degrees for radians",
    60 / (2 * math.pi): "revolutions per minute",
    2 * math.pi: "Hz or revolutions for radians",
    9.80665: "kilogram-force, or g",
    1e5: "bar",
    4.4482216: "pounds-force",
    6894.757: "psi",
}
_NEAR = 0.01


def gain(comparison: Comparison) -> Remedy | None:
    """Return the factor between measurement and model; None where one explains nothing."""
    model = comparison.simulated - comparison.simulated.mean() if comparison.constant else comparison.simulated
    power = float(model @ model)
    if power == 0.0:
        return None
    factor = float(comparison.free(comparison.measured) @ model) / power
    left = comparison.relative_error(comparison.measured - factor * model)
    if left is None or not worthwhile(left, comparison.present_error):
        return None
    unit = unit_of(factor)
    cause = (
        f"that is the factor of a unit ({unit}): check the channel's unit and scale"
        if unit
        else "a static gain, a sensor's scale or an area is off by this factor"
        if factor > 0
        else "the sign of a channel or of a gain is turned round"
    )
    return Remedy(
        kind="gain",
        relative_error_percent=left,
        values={"gain": factor},
        sentence=f"{comparison.name} follows {factor:.4g} times the model: {cause}.",
    )


def unit_of(factor: float) -> str | None:
    """Return the unit that was probably mistaken, None where a factor is that of no common one.

    >>> unit_of(0.001)
    'a prefix: milli'
    """
    size = abs(factor)
    if not (size > 0.0 and np.isfinite(size)):
        return None
    for number, words in _UNITS.items():
        if min(abs(size / number - 1), abs(size * number - 1)) < _NEAR:
            return words
    return None
