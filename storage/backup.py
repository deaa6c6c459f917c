"""Backups: one SQLite file with every row of a database, whatever kind that is, and what must be in it.

The table ``servotune_backup`` says which version made the file, when, from which revision of the migrations, and the digest
of each table as SQLite holds it; a file that was cut, changed or damaged is told from one that was not.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from sqlalchemy import URL, select
from sqlalchemy.exc import DatabaseError

from storage import migrations
from storage.checking import Findings, check
from storage.copying import Content, Tell, copy, require_empty, snapshot, tables
from storage.errors import CopyError, FullDiskError, full_disk, is_damage, is_full, is_read_only
from storage.models import Base
from storage.models.base import utc_now
from storage.objects import ObjectStore
from storage.session import Database, open_database

FORMAT = 1
_TABLE = "servotune_backup"


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """What a backup says of itself; ``digests`` are those of the tables as SQLite holds them."""

    format: int
    version: str
    revision: str
    created_at: datetime
    digests: Mapping[str, str]


def make(
    database: Database, path: Path, *, version: str, tell: Tell = lambda _table, _rows: None
) -> dict[str, Content]:
    """Write a backup of a database, which may be in use; the file appears when it is whole.

    Raises
    ------
    CopyError
        When the file exists, its disk is full, or the database is not as this version needs it.
    OSError
        When the file cannot be written.
    """
    if path.exists():
        raise CopyError(f"the backup must be a new file, {path} exists")
    if not path.parent.is_dir():
        raise CopyError(f"the backup must be in a directory that exists, got {path.parent}")
    _require_current(database)
    partial = path.with_name(f".{path.name}.partial")
    partial.unlink(missing_ok=True)
    try:
        with _room(partial, f"the disk of {path} must have room for the backup, it is full"):
            os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))  # it holds secrets
            with _opened(partial) as target:
                Base.metadata.create_all(target.engine)
                migrations.stamp(target.engine)
                with snapshot(database.engine) as source, target.engine.begin() as connection:
                    copied = copy(source, connection, tell=tell)
            _seal(partial, version=version)
            partial.rename(path)
    finally:
        for left in path.parent.glob(f"{partial.name}*"):
            left.unlink()
    return copied


def read_manifest(path: Path) -> Manifest:
    """Return what a backup says of itself.

    Raises
    ------
    CopyError
        When the file is no backup, or one of a later version.
    """
    if not path.is_file():
        raise CopyError(f"the backup must be a file, got {path}")
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            rows: dict[str, Any] = {
                key: json.loads(value)
                for key, value in connection.execute(f"SELECT key, value FROM {_TABLE}")  # noqa: S608 - a constant
            }
        manifest = Manifest(**rows | {"created_at": datetime.fromisoformat(rows["created_at"])})
    except (sqlite3.Error, ValueError, TypeError, KeyError) as error:
        raise CopyError(f"the backup must be one that `servotune backup` wrote, {path} is not ({error})") from error
    if manifest.format != FORMAT:
        raise CopyError(f"format of the backup must be {FORMAT}, got {manifest.format}")
    return manifest


def verify(path: Path, *, objects: ObjectStore | None = None) -> tuple[Manifest, Findings]:
    """Return what a backup says of itself, and whether it holds just that, with what it names in the object store; no file is changed.

    Raises
    ------
    CopyError
        When the file is no backup.
    """
    manifest = read_manifest(path)
    faults = _altered(path, manifest)
    if faults:
        return manifest, Findings(blobs=0, bytes=0, faults=faults)
    with _current_copy(path, manifest) as database:
        return manifest, check(database.engine, objects=objects)


def restore(path: Path, target: Database, *, tell: Tell = lambda _table, _rows: None) -> dict[str, Content]:
    """Fill an empty database with a backup of this or an earlier version, or leave it as it is; its tables are made once the backup is known to be whole.

    Raises
    ------
    CopyError
        When the backup is damaged or later than this version, or the database is not empty.
    DatabaseUrlError
        When there is a pooler in front of the database.
    """
    manifest = read_manifest(path)
    target.require_direct()
    if target.is_current():  # said before a long backup is read
        with target.engine.connect() as connection:
            require_empty(connection)
    _require_whole(_altered(path, manifest))
    with _current_copy(path, manifest) as database:
        _require_whole(check(database.engine, objects=target.objects).faults)
        target.migrate()
        with snapshot(database.engine) as source, target.engine.begin() as connection:
            return copy(source, connection, tell=tell)


def _require_whole(faults: Sequence[str]) -> None:
    if faults:
        more = f" (and {len(faults) - 3} more)" if len(faults) > 3 else ""
        raise CopyError(f"the backup must be whole, got one that is not: {'; '.join(faults[:3])}{more}")


def _altered(path: Path, manifest: Manifest) -> tuple[str, ...]:
    """Return what is not in a backup as it was written."""
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
            found = _digests(connection)
    except (sqlite3.Error, UnicodeDecodeError) as error:
        return (f"SQLite cannot read {path}: {error}",)
    return tuple(
        f"table {table} must hold what was written into it, it holds something else"
        for table in sorted({*manifest.digests, *found})
        if manifest.digests.get(table) != found.get(table)
    )


def _require_current(database: Database) -> None:
    if not database.is_current():
        raise CopyError("the database must be as this version needs it: start `servotune serve` once to migrate it")


def _seal(path: Path, *, version: str) -> None:
    """Write into a backup what must be in it, and everything to the disk."""
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE").close()
        (revision,) = connection.execute("SELECT version_num FROM alembic_version").fetchone()
        facts = {
            "format": FORMAT,
            "version": version,
            "revision": revision,
            "created_at": utc_now().isoformat(),
            "digests": _digests(connection),
        }
        with connection:
            connection.execute(f"CREATE TABLE {_TABLE} (key TEXT PRIMARY KEY, value TEXT NOT NULL)")
            rows = [(key, json.dumps(value)) for key, value in facts.items()]
            connection.executemany(f"INSERT INTO {_TABLE} VALUES (?, ?)", rows)  # noqa: S608 - a constant
    with path.open("rb") as file:
        os.fsync(file.fileno())


def _digests(connection: sqlite3.Connection) -> dict[str, str]:
    """Return the digest of every table as SQLite holds it."""
    tables = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name").fetchall()
    return {name: _digest(connection, name) for (name,) in tables if name != _TABLE}


def _digest(connection: sqlite3.Connection, table: str) -> str:
    total = 0
    for row in connection.execute(f'SELECT * FROM "{table}"'):  # noqa: S608 - a name that SQLite itself told
        values = [hashlib.sha256(value).hexdigest() if isinstance(value, bytes) else value for value in row]
        total += int.from_bytes(hashlib.sha256(repr(values).encode(errors="surrogatepass")).digest())
    return f"{total % (1 << 256):064x}"


@contextmanager
def _current_copy(path: Path, manifest: Manifest) -> Iterator[Database]:
    """Give a copy of a backup that is migrated to this version."""
    if not migrations.knows(manifest.revision):
        raise CopyError(
            f"the backup must be of this or an earlier version, it was made by {manifest.version} "
            f"(revision {manifest.revision} of the migrations)"
        )
    place = path.parent if os.access(path.parent, os.W_OK) else Path(tempfile.gettempdir())
    with tempfile.TemporaryDirectory(prefix="servotune-", dir=place) as folder:
        own = Path(folder) / "backup.db"
        no_room = f"{place} must have room for a copy of the backup, its disk is full"
        with _room(own, no_room), _copied(path, own) as database:
            try:
                migrations.upgrade_tables(database.engine)
                with database.engine.connect() as connection:
                    for table in tables():  # the names of columns are in no digest
                        connection.execute(select(table).limit(0))
            except (DatabaseError, UnicodeDecodeError) as error:
                if is_damage(error) or is_read_only(error):  # a file that says so itself: the copy is our own
                    _require_whole([f"SQLite cannot read {path}: {getattr(error, 'orig', error)}"])
                raise
            yield database


@contextmanager
def _room(file: Path, no_room: str) -> Iterator[None]:
    """Say in words that the user knows that a file of ours finds no room; of another database it says itself."""
    try:
        yield
    except (OSError, sqlite3.Error, FullDiskError) as error:
        ours = not isinstance(error, FullDiskError) or error.place == str(file)
        if ours and (is_full(error) or full_disk(error) is not None):
            raise CopyError(no_room) from error
        raise


@contextmanager
def _copied(path: Path, own: Path) -> Iterator[Database]:
    shutil.copyfile(path, own)
    with _opened(own) as database:
        yield database


@contextmanager
def _opened(path: Path) -> Iterator[Database]:
    database = open_database(URL.create("sqlite", database=str(path)).render_as_string())
    try:
        yield database
    finally:
        database.dispose()
