"""Who computes next: everybody in turn, and not more waiting than may."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from api.problems.documents import Problem
from api.problems.exceptions import RecalledError
from api.services.jobs.computing import Recall
from api.services.jobs.lanes import Lane


class Callers:
    """Requests that hold their slot until they are let go; ``begun`` says in which order they got one."""

    def __init__(self, lane: Lane) -> None:
        self.lane = lane
        self.begun: list[str] = []
        self._go: dict[str, asyncio.Event] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}

    async def ask(self, name: str, *, wakes: Callable[..., None] = lambda _: None) -> asyncio.Task[None]:
        """Ask as ``workspace/key/number``; return when it computes or waits."""
        workspace, key, _ = name.split("/")
        self._go[name] = asyncio.Event()

        async def compute() -> None:
            async with self.lane.place(workspace, key, wakes=wakes):
                self.begun.append(name)
                await self._go[name].wait()

        self._tasks[name] = asyncio.create_task(compute())
        await asyncio.sleep(0)
        return self._tasks[name]

    async def end(self, name: str) -> None:
        self._go[name].set()
        await self._tasks[name]
        await asyncio.sleep(0)

    async def end_all(self) -> list[str]:
        while any(not task.done() for task in self._tasks.values()):
            await self.end(next(name for name in self.begun if not self._tasks[name].done()))
        return self.begun


def run(work, *, slots: int = 1, most_waiting: int = 10):
    async def within():
        return await work(Callers(Lane(slots, most_waiting)))

    return asyncio.run(within())


def test_whoever_asks_for_much_waits_for_his_own() -> None:
    async def work(callers: Callers) -> list[str]:
        for name in ("a/k/1", "a/k/2", "a/k/3", "a/other/4", "b/k/5", "b/k/6"):
            await callers.ask(name)
        return await callers.end_all()

    assert run(work) == ["a/k/1", "b/k/5", "a/other/4", "b/k/6", "a/k/2", "a/k/3"]


def test_of_two_slots_each_workspace_gets_one() -> None:
    async def work(callers: Callers) -> list[str]:
        for name in ("a/k/1", "a/k/2", "a/k/3", "b/k/4"):
            await callers.ask(name)
        await callers.end("a/k/2")
        return list(callers.begun)

    assert run(work, slots=2) == ["a/k/1", "a/k/2", "b/k/4"]


def test_one_too_many_of_a_key_is_refused_at_once_and_others_are_not() -> None:
    async def work(callers: Callers) -> Problem:
        for name in ("a/k/1", "a/k/2", "a/k/3"):
            await callers.ask(name)
        refused = await callers.ask("a/k/4")
        with pytest.raises(Problem) as caught:
            await refused
        waits = await callers.ask("a/other/5")
        assert not waits.done()
        del callers._tasks["a/k/4"]
        assert await callers.end_all() == ["a/k/1", "a/other/5", "a/k/2", "a/k/3"]
        return caught.value

    problem = run(work, most_waiting=2)
    assert (problem.status, problem.headers) == (429, {"Retry-After": "5"})
    assert problem.detail == "at most 2 requests of one key may wait to be computed, 2 do; try again later"


def test_many_keys_of_a_workspace_fill_no_more_than_its_share() -> None:
    async def work(callers: Callers) -> str:
        for number in range(5):
            await callers.ask(f"a/k{number}/{number}")
        refused = await callers.ask("a/k9/9")
        with pytest.raises(Problem) as caught:
            await refused
        waits = await callers.ask("b/k/1")
        assert not waits.done()
        waits.cancel()
        return caught.value.detail

    assert run(work, most_waiting=1).startswith("at most 4 requests of one workspace may wait")


def test_whoever_leaves_waits_no_more() -> None:
    async def work(callers: Callers) -> list[str]:
        recall = Recall()
        await callers.ask("a/k/1")
        left = await callers.ask("b/k/2", wakes=recall.wakes)
        await callers.ask("c/k/3")
        recall.ask()
        with pytest.raises(RecalledError):
            await left
        assert callers.lane.waiting == 1
        return await callers.end_all()

    assert run(work) == ["a/k/1", "c/k/3"]


def test_a_turn_that_comes_to_one_who_has_just_been_cut_off_passes_to_the_next() -> None:
    async def work(callers: Callers) -> list[str]:
        first = await callers.ask("a/k/1")
        cut = await callers.ask("b/k/2")
        await callers.ask("c/k/3")
        callers._go["a/k/1"].set()
        await asyncio.sleep(
            0
        )  # the first one has ended, and the second one's turn has come, but it has not heard of it
        await first
        cut.cancel()
        with pytest.raises(asyncio.CancelledError):
            await cut
        await asyncio.sleep(0)
        return list(callers.begun)

    assert run(work)[-1] == "c/k/3"
