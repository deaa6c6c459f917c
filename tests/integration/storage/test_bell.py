"""A worker that waits for a job is woken by whoever hands one out, on Postgres; elsewhere it asks as before."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from sqlalchemy import text

from storage import Database
from storage.jobs import bell as module
from storage.jobs.bell import Bell, ring
from tests.support.desk import Desk, wait_for
from tests.support.patience import PATIENCE


@contextmanager
def listening(database: Database) -> Iterator[Bell]:
    ended = threading.Event()
    bell = Bell(database, ended=ended)
    thread = threading.Thread(target=bell.listen)
    thread.start()
    try:
        yield bell
    finally:
        ended.set()
        bell.wake()
        thread.join()


@contextmanager
def asleep(bell: Bell) -> Iterator[threading.Thread]:
    """Let a thread wait for the bell."""
    thread = threading.Thread(target=bell.wait)
    thread.start()
    yield thread
    bell.wake()
    thread.join()


@pytest.fixture
def sleepy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody asks unasked, or often."""
    monkeypatch.setattr(module, "_UNASKED", 600.0)
    monkeypatch.setattr(module, "_LIVELY", 0.0)


@pytest.fixture
def postgres_database(fresh_database: Database) -> Database:
    if fresh_database.engine.dialect.name != "postgresql":
        pytest.skip("SQLite has no LISTEN: workers ask ten times a second")
    return fresh_database


def rest(bell: Bell) -> None:
    """Wait until it listens, and forget that this woke it."""
    wait_for(lambda: bell._listening, "listening")
    wait_for(bell._rung.is_set, "the first ring")
    bell.wait()


def test_a_job_wakes_who_waits_when_it_is_committed(postgres_database: Database, sleepy: None) -> None:
    desk = Desk(postgres_database)
    with listening(postgres_database) as bell:
        rest(bell)
        with asleep(bell) as waiting:
            with postgres_database.sessions() as session:
                ring(session)
                session.rollback()
            assert waiting.is_alive()
            desk.ask("square", values=[1])
            waiting.join(PATIENCE)
            assert not waiting.is_alive()
    desk.queue.close()


def test_who_is_cut_off_asks_at_once_and_listens_again(postgres_database: Database, sleepy: None) -> None:
    with listening(postgres_database) as bell:
        rest(bell)
        with asleep(bell) as waiting:
            with postgres_database.engine.begin() as connection:
                connection.execute(
                    text(
                        "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE query LIKE 'LISTEN servotune_work%'"
                    )
                )
            waiting.join(PATIENCE)
            assert not waiting.is_alive()
        rest(bell)
        with asleep(bell) as again:
            with postgres_database.session() as session:
                ring(session)
            again.join(PATIENCE)
            assert not again.is_alive()


def test_where_nobody_can_listen_nobody_waits(tmp_path, sleepy: None) -> None:
    from storage import open_database

    database = open_database(f"sqlite:///{tmp_path}/bell.db")
    with listening(database) as bell:
        begun = time.monotonic()
        bell.wait()
        assert time.monotonic() - begun < 60  # it would be 600
    database.dispose()


def test_who_was_woken_asks_often_for_a_while(postgres_database: Database, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_UNASKED", 600.0)
    monkeypatch.setattr(module, "_LIVELY", 300.0)
    with listening(postgres_database) as bell:
        rest(bell)
        for _ in range(3):
            bell.wait()
