"""Whether a function of frequency only just reaches a level: a little more or less, and what is read at the level jumps.

d|T|²/dω = 0 at an ω with | |T(jω)|² - level | <= tolerance
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from engine.exact.frequency.roots import roots
from engine.model.tangent import parted

if TYPE_CHECKING:
    import numpy.typing as npt

    from engine.exact.frequency.response import FrequencyResponse
    from engine.exact.frequency.shapes import Shape
    from engine.model.linear_system import Array

_NEAR = 0.03
"""The scan is straight to one percent: a turning point lies no further from its neighbours than this."""


def touches(response: FrequencyResponse, shape: Shape, level: float, *, tolerance: float, until: float) -> bool:
    """Return whether ``shape`` turns within ``tolerance`` of ``level`` at a frequency up to ``until``, rad/s, or just behind."""
    until = 1.001 * until  # a crossing lies a little before a turning point that goes a little beyond
    omega, values = response.scan
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        away = np.abs(shape(values.real, values.imag) - level)
    near = away <= tolerance + _NEAR * np.maximum(np.abs(values), np.abs(values) ** 2)
    finite = np.isfinite(away)  # at a pole on the axis there is nothing to touch
    left = np.flatnonzero((near[:-1] | near[1:]) & finite[:-1] & finite[1:] & (omega[:-1] <= until))
    if not len(left):
        return False
    ends = np.unique(np.concatenate([left, left + 1]))
    rises = response.slope(shape, omega[ends]) > 0
    left = left[rises[np.searchsorted(ends, left)] != rises[np.searchsorted(ends, left + 1)]]

    def slope(w: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return response.slope(shape, w)

    turns = roots(slope, omega[left], omega[left + 1])
    here = response(turns)
    return bool(np.any((np.abs(shape(here.real, here.imag) - level) <= tolerance) & (turns <= until)))


def has_rival(response: FrequencyResponse, shape: Shape, value: Array, at: float, *, tolerance: float) -> bool:
    """Return whether another summit of ``shape`` is as high as the highest, ``value`` at ``at``, and moves otherwise."""
    if not np.iscomplexobj(value):
        return False
    omega, values = response.scan
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        tops, summits = response.summits(shape, omega, shape(values.real, values.imag))
    rivals = tops[(summits >= (1 - tolerance) * float(value[0].real)) & (np.abs(tops - at) > tolerance * at)]
    return any(parted(value, response.shape(shape, np.asarray(top))) for top in rivals)
