"""Channels of recordings: from what was recorded to physical values, and to SI.

physical = raw * scale + offset   in the channel's unit
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from api.convert.values import si
from api.problems.documents import invalid
from api.problems.pointers import Place
from api.units.conversion import UnitError, declared, factor

Values = npt.NDArray[np.float64]


def physical(raw: Values, channel: Mapping[str, Any]) -> Values:
    """Return the calibrated values of a channel, in its own unit."""
    scaled = raw * float(channel.get("scale", 1.0))
    offset = float(channel.get("offset", 0.0))
    return np.asarray(scaled + offset if offset else scaled)  # -0 + 0 is 0, and would lose its sign


def envelope(low: Values, high: Values, channel: Mapping[str, Any]) -> tuple[Values, Values]:
    """Return calibrated minima and maxima; a negative scale exchanges them."""
    ends = physical(low, channel), physical(high, channel)
    return (ends[1], ends[0]) if float(channel.get("scale", 1.0)) < 0.0 else ends


def in_si(raw: Values, channel: Mapping[str, Any], *, place: Place) -> tuple[Values, str]:
    """Return the calibrated values of a channel in SI, and the name of that unit.

    Raises
    ------
    Problem
        422 for a unit without a factor (dB, degC).
    """
    unit = str(channel.get("unit", ""))
    try:
        target = declared(unit) if unit else ""
        scale = float(factor(unit, target)) if unit else 1.0
    except UnitError as error:
        raise invalid(f"channel {channel['name']}: {error}", *place) from error
    return physical(raw, channel) * scale, target


def window(given: list[Any] | None, *, length: float, name: str, place: Place = ()) -> tuple[float, float] | None:
    """Return [t0, t1] in s, None for the whole recording; ``place`` is that of the document that has it.

    Raises
    ------
    Problem
        422 unless 0 <= t0 < t1 <= length.
    """
    if given is None:
        return None
    begin, end = (si(value, "s", name=name, place=(*place, name, i)) for i, value in enumerate(given))
    if not 0.0 <= begin < end:
        raise invalid(f"{name} must be [t0, t1] with 0 <= t0 < t1 s, got [{begin:g}, {end:g}]", *place, name)
    if begin >= length:
        raise invalid(f"{name} must begin within the recording of {length:g} s, got {begin:g}", *place, name, 0)
    return begin, min(end, length)
