"""Who may come in, known for a second: two hundred callers a second are one question to the database, not two hundred.

What a caller shows belongs to one key or sign-in for ever, and what that may do never changes; only whether it still opens
does. So all who came lately are asked for together, and nobody is let in on an answer older than `FRESH`. What is revoked
in one process of a service (`api.runtime.shared_memory`) is out at once in all of them; what another service of the same database revokes,
within that second.
"""

from __future__ import annotations

import asyncio
import contextvars
import itertools
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Protocol, TypeVar

from api.services.access.uses import Uses
from storage.models.base import utc_now
from storage.repositories import open_principals
from storage.session import Database

if TYPE_CHECKING:  # an installation has its callers
    from api.services.operation.app_context import Caller

#: s for which an answer of the database counts: the longest time that a key opens here after it was revoked elsewhere.
FRESH = 1.0
#: s after which somebody who does not come any more is not asked for any more.
_IDLE = 60.0
#: Callers of whom the hash of what they showed is kept, and who are asked for in one question (a statement of SQLite takes
#: 32,766 values, and each of them is two).
_MOST_KNOWN = 10_000
#: Questions to the database at the same time.
_AT_ONCE = 8

_T = TypeVar("_T")


class Count(Protocol):
    """A number that only grows."""

    def get(self) -> int:
        """Return it."""

    def count(self) -> None:
        """Add one."""


class _OwnCount:
    def __init__(self) -> None:
        self._count = itertools.count(1)
        self._value = 0

    def get(self) -> int:
        return self._value

    def count(self) -> None:
        self._value = next(self._count)


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Who showed something that opens, the key behind it where there is one, and when it ends, which nobody need be asked."""

    caller: Caller
    key: str | None
    expires_at: datetime | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Answer:
    """Who was asked for, and who of those may come in."""

    among: frozenset[str]
    opening: frozenset[str]


class Callers:
    """The callers of one process of the service; but for `forget`, everything happens in its event loop.

    Parameters
    ----------
    database : Database
    clock : callable
        The time in s.
    revocations : Count, optional
        How often any process of the service has forgotten; counted here alone by default.
    """

    def __init__(
        self,
        database: Database,
        *,
        clock: Callable[[], float] = time.monotonic,
        revocations: Count | None = None,
    ) -> None:
        self._revocations = _OwnCount() if revocations is None else revocations
        self._forgotten = self._revocations.get()
        self.uses = Uses(database, clock=clock)
        self._database = database
        self._clock = clock
        # Of their own: in the threads that all share, webhooks wait for names of hosts, which may take as long as they like.
        self._threads = ThreadPoolExecutor(_AT_ONCE, thread_name_prefix="callers")
        self._known: dict[bytes, Found] = {}  # by the hash of what they showed
        self._came: dict[str, float] = {}  # principal -> when it came last, in that order
        self._confirmed: dict[str, float] = {}  # principal -> when the question was asked that was answered with yes
        self._asking: asyncio.Task[_Answer] | None = None

    async def find(self, shown: bytes, look_up: Callable[[], Found | None]) -> Caller | None:
        """Return who shows something with this hash, None when it does not open (any more).

        Raises
        ------
        storage.errors.UNAVAILABLE
            When the database must be asked and does not answer.
        """
        self._hear()
        found = self._known.get(shown)
        if found is None:
            confirmed, now = self._confirmed, self._clock()
            found = await self._apart(look_up)
            if found is None:
                return None
            confirmed[found.caller.principal] = now
            self._comes(found.caller.principal)
            self._known[shown] = found
            if len(self._known) > _MOST_KNOWN:
                del self._known[next(iter(self._known))]
        elif _over(found) or not await self.opens(found.caller.principal):
            self._known.pop(shown, None)
            return None
        if found.key is not None:
            self.uses.note(found.key)
        return found.caller

    async def opens(self, principal: str) -> bool:
        """Return whether a key or a sign-in, by its id, (still) opens; raises as `find` does."""
        self._hear()
        self._comes(principal)
        while self._clock() - self._confirmed.get(principal, -math.inf) > FRESH:
            asking = self._asking  # which another thread may forget meanwhile
            if asking is None or asking.done():
                asking = self._asking = asyncio.create_task(self._ask())
                asking.add_done_callback(_heard)
            answer = await asyncio.shield(asking)
            if principal in answer.among:  # not so when that question was already on its way
                return principal in answer.opening
            self._comes(principal)  # or when it has waited so long that it counted as gone
        return True

    def forget(self) -> None:
        """Ask for everybody anew, in every process: somebody may not come in any more. Safe in any thread."""
        self._revocations.count()
        self._forget()

    def _forget(self) -> None:
        # In this order: who sees that nothing is confirmed must not wait for an answer to an older question.
        self._asking = None
        self._confirmed = {}

    def _hear(self) -> None:
        """Forget what was confirmed before somebody was shut out in another process."""
        count = self._revocations.get()
        if count != self._forgotten:
            self._forget()
            self._forgotten = count

    def _comes(self, principal: str) -> None:
        self._came.pop(principal, None)
        self._came[principal] = self._clock()

    async def _ask(self) -> _Answer:
        confirmed, now = self._confirmed, self._clock()
        lately = [entry for entry in self._came.items() if now - entry[1] <= _IDLE]
        self._came = dict(lately[-_MOST_KNOWN:])
        for principal in confirmed.keys() - self._came.keys():
            del confirmed[principal]
        among = frozenset(self._came)
        opening = await self._apart(partial(self._open_among, among))
        for principal in among:
            if principal in opening:
                confirmed[principal] = now
            else:
                confirmed.pop(principal, None)
                self._came.pop(principal, None)
        return _Answer(among=among, opening=opening)

    async def _apart(self, work: Callable[[], _T]) -> _T:
        context = contextvars.copy_context()
        return await asyncio.get_running_loop().run_in_executor(self._threads, lambda: context.run(work))

    def _open_among(self, principals: frozenset[str]) -> frozenset[str]:
        with self._database.session() as session:
            return open_principals(session, principals)


def _over(found: Found) -> bool:
    return found.expires_at is not None and found.expires_at <= utc_now()


def _heard(asked: asyncio.Task[_Answer]) -> None:
    """Take an error that nobody waits for any more; who waits gets it, too."""
    if not asked.cancelled():
        asked.exception()
