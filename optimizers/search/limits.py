"""A search that has a limited time stops a little before it is over, so that its best point can still be measured and proven.

A search hears of its end as of a cancel. What it leaves for the proof is a fifth of the time, more where single evaluations
take long: the proof is a few of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from engine.model.interruption import inside
from optimizers.search.result import Keeper, Monitor, Result, Status

MOST_BYTES: Final = 4e9
"""What a search may be expected to need unless it is said otherwise: a worker that needs more than it has ends without an answer."""

_FOR_THE_PROOF = 0.2
"""Part of the time that is left for the proof."""
_FOR_THE_END = 0.1
_RUNS = 3
"""Part of the time that is left for what has to follow the proof, and how many of the longest pauses that takes: curves, slopes."""
_EVALUATIONS = 4
"""The proof takes as long as so many of the longest pauses between two looks at the clock."""
_AT_LEAST = 0.3
"""Part of the time that a search has whatever its evaluations take."""


class Limited:
    """A monitor that ends a search before its time is over.

    Parameters
    ----------
    monitor : Monitor
        Hears everything; its own cancel goes through.
    seconds : float, optional
        How long everything may take, the proof included; no limit by default.
    clock : callable
        Returns the time (s) from an origin of its own.
    """

    def __init__(self, monitor: Monitor, seconds: float | None, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._monitor, self._seconds, self._clock = monitor, seconds, clock
        self._began = self._looked = clock()
        self._longest = 0.0
        self._ended: float | None = None

    def progress(self, fraction: float, message: str) -> None:
        """Pass the progress on."""
        self._monitor.progress(fraction, message)

    def best(self, evaluation: int, objective: float, violation: float, variables: Mapping[str, float]) -> None:
        """Pass the new best point on."""
        self._monitor.best(evaluation, objective, violation, variables)

    def cancelled(self) -> bool:
        """Return whether to stop: because the caller wants it, or because the time is almost over."""
        return self._monitor.cancelled() or self._late()

    def ended(self) -> bool:
        """Return whether nothing more may follow the proof: because the caller wants it, or because hardly any time is left."""
        return self._monitor.cancelled() or self.hardly_left()

    def hardly_left(self) -> bool:
        """Return whether the time is over but for what cannot be left out."""
        if self._seconds is None:
            return False
        return self._clock() - self._began >= self._seconds - max(_FOR_THE_END * self._seconds, _RUNS * self._longest)

    def keep(self, state: Mapping[str, Any]) -> None:
        """Pass a state on."""
        if isinstance(self._monitor, Keeper):
            self._monitor.keep(state)

    def kept(self) -> Mapping[str, Any] | None:
        """Return the last state."""
        return self._monitor.kept() if isinstance(self._monitor, Keeper) else None

    @property
    def over(self) -> bool:
        """Whether the search was stopped by the clock, and not by the caller."""
        return self._seconds is not None and not self._monitor.cancelled()

    def told(self, result: Result) -> Result:
        """Return a result that says so where it was the clock that ended the search."""
        if result.status is not Status.CANCELLED or not self.over:
            return result
        incomplete = "" if result.certificate.valid else ", and it does not meet every goal"
        advice = (
            f"the time of {self._seconds:.3g} s is used up{self._left()}: this is the best point until then{incomplete}. "
            "Allow it more time, begin from this point, or fix some of the variables."
        )
        return replace(result, status=Status.BUDGET, advice=advice)

    def _left(self) -> str:
        """Tell how much of the time the search has left for the proof."""
        return (
            "" if self._ended is None else f" (the search ended after {self._ended:.3g} s, to leave time for the proof)"
        )

    def _late(self) -> bool:
        if self._seconds is None:
            return False
        now = self._clock()
        longest = max(self._longest, now - self._looked)
        if not inside():  # an evaluation may be asked at its steps: it is as long as all of them
            self._longest, self._looked = longest, now
        reserve = max(_FOR_THE_PROOF * self._seconds, _EVALUATIONS * longest)
        late = now - self._began >= max(self._seconds - reserve, _AT_LEAST * self._seconds)
        if late and self._ended is None:
            self._ended = now - self._began
        return late
