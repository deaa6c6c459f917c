"""A worker that starts while its database is away waits for it, and says so."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from storage import Database, open_database
from storage.errors import UNAVAILABLE
from storage.jobs import worker as workers
from storage.jobs.worker import Worker
from storage.repositories import WorkerRepository
from tests.support.desk import COMPUTE, wait_for
from tests.support.postgres import Server, create_database


def at_work(database: Database) -> bool:
    with database.session() as session:
        return len(WorkerRepository(session).alive()) == 1


def started(url: str, log: Path) -> subprocess.Popen[bytes]:
    with log.open("wb") as written:
        return subprocess.Popen(
            [sys.executable, "-m", "servotune", "worker"],
            env=os.environ | {"SERVOTUNE_DATABASE_URL": url},
            stderr=written,
        )


def test_it_waits_works_when_the_database_is_there_and_stops_when_told_to(tmp_path: Path) -> None:
    server = Server()
    server.start()
    log = tmp_path / "log.txt"
    try:
        url = create_database(server.url, "late")
        database = open_database(url)
        database.migrate()
        server.stop()
        worker = started(url, log)
        try:
            wait_for(lambda: log.read_text().count("the worker waits for the database") >= 2, "two lines", timeout=120)
            assert worker.poll() is None
            assert "Traceback" not in log.read_text()
            server.start()
            wait_for(lambda: at_work(database), "the worker", timeout=120)
            worker.send_signal(signal.SIGTERM)
            assert worker.wait(timeout=120) == 0, log.read_text()
        finally:
            worker.kill()
            worker.wait()
        database.dispose()
    finally:
        server.stop()
        server.remove()


def test_it_does_not_wait_for_ever(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(workers, "_LONGEST_WAIT", 0.0)
    worker = Worker(f"postgresql+psycopg://nobody@/none?host={tmp_path}", compute=COMPUTE)
    with pytest.raises(UNAVAILABLE):
        worker.run(threading.Event())


def test_a_database_that_is_not_migrated_is_refused_in_a_sentence(tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    worker = started(f"sqlite:///{tmp_path}/empty.db", log)
    assert worker.wait(timeout=120) == 1
    assert log.read_text().splitlines()[-1] == "the database must be migrated before a worker starts"
    assert "Traceback" not in log.read_text()
