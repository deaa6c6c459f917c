"""Who may compute now: a few at a time, everybody in turn, and nobody who waits holds a thread.

A lane belongs to one event loop. Of those who wait, the next is of the workspace of which the fewest compute, then of its key
of which the fewest compute, then of whoever had no turn for the longest time. So a caller who asks for a hundred things waits for
his own; one who asks for a single thing waits for what is being computed, and for nothing else.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

from anyio import CapacityLimiter

from api.problems.documents import Problem
from api.problems.exceptions import RecalledError

#: How many keys of one workspace may fill the queue, each up to its own bound.
_KEYS = 4
#: What a caller is told who has too many waiting (s).
_RETRY = 5


@dataclass(frozen=True, slots=True, eq=False)
class _Waiting:
    workspace: str
    principal: str
    turn: asyncio.Future[None]


class Lane:
    """Slots for one sort of work.

    Parameters
    ----------
    slots : int
        How many compute at a time.
    most_waiting : int
        How many requests of one key may wait.
    """

    def __init__(self, slots: int, most_waiting: int) -> None:
        self._free = slots
        self._most_waiting = most_waiting
        self._waiting: list[_Waiting] = []
        self._running: Counter[tuple[str, ...]] = Counter()
        self._turns = 0
        self._last: dict[tuple[str, ...], int] = {}
        #: Threads of its own: none of other lanes, and none of requests that compute nothing.
        self.threads = CapacityLimiter(slots)

    @property
    def waiting(self) -> int:
        """How many wait."""
        return len(self._waiting)

    @asynccontextmanager
    async def place(
        self, workspace: str, principal: str, *, wakes: Callable[[Callable[[], object]], None] = lambda _: None
    ) -> AsyncIterator[None]:
        """Wait for a slot and hold it; ``wakes`` is told what ends the waiting.

        Raises
        ------
        Problem
            429 at once when as many wait for this caller as may.
        RecalledError
            When the waiting was ended.
        """
        await self._enter(workspace, principal, wakes)
        try:
            yield
        finally:
            self._leave(workspace, principal)

    async def _enter(self, workspace: str, principal: str, wakes: Callable[[Callable[[], object]], None]) -> None:
        if self._free and not self._waiting:
            self._begin(workspace, principal)
            return
        self._check(workspace, principal)
        own = _Waiting(workspace, principal, asyncio.get_running_loop().create_future())
        self._waiting.append(own)
        wakes(own.turn.cancel)
        try:
            await own.turn
        except asyncio.CancelledError:
            if own in self._waiting:
                self._waiting.remove(own)
            else:  # its turn had come just then
                self._leave(workspace, principal)
            task = asyncio.current_task()
            if own.turn.cancelled() and not (task is not None and task.cancelling()):
                raise RecalledError from None
            raise

    def _check(self, workspace: str, principal: str) -> None:
        own = sum(other.workspace == workspace and other.principal == principal for other in self._waiting)
        house = sum(other.workspace == workspace for other in self._waiting)
        most = self._most_waiting
        if own >= most or house >= _KEYS * most:
            whose, count, limit = ("key", own, most) if own >= most else ("workspace", house, _KEYS * most)
            raise Problem(
                429,
                "too-many-waiting",
                f"at most {limit} requests of one {whose} may wait to be computed, {count} do; try again later",
                headers={"Retry-After": str(_RETRY)},
            )

    def _begin(self, workspace: str, principal: str) -> None:
        self._free -= 1
        self._turns += 1
        for whose in ((workspace,), (workspace, principal)):
            self._running[whose] += 1
            self._last[whose] = self._turns

    def _leave(self, workspace: str, principal: str) -> None:
        self._free += 1
        for whose in ((workspace,), (workspace, principal)):
            self._running[whose] -= 1
            if not self._running[whose]:
                del self._running[whose]
        # A turn that was given to one who is gone passes to the next.
        while self._free and self._waiting:
            follower = min(self._waiting, key=self._rank)
            self._waiting.remove(follower)
            if not follower.turn.done():
                self._begin(follower.workspace, follower.principal)
                follower.turn.set_result(None)
        if not self._waiting and not self._running:
            self._last.clear()  # callers come and go

    def _rank(self, one: _Waiting) -> tuple[int, ...]:
        house, own = (one.workspace,), (one.workspace, one.principal)
        return self._running[house], self._last.get(house, 0), self._running[own], self._last.get(own, 0)
