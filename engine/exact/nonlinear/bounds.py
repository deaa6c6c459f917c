"""What ends a simulation before its time: too many steps, too long a computation, events without end, growth without bound."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Any, Final, NoReturn

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.switching import StoppedError
from engine.model.interruption import look
from engine.model.verdicts import Verdict

Array = npt.NDArray[Any]

MAX_STEPS: Final = 200_000
CROWDS: Final = ((100, 1e-6), (1000, 2e-3))
"""So many events within this part of the time simulated are an accumulation: at this pace no simulation comes to its end."""

HASTE: Final = (3000, 2e-2, 0.9)
"""So many events within this part of the time, the later half in less than this part of the time of the earlier one, accumulate, too."""

LARGEST: Final = 1e100
"""Beyond this a growing response is not followed."""

_RARELY: Final = 0.02
_EXPLODED: Final = 1e8
"""A state that has grown so much when its steps vanish,"""
_LATELY: Final = (30, 30.0)
"""and so much in its last steps, goes to infinity in finite time."""


def computing_time() -> Callable[[], float]:
    """Return a clock of what this thread has computed, s, which asks the system fifty times a second at most: an answer may take a millisecond."""
    asked, known = -math.inf, 0.0

    def clock() -> float:
        nonlocal asked, known
        now = time.perf_counter()
        if now - asked >= _RARELY:
            asked, known = now, time.thread_time()
        return known

    return clock


class Bounds:
    """Steps and events of one simulation, counted; each method raises `StoppedError`, with the verdict, at a bound.

    Parameters
    ----------
    clock : callable, optional
        Seconds; with ``limit`` (s) it bounds the time spent.
    """

    def __init__(self, clock: Callable[[], float] | None, limit: float) -> None:
        self._clock, self._limit = clock, limit
        self._began = clock() if clock is not None else 0.0
        self._recent: deque[float] = deque(maxlen=HASTE[0])
        self._sizes: deque[Array] = deque(maxlen=_LATELY[0])
        self.steps = self.events = 0

    def step(self, now: float, count: int = 1) -> None:
        """Count steps that are tried at the instant ``now`` (s)."""
        look()
        self.steps += count
        if self.steps > MAX_STEPS:
            self._late(now, f"after {MAX_STEPS} steps")
        if self._clock is not None and self._clock() - self._began > self._limit:
            self._late(now, f"after {self._limit:g} s of computing")

    def event(self, now: float, horizon: float, label: str) -> None:
        """Count an event of the law ``label`` in a simulation up to ``horizon`` (s)."""
        self.events += 1
        self._recent.append(now)
        crowded = any(
            len(self._recent) >= count and now - self._recent[-count] <= part * horizon for count, part in CROWDS
        )
        if crowded or self._hastens(horizon):
            raise StoppedError(
                Verdict.DOUBTFUL,
                f"events of {label} accumulate at t = {now:.6g} s: "
                "the model switches without end (give it hysteresis, a lag or more damping)",
            )

    def _hastens(self, horizon: float) -> bool:
        """Return whether many events follow each other ever faster."""
        recent, (count, part, shorter) = self._recent, HASTE
        if len(recent) < count or recent[-1] - recent[0] > part * horizon:
            return False
        middle = recent[count // 2]
        return recent[-1] - middle < shorter * (middle - recent[0])

    def state(self, now: float, last: Array) -> None:
        """Look at the state (lanes, n) at the end of a step."""
        self._sizes.append(np.abs(last[0].real))
        if not np.isfinite(last).all() or float(np.abs(last[0].real).max(initial=0.0)) > LARGEST:
            raise StoppedError(Verdict.UNSTABLE, f"the response grows beyond {LARGEST:g} at t = {now:.6g} s")

    def stuck(self, now: float, state: Array, first: Array, cause: str) -> NoReturn:
        """Say why steps vanish, from the state (n,), how large it was at first, and the ``cause`` of the last failure, if known."""
        grown = np.abs(state) > _EXPLODED * np.where(first > 0, first, np.inf)
        lately = [np.abs(state) > _LATELY[1] * before for before in list(self._sizes)[:1]]
        if (grown & np.all(lately, axis=0)).any():
            raise StoppedError(Verdict.UNSTABLE, f"the response grows without bound near t = {now:.6g} s")
        msg = f"the equations have no solution that can be followed beyond t = {now:.6g} s" + (cause and f": {cause}")
        raise StoppedError(Verdict.DOUBTFUL, msg)

    def _late(self, now: float, why: str) -> NoReturn:
        msg = f"the simulation stops at t = {now:.6g} s {why}: give it a shorter `duration`"
        raise StoppedError(Verdict.TOO_SHORT, msg)
