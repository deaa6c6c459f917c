"""Which values of a file float64 does not hold: whole numbers beyond 2^53, and numbers of more bits than it has.

n = m 2^k, m odd,   is held exactly while m < 2^53
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

EXACT = 1 << 53
"""Up to it float64 holds every whole number."""
_INFINITE = (1 << 1024) - (1 << 970)
"""What is as large is infinite as float64."""


@dataclass(slots=True)
class Rounded:
    """How many values were rounded when they were read, by the name of their channel."""

    _most: dict[str, int] = field(default_factory=dict)

    def __bool__(self) -> bool:
        """Say whether any was."""
        return bool(self._most)

    def of(self, name: str) -> int:
        """Return how many of a channel were, as far as it has been read."""
        return self._most.get(name, 0)

    def at_least(self, name: str, count: int) -> None:
        """Say how many a reading has found: one that begins anew must not count them twice."""
        if count > self.of(name):
            self._most[name] = count

    def names(self) -> list[str]:
        """Return what has values that were rounded."""
        return list(self._most)


class Reading:
    """One way through the channels of a file, which counts what is rounded on it."""

    def __init__(self, rounded: Rounded) -> None:
        self._rounded = rounded
        self._found = Counter[str]()

    def floats(self, name: str, values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        """Return the next values of a channel, of any type of number, as float64."""
        self.count(name, inexact(values))
        return np.asarray(values, dtype=np.float64)

    def count(self, name: str, more: int) -> None:
        """Count values of a channel that were rounded."""
        if more:
            self._found[name] += more
            self._rounded.at_least(name, self._found[name])


def inexact(values: npt.NDArray[Any]) -> int:
    """Return how many numbers float64 does not hold.

    >>> inexact(np.array([2**53, 2**53 + 1, 2**60 + 2, -(2**63)]))
    2
    >>> inexact(np.array([0.1, 1e300])), inexact(np.array([True]))
    (0, 0)
    """
    kind, width = values.dtype.kind, values.dtype.itemsize
    if kind == "f" and width > 8:
        there = values[np.isfinite(values)]
        return int(np.count_nonzero(there.astype(np.float64).astype(values.dtype) != there))
    if kind not in "iu" or width < 8 or not values.size or (values.max() <= EXACT and values.min() >= -EXACT):
        return 0
    size = np.abs(values).astype(np.uint64)  # also of the least int64, whose absolute value is itself
    size = size[size > EXACT]
    return int(np.count_nonzero(size // (size & -size) >= EXACT))


def inexact_whole(numbers: Iterable[int | None]) -> int:
    """Return how many whole numbers of any length float64 does not hold; None is none.

    >>> inexact_whole([2**70, 2**70 + 1, None])
    1
    """
    beyond = [number for number in numbers if number is not None and abs(number) > EXACT]
    return sum(abs(number) >= _INFINITE or int(float(number)) != number for number in beyond)
