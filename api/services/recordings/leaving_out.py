"""Whether a recording holds all that is in its file: every channel, each number as it is there, and the instant of each sample.

    x_i = t_0 + i / rate,   or t_0 and the instants that are kept

An instant is held where x_i is it to the bit (on an even axis: to the rounding of float64), is it once rounded to single precision as all
instants of the file are, or once rounded to the last digit that the file has of any of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from api.formats import Recording, Values
from api.services.recordings.groups import Part
from api.services.recordings.sampling import TimeAxis

MOST_SCALARS = 200
"""Single numbers beside the channels that a report has."""
_DIGITS = 12
_ULPS = 4.0
"""What n / rate and a file's own n * step may differ by, in units of their last bit."""
_SAME_RATE = 1e-11
"""Rates are taken from files with twelve digits."""


def all_taken(recording: Recording, part: Part) -> bool:
    """Return whether a file holds nothing but the channels that were taken from it, each value as it is there."""
    taken = {*part.plan.places} | ({part.plan.time} if part.plan.time is not None else set())
    resampled = isinstance(part.plan.document.get("uneven"), Mapping)
    more = recording.functions or recording.refused or recording.rounded or len(recording.scalars) > MOST_SCALARS
    return (
        recording.complete
        and len(taken) == len(recording.series)
        and not (more or resampled)
        and _at_their_rate(recording, part)
    )


def _at_their_rate(recording: Recording, part: Part) -> bool:
    """Return whether the rate that a file states is the one that was taken."""
    stated = {recording.layout.get("sample_rate"), *(one.sample_rate for one in recording.series)}
    taken = part.plan.sample_rate
    return all(
        math.isclose(rate, taken, rel_tol=_SAME_RATE) for rate in stated if rate is not None and taken is not None
    )


class InstantsHeld:
    """Takes the instants of a file in order, and compares them with those that its recording has.

    Parameters
    ----------
    axis : TimeAxis
        Has seen all of them.
    rate : float, optional
        Of the recording; None where it keeps the instants themselves.
    """

    def __init__(self, axis: TimeAxis, rate: float | None) -> None:
        self._axis = axis
        self._again = TimeAxis(fill=axis.fill, of_day=axis.of_day, scale=axis.scale, judging=True)
        self._rate = rate
        self._to_the_bit = True
        self._single = True
        self._digits: int | None = 0
        self._off = 0.0

    def add(self, instants: Values) -> None:
        """Take the next instants (n,) as the file has them."""
        start = self._again.count
        since = self._again.add(instants)
        # times of day that have passed midnight go on
        there = since + self._again.first if self._axis.of_day else instants
        if self._rate is not None:
            since = self._axis.places(np.arange(start, self._again.count)) / self._rate
        kept = (since + self._axis.first) / self._axis.scale
        off = np.abs(kept - there)
        ulps = 0.0 if self._rate is None else _ULPS
        self._to_the_bit &= bool(np.all(off <= ulps * np.spacing(np.maximum(np.abs(there), np.abs(kept)))))
        narrow = there.astype(np.float32)
        self._single &= bool(np.all(narrow == there) and np.all(narrow == kept.astype(np.float32)))
        digits = _digits_of(there)
        self._digits = None if digits is None or self._digits is None else max(self._digits, digits)
        self._off = max(self._off, float(off.max(initial=0.0)))

    @property
    def all_held(self) -> bool:
        """Whether each instant that has come by can be told from what is kept."""
        printed = self._digits is not None and self._off < 0.5 * 10.0**-self._digits
        return self._to_the_bit or self._single or printed


def _digits_of(instants: Values) -> int | None:
    """Return how many digits behind the point some instants have, None where that is no matter of digits."""
    for digits in range(_DIGITS + 1):
        scaled = instants * 10.0**digits
        # a printed number is the nearest float64 to a multiple of its last digit
        if np.all(np.abs(scaled - np.rint(scaled)) <= 2.0 * np.spacing(np.abs(scaled))):
            return digits
    return None
