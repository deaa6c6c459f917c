"""A full disk is told by the name of the file that found no room on it, be it of what is read or of what is written."""

from __future__ import annotations

import errno
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import event
from sqlalchemy.pool import Pool

from api.commands import maintenance, service
from servotune.targets import room_at
from storage import open_database
from storage.errors import UNAVAILABLE, FullDiskError, why_unavailable
from tests.integration.api.test_maintenance import fill


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def source(sqlite_template: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Path("source.db").write_bytes(sqlite_template.read_bytes())
    database = open_database("sqlite:///source.db")
    fill(database)
    database.dispose()
    monkeypatch.setenv("SERVOTUNE_DATABASE_URL", "sqlite:///source.db")


@pytest.fixture
def narrow() -> Iterator[Callable[[str], None]]:
    """Leave a file that is opened from now on no room for more pages than it has, and for 20 of a new one."""
    listening = []

    def leave(file: str) -> None:
        def limit(connection: Any, _record: object) -> None:
            (_, _, path) = connection.execute("PRAGMA database_list").fetchone()
            if Path(path).name == file:
                connection.execute("PRAGMA max_page_count = 20")

        event.listen(Pool, "connect", limit)
        listening.append(limit)

    yield leave
    for limit in listening:
        event.remove(Pool, "connect", limit)


def said(order: Callable[[list[str]], int], *arguments: str) -> str:
    with pytest.raises(SystemExit) as caught:
        order(list(arguments))
    return str(caught.value.code)


def test_a_backup_names_the_disk_that_it_is_written_to(source, here: Path, narrow) -> None:
    narrow(".made.partial")
    assert said(maintenance.backup, "made") == "the disk of made must have room for the backup, it is full"
    assert list(here.glob("*made*")) == []


def test_a_move_and_a_restore_name_the_disk_of_the_database_that_is_filled(
    source, here: Path, narrow, monkeypatch
) -> None:
    assert maintenance.backup(["made"]) == 0
    narrow("other.db")
    says = "the disk of other.db must have room for what is written, it is full"
    assert said(maintenance.move, "sqlite:///other.db") == says
    monkeypatch.setenv("SERVOTUNE_DATABASE_URL", "sqlite:///other.db")
    assert said(maintenance.restore, "made") == says
    assert said(maintenance.migrate) == says
    assert list(here.glob("other.db*")) == []
    assert said(service.serve) == says


def test_a_move_names_the_disk_of_the_database_that_is_read(source, narrow, monkeypatch) -> None:
    """Reading may have to write, too: what a process that died has left in the write-ahead log."""

    def full(_engine: object) -> None:
        error = FullDiskError("SELECT 1", None, sqlite3.OperationalError("database or disk is full"))
        error.place = "source.db"
        raise error

    monkeypatch.setattr("storage.copying.snapshot", full)
    assert said(maintenance.move, "sqlite:///other.db").startswith("the disk of source.db must have room")


def test_a_check_names_the_directory_in_which_it_has_no_room(source, here: Path, monkeypatch) -> None:
    assert maintenance.backup(["made"]) == 0

    def full(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(source), None, str(target))

    monkeypatch.setattr(shutil, "copyfile", full)
    says = f"{here} must have room for a copy of the backup, its disk is full"
    assert said(maintenance.check, str(here / "made")) == says


def test_no_room_for_the_index_of_the_log_is_a_full_disk(here: Path, monkeypatch) -> None:
    """SQLite says that it cannot read or write then; on a disk with room it is that."""
    database = open_database("sqlite:///small.db")

    def fail(*_: object) -> None:
        error = sqlite3.OperationalError("disk I/O error")
        error.sqlite_errorcode = sqlite3.SQLITE_IOERR_SHMSIZE
        raise error

    event.listen(database.engine, "do_execute", fail)
    with pytest.raises(UNAVAILABLE) as caught:
        database.ping()
    assert not isinstance(caught.value, FullDiskError)
    monkeypatch.setattr("storage.session._free", lambda _: 4096)
    with pytest.raises(FullDiskError) as full:
        database.ping()
    database.dispose()
    assert full.value.place == "small.db"
    assert why_unavailable(full.value) == "the database takes no changes: its disk is full"


def test_what_the_client_writes_is_named(here: Path) -> None:
    rule = f"the disk of {here / 'a.csv'} must have room for what is written, it is full"
    with pytest.raises(OSError, match=rule), room_at(here / "a.csv"):
        raise OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(PermissionError), room_at(here / "a.csv"):
        raise PermissionError
