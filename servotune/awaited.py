"""Methods of an object, awaited: threads beside the event loop do the work."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from servotune.jobs import Job
from servotune.replies.base import Reply

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
            return self._made(await self.beside(functools.partial(method, *given, **named)))

        return call

    def _iterated(self, method: Callable[..., Iterator[Any]]) -> Callable[..., AsyncIterator[Any]]:
        @functools.wraps(method)
        async def iterate(*given: Any, **named: Any) -> AsyncIterator[Any]:
            items = method(*given, **named)
            while (item := await self.beside(functools.partial(next, items, _END))) is not _END:
                yield self._made(item)

        return iterate

    async def beside(self, work: Callable[[], Any]) -> Any:
        """Return what some work returns, done by one of the threads."""
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)

    def _made(self, found: Any) -> Any:
        return Awaited(found, self._threads) if isinstance(found, Job) else found


def _plain(value: Any) -> bool:
    """Say whether a value is data, in which nothing waits for the service."""
    return value is None or isinstance(value, Reply | str | int | float | dict | list | tuple)
