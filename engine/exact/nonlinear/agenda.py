"""The instants of a response that are known beforehand: breakpoints of the commands, their echoes, samples."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.ways import Flags, Ways

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.nonlinear.driving import Driving

Array = npt.NDArray[Any]

TOGETHER: Final = 1e-12
"""Instants closer than this part of the time are one."""

SMOOTH: Final = 6
"""A kink that went through so many delays is smoother than the polynomials of a step can see."""

_TAKEN: Final = 1e-6
"""A sample has been taken that is due within this part of its period."""


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
    """Stops of one response in their order; what is due is taken off.

    Parameters
    ----------
    system : NonlinearSystem
        Its laws' first samples are noted.
    driving : Driving
        Its commands.
    """

    def __init__(self, system: NonlinearSystem, driving: Driving) -> None:
        self._system, self._driving, self._ways = system, driving, Ways(system)
        self._stops: list[Stop] = []
        self._numbers = itertools.count()
        self._noted = -math.inf
        for number in self._samplers:
            law = system.laws[number]
            self._note(np.ravel(np.asarray(law.element.offset(law.values))), law=number)

    def __len__(self) -> int:
        return len(self._stops)

    def _note(self, time: Any, **what: Any) -> None:
        """Note a stop at ``time``, a number or (lanes,)."""
        lanes = np.zeros(self._system.lanes, dtype=complex if self._system.complex else float) + np.ravel(
            np.asarray(time)
        )
        stop = Stop(time=float(lanes[0].real), number=next(self._numbers), lanes=lanes, **what)
        bisect.insort(self._stops, stop, key=_lateness)

    def note_breaks(self, horizon: float) -> None:
        """Note where the commands break up to ``horizon`` (s), each once."""
        found = [t for t in self._driving.breaks(horizon) if t > self._noted]
        for t in found:
            self._note(t, generation=0)
        self._noted = max([self._noted, *found])

    def sample_again(self, number: int, now: float) -> None:
        """Note when a law updates its output from the last sample that it has taken, and when it takes the next."""
        law = self._system.laws[number]
        period, latency, offset = (
            np.ravel(np.asarray(of(law.values))) for of in (law.element.period, law.element.latency, law.element.offset)
        )
        pace = float(period[0].real)
        count = math.floor((now - float(offset[0].real)) / pace + _TAKEN)
        self._note(offset + period * (count + 1), law=number)
        update = offset + period * count + latency
        if np.any(latency != 0) and count >= 0 and float(update[0].real) > now + _TAKEN * pace:
            self._note(update, law=number, updates=True)

    def sample_anew(self, now: float) -> None:
        """Note the samples of all laws from ``now`` on in place of those that are noted."""
        self._stops = [stop for stop in self._stops if stop.law is None]
        for number in self._samplers:
            self.sample_again(number, now)

    @cached_property
    def _samplers(self) -> list[int]:
        """The laws that take samples, the slowest first: in that order samples are taken that fall together, the first ones too."""
        periods = {k: law.element.period(law.values) for k, law in enumerate(self._system.laws)}
        paces = {k: float(np.ravel(np.asarray(period))[0].real) for k, period in periods.items() if period is not None}
        return sorted(paces, key=lambda k: -paces[k])

    def echo(self, t: Array, generation: int, onward: Flags | None = None) -> None:
        """Note that what changes at ``t`` (lanes,) comes back through every delay, or those that it goes ``onward`` into."""
        if generation < SMOOTH:
            delays = self._system.delays
            for i in range(delays.shape[-1]) if onward is None else np.flatnonzero(onward).tolist():
                self._note(t + delays[:, i], generation=generation + 1, delay=i)

    def onward(self, due: Sequence[Stop]) -> Flags:
        """Return into which delays goes on what is due, (m,)."""
        ways = self._ways
        found = np.zeros(self._system.delays.shape[-1], dtype=bool)
        for stop in due:
            if stop.law is not None:
                found |= ways.from_laws[stop.law]
            else:
                found |= ways.from_commands if stop.delay is None else ways.from_delays[stop.delay]
        return found

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

    def ahead(self, count: int) -> list[Stop]:
        """Return the next ``count`` stops, or all there are."""
        return self._stops[: -count - 1 : -1]

    def drop(self, count: int) -> None:
        """Take off the next ``count`` stops."""
        del self._stops[len(self._stops) - count :]
