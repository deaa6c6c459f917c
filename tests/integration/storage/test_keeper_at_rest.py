"""A worker that sleeps until a job is handed out asks the database once in each sleep whether it has claims; one that is awake asks each time."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from sqlalchemy import event, text

from storage import Database
from storage.jobs.children import Zygote
from storage.jobs.maintenance import Keeper
from storage.jobs.queue import JobQueue
from storage.jobs.supervision import Supervisor, untraced
from tests.support.desk import COMPUTE, Desk

NAME = "sleeper-0"


class Sleep:
    number: int | None = None

    def __call__(self) -> int | None:
        return self.number


@pytest.fixture
def sleep() -> Sleep:
    return Sleep()


@pytest.fixture
def keeper(fresh_database: Database, sleep: Sleep) -> Iterator[Keeper]:
    queue = JobQueue(fresh_database)
    supervisor = Supervisor(fresh_database, queue, Zygote(COMPUTE), worker=NAME, slots=1, traced=untraced)
    yield Keeper(fresh_database, queue, supervisor, worker=NAME, interval=1.0, asleep=sleep, ended=threading.Event())
    queue.close()


@pytest.fixture
def asked(fresh_database: Database) -> list[str]:
    """The questions for claims."""
    statements: list[str] = []

    def note(_connection: object, _cursor: object, statement: str, *_: object) -> None:
        if "executor_id" in statement and statement.startswith("SELECT"):
            statements.append(statement)

    event.listen(fresh_database.engine, "before_cursor_execute", note)
    return statements


def test_who_sleeps_asks_once_in_each_sleep(keeper: Keeper, sleep: Sleep, asked: list[str]) -> None:
    for number in (1, 2, 3):
        sleep.number = number
        for _ in range(4):
            keeper._begin_again()
        assert len(asked) == number


def test_who_is_awake_asks_each_time(keeper: Keeper, asked: list[str]) -> None:
    for _ in range(4):
        keeper._begin_again()
    assert len(asked) == 4


def test_who_has_claims_asks_until_they_are_gone(
    keeper: Keeper, sleep: Sleep, asked: list[str], fresh_database: Database
) -> None:
    desk = Desk(fresh_database)
    ticket = desk.get(desk.ask("square", values=[1])).ticket
    dbos = "" if fresh_database.engine.dialect.name == "sqlite" else "dbos."
    claim = text(f"UPDATE {dbos}workflow_status SET status = :status, executor_id = :name WHERE workflow_uuid = :id")
    sleep.number = 1
    for status, expected in (("PENDING", 4), ("SUCCESS", 5)):  # the last one finds none, and is the last of this sleep
        with fresh_database.engine.begin() as connection:
            connection.execute(claim, {"status": status, "name": NAME, "id": ticket})
        for _ in range(4):
            keeper._begin_again()
        assert len(asked) == expected
    desk.queue.close()
