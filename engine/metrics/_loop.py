"""Where an open loop L passes -1's neighbours: every gain, phase and delay margin.

gain:  Im L = 0, Re L < 0 -> 1 / |L|;   phase:  |L| = 1 -> π + arg L;   delay:  phase in [0, 2π) / ω
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from engine.linear.frequency import SMALLEST_LOOP_GAIN, imaginary_part, squared_magnitude
from engine.linear.touching import touches
from engine.metrics._base import TOUCHES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.linear.frequency import FrequencyResponse
    from engine.linear.system import Array

_NO_MARGIN = 1e-12

Crossing = tuple["Array", "Array"]
"""(frequency in rad/s, margin), each of shape (lanes,)."""


def gain_margins(response: FrequencyResponse, static: Array | None) -> list[Crossing]:
    """Return every gain margin as far as the scan follows the phase; at ω = 0 too where L(0) is finite and negative."""
    found: list[Crossing] = []
    if static is not None and float(static[0].real) < -SMALLEST_LOOP_GAIN:
        found.append((np.zeros(static.shape), -1 / static))
    for frequency in response.crossings(imaginary_part, 0.0, floor=SMALLEST_LOOP_GAIN, until=response.resolved):
        re, _ = response.pair(frequency)
        if float(re[0].real) < -SMALLEST_LOOP_GAIN:
            found.append((frequency, -1 / re))
    return found


def phase_margins(response: FrequencyResponse) -> list[Crossing]:
    """Return every phase margin in (-π, π]."""
    found: list[Crossing] = []
    for frequency in response.crossings(squared_magnitude, 1.0):
        re, im = response.pair(frequency)
        found.append((frequency, _angle(-re, -im)))
    return found


def delay_margins(response: FrequencyResponse) -> list[Crossing]:
    """Return the additional delay at which each gain crossing reaches -1."""
    found: list[Crossing] = []
    for frequency, margin in phase_margins(response):
        # on the stability limit the phase margin is 0 but for rounding: not almost a whole turn
        turn = margin if float(margin[0].real) >= -_NO_MARGIN else margin + 2 * np.pi
        found.append((frequency, turn / frequency))
    return found


def gain_distance(value: Array) -> Array:
    """Return max(g, 1/g) of gain margins, the distance from 1 in either direction."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(value.real < 1, 1 / value, value)


def rivals(margins: Sequence[float]) -> bool:
    """Return whether two margins, as their distances from none, are as near but on either side: the nearest jumps to the other."""
    nearest = min(margins, key=abs)
    return any(abs(m + nearest) <= TOUCHES * abs(nearest) for m in margins) and nearest != 0.0


def grazes_one(response: FrequencyResponse) -> bool:
    """Return whether |L| just touches 1: a little more or less, and two crossings are there or gone."""
    return touches(response, squared_magnitude, 1.0, tolerance=2 * TOUCHES, until=np.inf)


def _angle(re: Array, im: Array) -> Array:
    """Return atan2(im, re) with its infinitesimals."""
    angle = np.arctan2(im.real, re.real)
    if not (np.iscomplexobj(re) or np.iscomplexobj(im)):
        return np.asarray(angle)
    turn = (re.real * np.imag(im) - im.real * np.imag(re)) / (re.real**2 + im.real**2)
    return np.asarray(angle + 1j * turn)
