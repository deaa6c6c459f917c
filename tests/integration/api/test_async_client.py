"""The client in a program with an event loop, against a real service and a worker."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

import servotune
from tests.integration.api.conftest import Service
from tests.integration.api.documents import LAG, OPTIMIZATION

STEP = {"port": "u", "signal": {"kind": "step"}}


def ran(service: Service, work: Any, key: str = "admin") -> Any:
    async def within() -> Any:
        async with servotune.AsyncClient(service.url, key=service.keys[key]) as client:
            return await work(client)

    return asyncio.run(within())


def test_many_answers_at_once_are_those_of_the_client(sqlite_service: Service) -> None:
    variants = [{"tau": 0.1 * k} for k in range(1, 9)]

    async def work(client: servotune.AsyncClient) -> Any:
        asked = (client.simulate(LAG, input=STEP, variants=[one], samples=20) for one in variants)
        return await asyncio.gather(*asked)

    found = ran(sqlite_service, work)
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["admin"]) as client:
        assert found == [client.simulate(LAG, input=STEP, variants=[one], samples=20) for one in variants]


def test_lists_are_iterated_and_jobs_are_awaited(sqlite_service: Service, sqlite_worker: None) -> None:
    async def work(client: servotune.AsyncClient) -> None:
        stored = await client.systems.create(LAG)
        assert stored.id in [one.id async for one in client.systems.list()]
        job = await client.optimize(**{"system": stored.id} | OPTIMIZATION)
        assert job.kind == "optimization"
        names = {event.name async for event in job.events()}
        assert "status" in names
        result = await job.result()
        assert result.certificate.valid
        assert (await job.wait(progress=False)).best == result.best
        assert job.id in [one.id async for one in client.jobs.list(kind="optimization")]
        await client.systems.delete(stored.id)

    ran(sqlite_service, work)


def test_the_loop_goes_on_while_the_service_computes(sqlite_service: Service) -> None:
    async def work(client: servotune.AsyncClient) -> int:
        beats, done = 0, asyncio.Event()

        async def beat() -> None:
            nonlocal beats
            while not done.is_set():
                beats += 1
                await asyncio.sleep(0)

        beating = asyncio.create_task(beat())
        await client.simulate(LAG, input=STEP)
        done.set()
        await beating
        return beats

    assert ran(sqlite_service, work) > 1


def test_what_is_refused_is_raised_where_it_is_awaited(sqlite_service: Service) -> None:
    async def work(client: servotune.AsyncClient) -> None:
        with pytest.raises(servotune.NotFoundError):
            await client.systems.get("sys_none")
        with pytest.raises(AttributeError):
            client.nothing  # noqa: B018

    ran(sqlite_service, work)
    with pytest.raises(servotune.UnauthorizedError):
        ran(sqlite_service, lambda client: client.systems.get("sys_none"), key="revoked")
