"""The client for programs with an event loop: the same methods, awaited; the work is done by threads beside it.

What the service is asked, how a request is repeated and what an answer becomes is defined once, in the client that scripts use.
Type checkers read the signatures in `asynchronous.pyi`, which `make stub` writes from that client.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Any, Self

from servotune.awaited import Awaited
from servotune.client import connect

_THREADS = 64
"""Calls at a time; each job that is waited for is one."""


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
        await self.beside(self._target.close)
        self._threads.shutdown(wait=False, cancel_futures=True)
