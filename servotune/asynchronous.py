"""The client for programs with an event loop: the same methods, awaited; the work is done by threads beside it.

What the service is asked, how a request is repeated and what an answer becomes is defined once, in the client that scripts use.
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self

from servotune.client import connect
from servotune.jobs import Job
from servotune.replies.base import Reply

_THREADS = 64
"""Calls at a time; each job that is waited for is one."""
_END = object()


class Awaited:
    """Something of the client whose methods are awaited; those that yield are iterated over with ``async for``."""

    def __init__(self, target: Any, threads: ThreadPoolExecutor) -> None:
        self._target, self._threads = target, threads

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._target, name)
        if callable(found):
            yields = str(getattr(found, "__annotations__", {}).get("return", "")).startswith("Iterator")
            return self._iterated(found) if yields else self._awaited(found)
        return found if _plain(found) else Awaited(found, self._threads)

    def __dir__(self) -> list[str]:
        return dir(self._target)

    def __repr__(self) -> str:
        return f"<Awaited {self._target!r}>"

    def _awaited(self, method: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(method)
        async def call(*given: Any, **named: Any) -> Any:
            return self._made(await self._beside(functools.partial(method, *given, **named)))

        return call

    def _iterated(self, method: Callable[..., Iterator[Any]]) -> Callable[..., AsyncIterator[Any]]:
        @functools.wraps(method)
        async def iterate(*given: Any, **named: Any) -> AsyncIterator[Any]:
            items = method(*given, **named)
            while (item := await self._beside(functools.partial(next, items, _END))) is not _END:
                yield self._made(item)

        return iterate

    async def _beside(self, work: Callable[[], Any]) -> Any:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)

    def _made(self, found: Any) -> Any:
        return Awaited(found, self._threads) if isinstance(found, Job) else found


def _plain(value: Any) -> bool:
    """Say whether a value is data, in which nothing waits for the service."""
    return value is None or isinstance(value, Reply | str | int | float | dict | list | tuple)


class AsyncClient(Awaited):
    """A connection to a Servotune service; its parts and methods are those of `Client`.

    Parameters
    ----------
    url : str, optional
    settings
        Those of `connect`.

    Notes
    -----
    A call that is cancelled ends for its caller; the service is asked to its end. Cancel long work by ``job.cancel()``.

    Examples
    --------
    ::

        async with servotune.AsyncClient() as client:
            replies = await asyncio.gather(*(client.simulate(axis, input=step, variants=[v]) for v in variants))
            job = await client.optimize(system=axis, variables=..., goals=...)
            async for event in job.events():
                print(event)
            result = await job.result()
    """

    def __init__(self, url: str | None = None, **settings: Any) -> None:
        super().__init__(connect(url, **settings), ThreadPoolExecutor(_THREADS, thread_name_prefix="servotune"))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connection; what is still waiting for an answer fails."""
        await self._beside(self._target.close)
        self._threads.shutdown(wait=False, cancel_futures=True)
