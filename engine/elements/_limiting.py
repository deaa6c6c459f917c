"""What limits make of a number: the law without memory of a sampler's output, or of a block that acts at samples alone.

within     u = min(max(v, lower), upper), no further than reach from the u before
beyond     u = v - upper (v > upper), 0, v - lower (v < lower)
levels     u = lower · round(v/lower)
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple


class Shape(IntEnum):
    """Which of the three it is; of a sampler whose integral part waits at a limit, that too."""

    WITHIN = 0
    WAITING = 1
    BEYOND = 2
    LEVELS = 3


class Limiting(NamedTuple):
    """What is made of an output v.

    The state number ``integral`` (None: none) takes ``share`` (u - v) besides, or keeps its value where it waits and what it takes
    drives v further beyond.
    """

    lower: Any
    upper: Any
    reach: Any = float("inf")
    integral: int | None = None
    share: Any = 0.0
    shape: Shape = Shape.WITHIN
