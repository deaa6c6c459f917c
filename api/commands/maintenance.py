"""`servotune backup`, `restore`, `check`, `migrate`, `move`, `move-blobs`: what whoever runs an installation does with its database."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from api.commands.service import read_settings
from api.runtime.arguments import parser_of

if TYPE_CHECKING:
    from storage.checking import Findings
    from storage.objects import ObjectStore
    from storage.session import Database

#: s; a worker that was seen later may write at any moment.
_STOPPED_FOR = 30.0


def backup(argv: Sequence[str]) -> int:
    """Write everything in the database into one file; the service may run.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    parser = parser_of("backup", "Write everything in the database into one file, verified; the service may run.")
    parser.add_argument("file", type=Path, help="a new file")
    given = parser.parse_args(argv)

    from importlib.metadata import version

    from storage import backup as backups
    from storage.copying import total

    settings = read_settings()
    with _speaking(), _database(settings.database_url, there=True) as database:
        copied = backups.make(database, given.file, version=version("servotune"), tell=_progress)
        _manifest, findings = backups.verify(given.file, objects=settings.objects)
        if findings.faults:
            return _tell_faults(findings, what=str(given.file))
        size = given.file.stat().st_size
        _say(f"{given.file}: {total(copied)} rows, {findings.blobs} blobs, {size} bytes, read back and verified")
        return 0


def restore(argv: Sequence[str]) -> int:
    """Fill an empty database with a backup; the service must not run.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    parser = parser_of(
        "restore", "Fill the empty database of SERVOTUNE_DATABASE_URL with a backup, SQLite or Postgres."
    )
    parser.add_argument("file", type=Path, help="what `servotune backup` wrote")
    given = parser.parse_args(argv)

    from storage import backup as backups
    from storage.copying import total

    with _speaking():
        manifest = backups.read_manifest(given.file)
        settings = read_settings()
        with _database(settings.database_url, objects=settings.objects) as database:
            copied = backups.restore(given.file, database, tell=_progress)
            waiting = _requeue(database)
        made = f"{manifest.created_at:%Y-%m-%d %H:%M} UTC by version {manifest.version}"
        _say(f"{total(copied)} rows of the backup of {made} restored and verified; {waiting} unfinished jobs queued")
        return 0


def check(argv: Sequence[str]) -> int:
    """Read everything in the database, or in a backup, and say what is wrong with it.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code; 1 when something is wrong.
    """
    parser = parser_of("check", "Read everything in the database, or in a backup, and say what is wrong with it.")
    parser.add_argument("file", type=Path, nargs="?", help="a backup; the database by default")
    given = parser.parse_args(argv)

    from storage import backup as backups
    from storage.checking import check as look

    with _speaking():
        settings = read_settings()
        if given.file is not None:
            manifest, findings = backups.verify(given.file, objects=settings.objects)
            what = f"{given.file} ({manifest.created_at:%Y-%m-%d %H:%M} UTC, version {manifest.version})"
        else:
            with _database(settings.database_url, there=True) as database:
                if not database.is_current():
                    _complain("the database is not as this version needs it: `servotune serve` migrates it")
                    return 1
                findings, what = look(database.engine, objects=settings.objects), "the database"
        return _tell_faults(findings, what=what)


def migrate(argv: Sequence[str]) -> int:
    """Bring every table up to date, and end; where nothing has to be done nothing is.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    parser_of(
        "migrate",
        "Bring the tables of SERVOTUNE_DATABASE_URL (SERVOTUNE_DIRECT_DATABASE_URL behind a pooler) up to date, and end. "
        "`servotune serve` does that, too, when it starts.",
    ).parse_args(argv)

    with _speaking():
        settings = read_settings()
        with _database(settings.direct_database_url or settings.database_url) as database:
            before = database.is_current()
            database.migrate()
        _say("the tables are up to date" if before else "the tables have been brought up to date")
        return 0


def move(argv: Sequence[str]) -> int:
    """Copy the database into another, empty one, SQLite into Postgres or back; the service must not run.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code.
    """
    parser = parser_of(
        "move",
        "Copy the database of SERVOTUNE_DATABASE_URL into another, empty one, count and verify every row. "
        "Stop the service and its workers first; the old database stays as it is.",
    )
    parser.add_argument("url", help="the other database: postgresql+psycopg://user@host/name, sqlite:///path.db")
    given = parser.parse_args(argv)

    from sqlalchemy import make_url

    from storage.copying import copy, snapshot, total
    from storage.errors import CopyError

    with _speaking():
        settings = read_settings()
        with _database(settings.database_url, there=True) as source, _database(given.url) as target:
            if source.engine.url == target.engine.url:
                raise CopyError("the other database must be another one, got that of SERVOTUNE_DATABASE_URL")
            if not source.is_current():
                raise CopyError("the database must be as this version needs it: `servotune serve` migrates it")
            _require_stopped(source)
            target.migrate()
            with snapshot(source.engine) as old, target.engine.begin() as new:
                copied = copy(old, new, tell=_progress)
            waiting = _requeue(target)
        for table, content in copied.items():
            if content.rows:
                _say(f"  {table:<24} {content.rows:>10}")
        shown = make_url(given.url).render_as_string(hide_password=True)
        _say(f"{total(copied)} rows moved and verified; {waiting} unfinished jobs queued")
        _say(f"From now on: SERVOTUNE_DATABASE_URL={shown}")
        return 0


