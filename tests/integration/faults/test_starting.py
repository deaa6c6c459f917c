"""A worker that starts while its database is away waits for it, and says so."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from storage import Database, open_database
from storage.errors import UNAVAILABLE, StateError
from storage.jobs import worker as workers
from storage.jobs.worker import Worker
from storage.repositories import WorkerRepository
from tests.support.desk import COMPUTE, wait_for
from tests.support.postgres import Server, create_database


def _nowhere(tmp_path: Path) -> str:
    return f"postgresql+psycopg://nobody@/none?host={tmp_path}"


def at_work(database: Database) -> bool:
    with database.session() as session:
        return len(WorkerRepository(session).alive()) == 1


def test_it_waits_works_when_the_database_is_there_and_stops_when_told_to(caplog: pytest.LogCaptureFixture) -> None:
    server = Server(synchronous_commit="on")  # it is stopped at once, and must know its tables again
    server.start()
    stop = threading.Event()
    try:
        url = create_database(server.url, "late")
        database = open_database(url)
        database.migrate()
        server.stop()
        worker = threading.Thread(target=Worker(url, compute=COMPUTE).run, args=[stop])
        worker.start()
        wait_for(lambda: caplog.text.count("the worker waits for the database") >= 2, "two lines")
        assert worker.is_alive()
        server.start()
        wait_for(lambda: at_work(database), "the worker")
        stop.set()
        worker.join()
        database.dispose()
    finally:
        stop.set()
        server.stop()
        server.remove()


def test_it_stops_when_told_to_while_it_waits(tmp_path: Path) -> None:
    stop = threading.Event()
    worker = threading.Thread(target=Worker(_nowhere(tmp_path), compute=COMPUTE).run, args=[stop])
    worker.start()
    stop.set()
    worker.join(timeout=90)
    assert not worker.is_alive()


def test_it_does_not_wait_for_ever(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(workers, "_LONGEST_WAIT", 0.0)
    worker = Worker(_nowhere(tmp_path), compute=COMPUTE)
    with pytest.raises(UNAVAILABLE):
        worker.run(threading.Event())


def test_a_start_in_a_database_that_is_not_migrated_is_refused_at_once(tmp_path: Path) -> None:
    worker = Worker(f"sqlite:///{tmp_path}/empty.db", compute=COMPUTE)
    with pytest.raises(StateError, match="the database must be migrated before a worker starts"):
        worker.start()


def test_it_waits_for_the_migration_and_works_then(empty_database_url: str, caplog: pytest.LogCaptureFixture) -> None:
    """As in a cluster, where nobody says which container is first."""
    database = open_database(empty_database_url)
    stop = threading.Event()
    worker = threading.Thread(target=Worker(empty_database_url, compute=COMPUTE).run, args=[stop])
    worker.start()
    try:
        wait_for(lambda: caplog.text.count("the worker waits for the database to be migrated") >= 2, "two lines")
        assert worker.is_alive()
        database.migrate()
        wait_for(lambda: at_work(database), "the worker")
    finally:
        stop.set()
        worker.join()
        database.dispose()


def test_it_does_not_wait_for_the_migration_for_ever(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(workers, "_LONGEST_WAIT", 0.0)
    worker = Worker(f"sqlite:///{tmp_path}/empty.db", compute=COMPUTE)
    with pytest.raises(StateError, match="the database must be migrated before a worker starts"):
        worker.run(threading.Event())
