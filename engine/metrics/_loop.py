"""Where an open loop L passes -1's neighbours: every gain, phase and delay margin.

gain:  Im L = 0, Re L < 0 -> 1 / |L|;   phase:  |L| = 1 -> π + arg L;   delay:  phase in [0, 2π) / ω
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from engine.exact.frequency.response import SMALLEST_LOOP_GAIN
from engine.exact.frequency.shapes import imaginary_part, squared_magnitude
from engine.exact.frequency.touching import touches
from engine.exact.sampled_data.response import SampledResponse
from engine.metrics._base import TOUCHES
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.exact.frequency.response import FrequencyResponse
    from engine.model.linear_system import Array

_NO_MARGIN = 1e-12
_LIMIT_MARGIN = 1e-6
"""A phase margin of a loop on the stability limit is 0 but for rounding up to this, rad."""
_ON_THE_LIMIT = 1e-9
_FLOORS: Final = (SMALLEST_LOOP_GAIN, 1e-6, 1e-9)
_ASIDE, _ROUNDING = 1e-3, 1e-9

NO_LIMIT_ABOVE: Final = f"the phase reaches -180° nowhere that |L| is {_FLOORS[-1]:g} or more: the gain may rise by the factor {1 / _FLOORS[-1]:g} at least"

Side = Literal["up", "down"]

Crossing = tuple["Array", "Array"]
"""(frequency in rad/s, margin), each of shape (lanes,)."""


def gain_margins(response: FrequencyResponse, static: Array | None) -> tuple[list[Crossing], float]:
    """Return every gain margin as far as the scan follows the phase, and the loop gain that the fainter ones fall below.

    Both ends of the axis count, where L is finite and negative there. Fainter crossings are looked for only until there is one
    that bounds the gain from above: behind a delay there is no end of them.
    """
    if isinstance(response, SampledResponse):
        return response.gain_margins
    found: list[Crossing] = []
    for floor in _FLOORS:
        found = [*_at_the_ends(response, static, floor), *_inside(response, floor)]
        if any(float(margin[0].real) >= 1 - _ON_THE_LIMIT for _, margin in found):
            return found, floor
    return found, _FLOORS[-1]


def gain_margins_on(response: FrequencyResponse, static: Array | None, side: Side) -> list[Crossing]:
    """Return the gain margins above 1 or below it; a loop on the stability limit has one of 1 on either side."""
    found, _ = gain_margins(response, static)
    sign = 1.0 if side == "up" else -1.0
    return [one for one in found if sign * (float(one[1][0].real) - 1) >= -_ON_THE_LIMIT]


def _at_the_ends(response: FrequencyResponse, static: Array | None, floor: float) -> list[Crossing]:
    limits = [] if static is None else [(0.0, static)]
    if not response.system.m:  # delays turn for ever
        limits.append((np.inf, response.direct))
    return [(np.full(gain.shape, at), -1 / gain) for at, gain in limits if float(gain[0].real) < -floor]


def _inside(response: FrequencyResponse, floor: float) -> list[Crossing]:
    found: list[Crossing] = []
    for frequency in response.crossings(imaginary_part, 0.0, floor=floor, until=response.resolved):
        re, _ = response.pair(frequency)
        if float(re[0].real) < -floor and (floor == SMALLEST_LOOP_GAIN or _passes(response, float(frequency[0].real))):
            found.append((frequency, -1 / re))
    return found


def _passes(response: FrequencyResponse, frequency: float) -> bool:
    """Return whether L passes the axis here, rather than following it so closely that rounding takes it from side to side."""
    aside = min(_ASIDE, 0.1 / max(frequency * float(response.system.delays[0].real.sum()), 1e-300))
    before, after = response(frequency * np.array([1 - aside, 1 + aside]))
    rounding = _ROUNDING * max(abs(before), abs(after))
    return bool(before.imag * after.imag < 0 and min(abs(before.imag), abs(after.imag)) > rounding)


def phase_margins(response: FrequencyResponse) -> list[Crossing]:
    """Return every phase margin in (-π, π]."""
    if isinstance(response, SampledResponse):
        return response.phase_margins
    found: list[Crossing] = []
    for frequency in response.crossings(squared_magnitude, 1.0):
        re, im = response.pair(frequency)
        found.append((frequency, _angle(-re, -im)))
    return found


def delay_margins(response: FrequencyResponse, verdict: Verdict = Verdict.OK) -> list[Crossing]:
    """Return the additional delay at which each gain crossing reaches -1, of a closed loop with a verdict."""
    if isinstance(response, SampledResponse):  # following them costs much, and they say nothing of an unstable loop
        return [] if verdict is Verdict.UNSTABLE else response.delay_margins
    none = _NO_MARGIN if verdict is Verdict.OK else _LIMIT_MARGIN
    found: list[Crossing] = []
    for frequency, margin in phase_margins(response):
        # on the stability limit the phase margin is 0 but for rounding: not almost a whole turn
        turn = margin if float(margin[0].real) >= -none else margin + 2 * np.pi
        found.append((frequency, turn / frequency))
    return found


def finite(frequency: Array) -> float | None:
    """Return a frequency as a place, rad/s; None at infinity."""
    at = float(frequency[0].real)
    return at if np.isfinite(at) else None


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