def move_blobs(argv: Sequence[str]) -> int:
    """Move samples, originals and arrays between the database and the object store; the service may run.

    Parameters
    ----------
    argv : sequence of str
        Arguments after the command's name.

    Returns
    -------
    int
        Exit code; 1 when some were written to the old side meanwhile.
    """
    parser = parser_of(
        "move-blobs",
        "Move all blobs (samples, originals, arrays of results) into the object store of SERVOTUNE_OBJECT_STORE, or back into "
        "the database, each read back and verified. The service may run; stopped in the middle, the command goes on when "
        "it is started again.",
    )
    parser.add_argument("to", choices=["objects", "database"], help="where they are to lie")
    given = parser.parse_args(argv)

    from storage.moving import move as bring

    with _speaking():
        settings = read_settings()
        with _database(settings.database_url, there=True, objects=settings.objects) as database:
            moved = bring(
                database, to_objects=given.to == "objects", tell=lambda chunks, _: _progress("chunks", chunks)
            )
        _say(f"{moved.chunks} chunks with {moved.bytes} bytes moved and verified")
        if given.to == "database" and moved.chunks:
            _say("their objects stay for a day, because earlier backups name them: make a new backup")
        if moved.left:
            _complain(
                f"{moved.left} chunks were written to the old side meanwhile: start the service and its workers with "
                f"SERVOTUNE_BLOB_STORE={given.to}, then this command again"
            )
        return 1 if moved.left else 0


@contextmanager
def _database(url: str, *, there: bool = False, objects: ObjectStore | None = None) -> Iterator[Database]:
    """Open a database; one that must be ``there`` is not made by opening it, and a file that was not goes again where the command fails."""
    from storage.errors import CopyError
    from storage.session import open_database, sqlite_file

    database = open_database(url, objects=objects)
    path = sqlite_file(url)
    new = path is not None and not path.exists()
    if there and path is not None and not path.is_file():
        raise CopyError(f"the database must exist, got {path}")
    done = False
    try:
        database.ping()
        yield database
        done = True
    finally:
        database.dispose()
        if path is not None and new and not done:
            for left in ("", "-wal", "-shm", "-journal"):
                path.with_name(path.name + left).unlink(missing_ok=True)


@contextmanager
def _speaking() -> Iterator[None]:
    """Turn what goes wrong into a sentence and exit code 1."""
    from sqlalchemy.exc import DatabaseError

    from storage.errors import UNAVAILABLE, StorageError, full_disk, is_damage

    unreachable: tuple[type[Exception], ...] = UNAVAILABLE
    unreadable: tuple[type[Exception], ...] = (DatabaseError, UnicodeDecodeError, *unreachable)
    try:
        yield
    except StorageError as error:
        raise SystemExit(str(error)) from error
    except unreadable as error:
        if (full := full_disk(error)) is not None:
            raise SystemExit(full) from error
        if is_damage(error):
            raise SystemExit(
                f"the database must be one that SQLite can read, got one that is damaged: {getattr(error, 'orig', error)}"
            ) from error
        if not isinstance(error, unreachable):
            raise
        raise SystemExit(f"the database must be reachable: {str(error).splitlines()[0]}") from error
    except OSError as error:
        told = full_disk(error) or f"the file must be readable, its directory writable: {error}"
        raise SystemExit(told) from error


def _require_stopped(database: Database) -> None:
    from storage.clock import shared_now
    from storage.errors import CopyError
    from storage.repositories import WorkerRepository

    with database.session() as session:
        seen = WorkerRepository(session).last_seen()
        age = None if seen is None else abs((shared_now(session) - seen).total_seconds())
    if age is not None and age < _STOPPED_FOR:
        raise CopyError(f"the service and its workers must have stopped, a worker was seen {age:.0f} s ago")


def _requeue(database: Database) -> int:
    """Hand the unfinished jobs of a copy to the job engine."""
    from storage.copying import requeue
    from storage.jobs.queue import JobQueue

    queue = JobQueue(database)
    try:
        with database.session() as session:
            return requeue(session, queue.place)
    finally:
        queue.close()


def _tell_faults(findings: Findings, *, what: str) -> int:
    for fault in findings.faults:
        _complain(fault)
    if findings.faults:
        return 1
    _say(f"{what} is sound: {findings.blobs} blobs with {findings.bytes} bytes have the SHA-256 that they claim")
    return 0


def _progress(table: str, rows: int) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{table}: {rows} rows\r")
        sys.stderr.flush()


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")


def _complain(text: str) -> None:
    sys.stderr.write(f"{text}\n")
