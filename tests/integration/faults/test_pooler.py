"""Jobs behind PgBouncer that lends connections for one transaction at a time, also when it is killed and started anew."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import select, text, update

from storage import Database, open_database
from storage.errors import DatabaseUrlError
from storage.jobs.bell import Bell
from storage.models import DEFAULT_WORKSPACE, Workspace
from tests.integration.faults.load import start_worker
from tests.support.desk import Desk, wait_for
from tests.support.postgres import create_database

PGBOUNCER = shutil.which("pgbouncer", path=os.environ.get("PATH", "") + ":/usr/sbin")
pytestmark = pytest.mark.skipif(PGBOUNCER is None, reason="pgbouncer is not installed: apt-get install pgbouncer")

#: Fewer connections than those who ask: what one leaves behind meets the next one.
SERVER_CONNECTIONS = 3
SETTINGS = """
[databases]
* = host={server} user=postgres
[pgbouncer]
pool_mode = transaction
default_pool_size = {connections}
listen_addr =
unix_socket_dir = {home}
listen_port = 6432
auth_type = any
max_client_conn = 200
"""


class Pooler:
    """A PgBouncer on a Unix socket."""

    def __init__(self, server: str) -> None:
        self.home = Path(tempfile.mkdtemp(prefix="pgb-", dir="/tmp"))  # a socket's path may have 107 characters only
        settings = SETTINGS.format(server=server, home=self.home, connections=SERVER_CONNECTIONS)
        (self.home / "pgbouncer.ini").write_text(settings)
        # It refuses to run as root, and must be able to open the server's folder.
        self._user = Path(server).owner() if os.geteuid() == 0 else None
        if self._user is not None:
            for each in (self.home, self.home / "pgbouncer.ini"):  # what the umask keeps from others too
                shutil.chown(each, self._user)
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with (self.home / "log").open("ab") as log:
            self._process = subprocess.Popen(
                [str(PGBOUNCER), self.home / "pgbouncer.ini"], stdout=log, stderr=log, user=self._user, cwd=self.home
            )
        wait_for(self._answers, "the pooler")

    def kill(self) -> None:
        assert self._process is not None
        self._process.kill()
        self._process.wait()
        (self.home / ".s.PGSQL.6432").unlink(missing_ok=True)

    def _answers(self) -> bool:
        assert self._process is not None
        assert self._process.poll() is None, (self.home / "log").read_text()
        try:
            psycopg.connect(host=str(self.home), port=6432, user="postgres", dbname="postgres").close()
        except psycopg.OperationalError:
            return False
        return True


@pytest.fixture
def direct_url(postgres_url: str, postgres_template: str, tmp_path: Path) -> str:
    return create_database(postgres_url, f"pooled_{tmp_path.name[-20:]}", template=postgres_template)


@pytest.fixture
def pooler(postgres_url: str) -> Iterator[Pooler]:
    running = Pooler(postgres_url.partition("?host=")[2])
    try:
        running.start()
        yield running
    finally:
        running.kill()
        shutil.rmtree(running.home)


@pytest.fixture
def pooled_url(direct_url: str, pooler: Pooler) -> str:
    return f"{direct_url.partition('?')[0]}?host={pooler.home}&port=6432&pooler=transaction"


@pytest.fixture
def pooled(pooled_url: str) -> Iterator[Database]:
    opened = open_database(pooled_url)
    yield opened
    opened.dispose()


def test_a_job_goes_on_when_the_pooler_is_started_anew(
    pooled: Database, pooled_url: str, pooler: Pooler, tmp_path: Path
) -> None:
    desk, log = Desk(pooled), tmp_path / "steps"
    worker = start_worker(pooled_url, log=tmp_path / "worker.txt")
    try:
        assert desk.wait(desk.ask("square", values=[1, 2])).status == "succeeded"
        log.with_suffix(".hold").touch()
        job = desk.ask("climb", steps=3, log=str(log))
        wait_for(log.exists, "the first step")
        pooler.kill()
        log.with_suffix(".hold").unlink()  # it goes on, and has nobody to tell
        wait_for(lambda: len(log.read_text().split()) == 3, "the last step")
        pooler.start()
        ended = desk.wait(job)
        assert (ended.status, ended.attempts) == ("succeeded", 1)
        assert log.read_text().split() == ["0", "1", "2"]
        assert desk.wait(desk.ask("square", values=[3])).status == "succeeded"
    except AssertionError as error:
        error.add_note((tmp_path / "worker.txt").read_text())
        raise
    finally:
        worker.kill()
        worker.wait()
        desk.queue.close()


def test_nobody_meets_what_another_one_left_behind(pooled: Database) -> None:
    """More of them than the server has connections; each statement often enough to be prepared, were it not for the pooler."""
    wrong: list[object] = []

    def use() -> None:
        try:
            for _ in range(20):
                with pooled.session() as session:
                    session.scalars(select(Workspace.name)).all()
                    told = [session.scalar(select(text("current_setting('idle_in_transaction_session_timeout')")))]
                    session.execute(update(Workspace).where(Workspace.id == DEFAULT_WORKSPACE).values(name="default"))
                    told.append(session.scalar(select(text("current_setting('idle_in_transaction_session_timeout')"))))
                if told != ["0", "10s"]:
                    wrong.append(told)
        except Exception as error:  # noqa: BLE001 - told by the test
            wrong.append(error)

    threads = [threading.Thread(target=use) for _ in range(2 * SERVER_CONNECTIONS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_what_needs_a_session_goes_past_the_pooler(pooled: Database, direct_url: str) -> None:
    with pytest.raises(DatabaseUrlError, match="SERVOTUNE_DIRECT_DATABASE_URL must name the server itself"):
        pooled.migrate()
    ended = threading.Event()
    deaf = Bell(pooled, ended=ended)
    deaf.listen()  # returns: there is nothing to hear
    deaf.wait()  # as does this: who cannot be woken must ask
    direct = open_database(direct_url, connections=1)
    bell = Bell(direct, ended=ended)
    listening = threading.Thread(target=bell.listen)
    listening.start()
    wait_for(lambda: bell._listening, "somebody who listens")
    ended.set()
    listening.join()
    direct.dispose()


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("postgresql://a@b/c?pooler=session", "pooler of the database URL must be transaction, got 'session'"),
        (
            "postgresql://a@b/c?pooler=transaction&pooler=session",
            "must be transaction, got \\('transaction', 'session'\\)",
        ),
        ("sqlite:///a.db?pooler=transaction", "must stand in front of Postgres, got an SQLite database"),
    ],
)
def test_other_poolers_are_refused(url: str, told: str) -> None:
    with pytest.raises(DatabaseUrlError, match=told):
        open_database(url)
