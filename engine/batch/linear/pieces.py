"""What is followed, and the pieces that come of it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]
Series = npt.NDArray[Any]


class Plan(NamedTuple):
    """What is followed: ``times`` (corners,), ``states`` (corners, w); ``last`` is the corner from which on the command rests, or -1."""

    times: Real
    states: Real
    last: int
    impulses: Real


class Pieces(NamedTuple):
    """``times`` (P + 1,), ``series`` (R, P, 17) and ``base`` (R, P) that is added to them; ``marks`` (corners + 1,): first piece behind each.

    ``shifts`` (P + 1,) are the infinitesimals of those times at which a slope may jump; series are those at real times all the same.
    ``progress`` (3,) are level, highest level made and number of pieces, ``moving`` (1,) when anything moved last, s.
    """

    times: Real
    shifts: Series
    series: Series
    base: Series
    marks: Whole
    scale: Real
    terms: Real
    largest: Real
    trial: Series
    state: Series
    other: Series
    term: Series
    progress: Whole
    moving: Real
