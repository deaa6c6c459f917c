"""Who may come in is asked for once a second, for all together; what ends elsewhere has ended here within that second."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import event

from api.services.access.keys import caller_of
from api.services.access.principal_cache import FRESH, Callers
from api.services.access.sign_ins import visitor_of
from storage import Database, open_database
from storage.models import DEFAULT_WORKSPACE
from storage.models.base import utc_now
from storage.repositories import ApiKeyRepository, SignInRepository
from tests.integration.coroutines import run


class Door:
    """The callers of one process, a clock that is set by hand, and another process with the same database."""

    def __init__(self, database: Database, elsewhere: Database) -> None:
        self.now = 0.0
        self.questions = 0
        self.database, self.elsewhere = database, elsewhere
        self.callers = Callers(database, clock=lambda: self.now)
        event.listen(database.engine, "before_cursor_execute", self._count)

    def _count(self, *_: object) -> None:
        self.questions += 1

    def key(self, expires_at: datetime | None = None) -> tuple[str, str]:
        with self.elsewhere.session() as session:
            row, token = ApiKeyRepository(session, DEFAULT_WORKSPACE).create(
                name="k", scopes=["read"], expires_at=expires_at
            )
            return row.id, token

    def revoke(self, key: str) -> None:
        with self.elsewhere.session() as session:
            ApiKeyRepository(session, DEFAULT_WORKSPACE).revoke(key)

    async def lets_in(self, token: str) -> bool:
        return await self.callers.find(token.encode(), partial(caller_of, self.database, token)) is not None


@pytest.fixture
def door(sqlite_template: Path, tmp_path: Path):
    path = tmp_path / "callers.db"
    path.write_bytes(sqlite_template.read_bytes())
    database, elsewhere = open_database(f"sqlite:///{path}"), open_database(f"sqlite:///{path}")
    yield Door(database, elsewhere)
    database.dispose()
    elsewhere.dispose()


def test_a_key_revoked_elsewhere_is_out_within_the_second(door) -> None:
    async def story() -> None:
        key, token = door.key()
        assert await door.lets_in(token)
        door.revoke(key)
        door.now = FRESH + 0.001
        assert not await door.lets_in(token)
        assert not await door.callers.opens(key)

    run(story())


def test_a_key_revoked_here_is_out_at_once(door) -> None:
    async def story() -> None:
        key, token = door.key()
        assert await door.lets_in(token)
        door.revoke(key)
        door.callers.forget()
        assert not await door.lets_in(token)

    run(story())


def test_a_key_that_ends_is_out_at_that_moment_without_a_question(door, monkeypatch) -> None:
    async def story() -> None:
        end = utc_now() + timedelta(hours=1)
        _, token = door.key(end)
        assert await door.lets_in(token)
        door.questions = 0
        monkeypatch.setattr("api.services.access.principal_cache.utc_now", lambda: end - timedelta(milliseconds=1))
        assert await door.lets_in(token)
        monkeypatch.setattr("api.services.access.principal_cache.utc_now", lambda: end)
        found = door.callers.find(token.encode(), partial(caller_of, door.database, token))
        assert await found is None
        assert door.questions == 0

    run(story())


def test_who_waited_longer_than_the_idle_are_remembered_gets_an_answer(door) -> None:
    async def story() -> None:
        (_, one), (another, _) = door.key(), door.key()
        assert await door.lets_in(one)
        door.now = FRESH + 0.001
        first = asyncio.create_task(door.lets_in(one))
        await asyncio.sleep(0)
        second = asyncio.create_task(door.callers.opens(another))  # after the question of the first was asked
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        door.now += 1000.0
        assert await asyncio.wait_for(second, 30)
        assert await first

    run(story())


def test_more_callers_than_one_question_asks_for_get_their_answers(door, monkeypatch) -> None:
    monkeypatch.setattr("api.services.access.principal_cache._MOST_KNOWN", 3)

    async def story() -> None:
        keys = [door.key()[0] for _ in range(10)]
        door.revoke(keys[4])
        answers = await asyncio.wait_for(asyncio.gather(*(door.callers.opens(key) for key in keys)), 30)
        assert answers == [key != keys[4] for key in keys]

    run(story())


def test_threads_that_wait_for_something_else_keep_nobody_out(door) -> None:
    async def story() -> None:
        _, token = door.key()
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(1))
        over = threading.Event()
        waiting = asyncio.create_task(asyncio.to_thread(over.wait))
        await asyncio.sleep(0)
        try:
            assert await asyncio.wait_for(door.lets_in(token), 30)
            door.now = FRESH + 0.001
            assert await asyncio.wait_for(door.lets_in(token), 30)
        finally:
            over.set()
            await waiting

    run(story())


def test_an_answer_to_an_older_question_lets_nobody_in(door) -> None:
    async def story() -> None:
        key, token = door.key()
        assert await door.lets_in(token)
        door.now = FRESH + 0.001
        # The question is asked, and before its answer is heard the key is revoked here.
        older = asyncio.create_task(door.lets_in(token))
        await asyncio.sleep(0)
        door.revoke(key)
        door.callers.forget()
        assert not await door.lets_in(token)
        await older
        assert not await door.lets_in(token)

    run(story())


def test_all_who_came_are_one_question(door) -> None:
    async def story() -> None:
        tokens = [door.key()[1] for _ in range(20)]
        assert all([await door.lets_in(token) for token in tokens])
        door.questions = 0
        assert all(await asyncio.gather(*(door.lets_in(token) for token in tokens)))
        assert door.questions == 0
        door.now = FRESH + 0.001
        assert all(await asyncio.gather(*(door.lets_in(token) for token in tokens)))
        assert door.questions == 1
        assert all(await asyncio.gather(*(door.lets_in(token) for token in tokens)))
        assert door.questions == 1

    run(story())


def test_a_browser_is_out_when_it_has_signed_out_or_its_key_has_ended(door) -> None:
    async def story() -> None:
        key, _token = door.key()
        cookies, rows = [], []
        for _ in range(2):
            with door.elsewhere.session() as session:
                row, cookie = SignInRepository(session).open(
                    workspace_id=DEFAULT_WORKSPACE, name="b", lasts=timedelta(hours=1), key_id=key
                )
                rows.append(row.id)
                cookies.append(cookie)

        async def let_in() -> list[bool]:
            ways = (door.callers.find(c.encode(), partial(visitor_of, door.database, c)) for c in cookies)
            return [await way is not None for way in ways]

        assert await let_in() == [True, True]
        with door.elsewhere.session() as session:
            SignInRepository(session).close(rows[0])
        door.now = FRESH + 0.001
        assert await let_in() == [False, True]
        door.revoke(key)
        door.now += FRESH + 0.001
        assert await let_in() == [False, False]

    run(story())


def test_uses_are_written_once_a_minute_and_never_where_nothing_can_be(door) -> None:
    async def story() -> None:
        key, token = door.key()

        def last_use() -> object:
            with door.elsewhere.session() as session:
                return ApiKeyRepository(session, DEFAULT_WORKSPACE).get(key).last_used_at

        assert await door.lets_in(token)
        assert last_use() is None
        door.callers.uses.write()
        first = last_use()
        assert first is not None
        assert await door.lets_in(token)
        assert not door.callers.uses.due
        door.now = 60.0
        assert await door.lets_in(token)
        assert door.callers.uses.due
        with door.database.engine.connect() as connection:
            connection.exec_driver_sql("PRAGMA query_only = ON")
        door.callers.uses.write()  # the same connection, which only reads
        assert last_use() == first
        assert await door.lets_in(token)

    run(story())
