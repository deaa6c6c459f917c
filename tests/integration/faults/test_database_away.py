"""The database goes away, fills up or only reads: a clear 503, nothing lost, and everything goes on afterwards."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from sqlalchemy import event, text

from storage import Database, open_database
from storage.repositories import WorkerRepository
from tests.integration.api.conftest import serving
from tests.integration.api.documents import LAG
from tests.integration.faults.load import Load, summed, workers
from tests.support.desk import Desk, wait_for
from tests.support.postgres import Server, create_database

SYSTEMS = "/v1/systems"


def reads_and_writes(client: httpx.Client, number: int) -> httpx.Response:
    if number % 3:
        return client.get(SYSTEMS, params={"limit": 5})
    return client.post(SYSTEMS, json=LAG | {"name": f"system {number}"})


def _at_work(database: Database) -> int:
    with database.session() as session:
        return len(WorkerRepository(session).all())


def test_postgres_restarts_under_load(tmp_path: Path, seconds: float, rounds: int) -> None:
    server = Server(synchronous_commit="on")  # what is answered must be there after a crash of the server
    server.start()
    try:
        url = create_database(server.url, "loaded")
        database = open_database(url)
        database.migrate()
        desk = Desk(database)
        log = tmp_path / "workers.txt"
        with workers(url, 2, log=log), serving(url, requests_per_minute=0) as service:
            jobs: list[str] = []
            # one that starts while the database is away ends, and is started again by whoever runs services
            wait_for(lambda: _at_work(database) == 2, "two workers at work")
            with Load(service.client, reads_and_writes, threads=6) as load:
                load.wait(30)
                for _ in range(rounds):
                    jobs += [desk.ask("square", values=[1, 2], pause=0.02) for _ in range(20)]
                    server.stop()
                    time.sleep(0.3)
                    with service.client() as client:
                        assert client.get("/healthz").status_code == 200
                        away = client.get("/readyz")
                        assert (away.status_code, away.json()["checks"]["database"]) == (503, "unavailable")
                        refused = client.get(SYSTEMS)
                        assert (refused.status_code, refused.headers["Retry-After"]) == (503, "5")
                        assert "the database does not answer" in refused.json()["detail"]
                    server.start()
                    load.wait(30)
                time.sleep(seconds / 3)
            assert summed(load.statuses, 200, 201, 503) == {}, load.texts[:3]
            assert load.statuses[201] > 0
            with service.client() as client:
                assert client.get("/readyz").status_code == 200
                kept = 0
                cursor = None
                while True:
                    page = client.get(SYSTEMS, params={"limit": 1000, **({"cursor": cursor} if cursor else {})}).json()
                    kept += len(page["items"])
                    if (cursor := page["next_cursor"]) is None:
                        break
            assert kept >= load.statuses[201]  # one whose answer was cut off may be there, too
            try:
                for job in jobs:
                    assert desk.wait(job).status == "succeeded"
            except AssertionError as error:
                error.add_note(log.read_text())
                raise
        desk.queue.close()
        database.dispose()
    finally:
        server.stop()
        server.remove()


@pytest.mark.parametrize("fault", ["full", "read-only"])
def test_a_database_that_takes_no_changes_says_so_and_recovers(
    sqlite_template: Path, tmp_path: Path, fault: str
) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}") as service, service.client() as client:
        system = client.post(SYSTEMS, json=LAG).json()["id"]
        engine = service.app.state.installation.database.engine
        wrong = {"full": "PRAGMA max_page_count = 1", "read-only": "PRAGMA query_only = ON"}[fault]
        right = {"full": "PRAGMA max_page_count = 1000000", "read-only": "PRAGMA query_only = OFF"}[fault]

        def break_it(connection, *_: object) -> None:
            connection.execute(wrong)

        def mend_it(connection, *_: object) -> None:
            connection.execute(right)

        event.listen(engine, "checkout", break_it)
        big = LAG | {"name": "y" * 200}
        replies = [client.post(SYSTEMS, json=big) for _ in range(40)]
        refused = [reply for reply in replies if reply.status_code != 201]
        assert {reply.status_code for reply in refused} == {503}, [reply.text for reply in refused[:2]]
        says = {"full": "its disk is full", "read-only": "it is read-only"}[fault]
        assert says in refused[-1].json()["detail"]
        assert refused[-1].headers["Retry-After"] == "5"
        assert client.get(f"{SYSTEMS}/{system}").status_code == 200
        event.remove(engine, "checkout", break_it)
        event.listen(engine, "checkout", mend_it)
        before = client.get(SYSTEMS, params={"limit": 1000}).json()["items"]
        assert len(before) == 1 + len(replies) - len(refused)  # what was refused left nothing
        assert client.post(SYSTEMS, json=big).status_code == 201


#: A process that stands still in the middle of a write.
FROZEN = """
import os, signal, sqlite3, sys
own = sqlite3.connect(sys.argv[1], isolation_level=None)
own.execute("BEGIN IMMEDIATE")
print("holds the lock", flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
"""


def test_changes_of_a_file_whose_writer_stands_still_are_refused_in_time_and_go_on_when_it_is_killed(
    sqlite_template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    monkeypatch.setattr("storage.session.LOCK_TIMEOUT", 0.5)
    with serving(f"sqlite:///{path}") as service, service.client() as client:
        frozen = subprocess.Popen([sys.executable, "-c", FROZEN, str(path)], stdout=subprocess.PIPE)
        try:
            assert frozen.stdout is not None
            assert frozen.stdout.readline() == b"holds the lock\n"
            began = time.monotonic()
            for headers in ({}, {"Idempotency-Key": "while it stands still"}):
                refused = client.post(SYSTEMS, json=LAG, headers=headers)
                assert (refused.status_code, refused.headers["Retry-After"]) == (503, "5")
                assert "another process has held its lock for too long" in refused.json()["detail"]
            assert time.monotonic() - began < 20.0  # two waits of half a second, on a busy machine
            assert client.get(SYSTEMS).json()["items"] == []
            assert client.get("/readyz").status_code == 200
        finally:
            frozen.kill()
            frozen.communicate()
        again = client.post(SYSTEMS, json=LAG, headers={"Idempotency-Key": "while it stands still"})
        assert again.status_code == 201
        assert len(client.get(SYSTEMS).json()["items"]) == 1


def test_a_postgres_that_only_reads_says_so_and_recovers(postgres_url, postgres_template) -> None:
    url = create_database(postgres_url, "only_reads", template=postgres_template)
    operator = open_database(url)
    with ExitStack() as undo:
        undo.callback(operator.dispose)
        client = undo.enter_context(undo.enter_context(serving(url)).client())

        def ask() -> httpx.Response:
            # A connection that ends while a request is on it is another reason for the same 503: the next request has a new one.
            for _ in range(20):
                reply = client.post(SYSTEMS, json=LAG)
                if reply.status_code != 503 or "does not answer" not in reply.json()["detail"]:
                    break
                time.sleep(0.1)
            return reply

        assert ask().status_code == 201
        _let_it_write(operator, allowed=False)
        refused = ask()
        assert refused.status_code == 503, refused.text
        assert "it is read-only" in refused.json()["detail"]
        assert client.get(SYSTEMS).status_code == 200
        _let_it_write(operator, allowed=True)
        assert ask().status_code == 201


def _let_it_write(operator, *, allowed: bool) -> None:
    """Change what new connections may do, and end all others."""
    with operator.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text("SET default_transaction_read_only = off"))
        connection.execute(
            text(f"ALTER DATABASE only_reads SET default_transaction_read_only = {'off' if allowed else 'on'}")
        )
        connection.execute(
            text(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = 'only_reads' AND pid <> pg_backend_pid()"
            )
        )
