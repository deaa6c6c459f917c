"""How long a search took, by what it did: looking at many points, refining with slopes, proving.

Wall time and the processor time of this process (all its threads) and of those that compute for it. A stage inside another one does not count for that.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import StrEnum


class Stage(StrEnum):
    """What a search does."""

    SCREENING = "screening"
    REFINING = "refining"
    CERTIFICATE = "certificate"
    OTHER = "other"


@dataclass(kw_only=True)
class Spent:
    """Wall time and processor time, s."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0


@dataclass(kw_only=True)
class Effort:
    """The time of one search, by stage; ``OTHER`` is what belongs to none. ``ended`` tells whether hardly any is left."""

    ended: Callable[[], bool] | None = None
    stages: dict[Stage, Spent] = field(default_factory=lambda: {stage: Spent() for stage in Stage})
    now: Stage = Stage.OTHER
    _since: tuple[float, float] = field(default_factory=lambda: (time.perf_counter(), time.process_time()))

    @contextmanager
    def limited(self, ended: Callable[[], bool]) -> Iterator[None]:
        """Let what is measured inside end by this limit; inside another one it is that one."""
        outer = self.ended
        self.ended = outer or ended
        try:
            yield
        finally:
            self.ended = outer

    def spent(self) -> dict[str, dict[str, float]]:
        """Return stage -> ``seconds`` and ``cpu_seconds`` until now, in plain numbers."""
        self.turn(self.now)
        return {
            str(stage): {"seconds": spent.seconds, "cpu_seconds": spent.cpu_seconds}
            for stage, spent in self.stages.items()
        }

    def turn(self, stage: Stage) -> Stage:
        """Count from now on for another stage; return which it was until now."""
        wall, cpu = time.perf_counter(), time.process_time()
        spent = self.stages[self.now]
        spent.seconds += wall - self._since[0]
        spent.cpu_seconds += cpu - self._since[1]
        before, self.now, self._since = self.now, stage, (wall, cpu)
        return before


def seconds_of(spent: Mapping[str, Mapping[str, float]]) -> float:
    """Return the wall time of all stages together, s."""
    return sum(times["seconds"] for times in spent.values())


_CURRENT: ContextVar[Effort | None] = ContextVar("effort", default=None)


def elapsed() -> float | None:
    """Return the wall time (s) of all that is measured now, None where nobody measures."""
    effort = _CURRENT.get()
    return None if effort is None else seconds_of(effort.spent())


def elsewhere(cpu_seconds: float) -> None:
    """Count processor time that other processes spent for what is done now."""
    effort = _CURRENT.get()
    if effort is not None:
        effort.stages[effort.now].cpu_seconds += cpu_seconds


def over() -> bool:
    """Return whether hardly any time is left of what all that is measured now may take; False where there is no limit."""
    effort = _CURRENT.get()
    return effort is not None and effort.ended is not None and effort.ended()


@contextmanager
def metered() -> Iterator[Effort]:
    """Measure what is done inside; when it is left, every stage is complete. Inside another one it is that one."""
    outer = _CURRENT.get()
    if outer is not None:
        yield outer
        return
    effort = Effort()
    token = _CURRENT.set(effort)
    try:
        yield effort
    finally:
        effort.turn(Stage.OTHER)
        _CURRENT.reset(token)


@contextmanager
def during(stage: Stage) -> Iterator[None]:
    """Count what is done inside for a stage, where anybody measures."""
    effort = _CURRENT.get()
    if effort is None:
        yield
        return
    before = effort.turn(stage)
    try:
        yield
    finally:
        effort.turn(before)
