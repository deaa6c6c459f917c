"""The instants of a response that are known beforehand: breakpoints of the commands, their echoes, samples."""

from __future__ import annotations

import bisect
import itertools
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]

TOGETHER: Final = 1e-12
"""Instants closer than this part of the time are one."""

SMOOTH: Final = 6
"""A kink that went through so many delays is smoother than the polynomials of a step can see."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stop:
    """An instant ``time`` (s) with its infinitesimals ``lanes``.

    It is an echo of some ``generation`` that comes out of a ``delay``, or a ``law`` takes a sample there, or ``updates`` its output
    from the last one.
    """

    time: float
    number: int
    lanes: Array
    generation: int = SMOOTH
    delay: int | None = None
    law: int | None = None
    updates: bool = False


def _lateness(stop: Stop) -> tuple[float, int]:
    """Return what sorts stops so that the next one comes last, and can be taken off the end."""
    return -stop.time, -stop.number


class Agenda:
    """Stops in their order; what is due is taken off."""

    def __init__(self) -> None:
        self._stops: list[Stop] = []
        self._numbers = itertools.count()

    def __len__(self) -> int:
        return len(self._stops)

    def note(self, lanes: Array, **what: Any) -> None:
        """Note a stop at the instant ``lanes`` (lanes,)."""
        stop = Stop(time=float(lanes[0].real), number=next(self._numbers), lanes=lanes, **what)
        bisect.insort(self._stops, stop, key=_lateness)

    def due(self, now: float, horizon: float) -> list[Stop]:
        """Take off what is due now: breakpoints, updates, samples, each in the order in which they were noted."""
        grain = TOGETHER * max(horizon, now)
        found = []
        while self._stops and self._stops[-1].time <= now + grain:
            found.append(self._stops.pop())
        return sorted(found, key=lambda stop: (stop.law is not None, not stop.updates, stop.number))

    def following(self, horizon: float = np.inf) -> Stop | None:
        """Return the next stop before ``horizon``."""
        return self._stops[-1] if self._stops and self._stops[-1].time < horizon else None

    def kink(self, horizon: float) -> float:
        """Return the next instant that is no sample, ``horizon`` at the latest."""
        return min(horizon, next((stop.time for stop in reversed(self._stops) if stop.law is None), horizon))

    def clear_samples(self) -> None:
        """Take off all samples and updates."""
        self._stops = [stop for stop in self._stops if stop.law is None]

    def ahead(self, count: int) -> list[Stop]:
        """Return the next ``count`` stops, or all there are."""
        return self._stops[: -count - 1 : -1]

    def drop(self, count: int) -> None:
        """Take off the next ``count`` stops."""
        del self._stops[len(self._stops) - count :]
