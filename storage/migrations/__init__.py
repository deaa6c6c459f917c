"""Brings the tables up to date, from inside the installed package.

Our own tables come from the Alembic scripts beside this file; those of the job engine from the engine itself.
Migrations go forward only; the way back is a backup. Revisions are numbered, so a process can tell tables of a later version from those
of an earlier one: it works with the later ones, because a migration takes away only what the version before it has stopped to use
(held by ``tests/integration/storage/test_expanding_migrations.py``).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, text

from storage.jobs import schema as job_schema
from storage.postgres import take_time

#: Any fixed number: Postgres' name of the lock that migrating processes wait for.
_LOCK = 0x5E4707E


def configuration() -> Config:
    """Return the Alembic configuration of this package."""
    config = Config()
    config.set_main_option("script_location", "storage:migrations")
    return config


def upgrade(engine: Engine, url: str) -> None:
    """Run every migration that is still missing; safe when two processes start at once."""
    with _exclusively(engine):
        upgrade_tables(engine)
        job_schema.upgrade(url)


def upgrade_tables(engine: Engine) -> None:
    """Run every migration of our own tables that is still missing; none on those of a later version."""
    config = configuration()
    with engine.begin() as connection:
        if connection.dialect.name == "sqlite":
            # Alembic's own statements would each commit by themselves: take the write lock now, for all of them.
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        take_time(connection)
        if _of_later_version(connection):
            return
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def stamp(engine: Engine) -> None:
    """Write down that our own tables, made from the models, are those of the last migration."""
    (head,) = ScriptDirectory.from_config(configuration()).get_heads()
    with engine.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL)")
        connection.exec_driver_sql(f"INSERT INTO alembic_version VALUES ('{head}')")  # noqa: S608 - a name of ours


def knows(revision: str) -> bool:
    """Return whether a migration of this name is among ours."""
    return revision in {script.revision for script in ScriptDirectory.from_config(configuration()).walk_revisions()}


def is_current(engine: Engine) -> bool:
    """Return whether no migration is missing."""
    with engine.connect() as connection:
        return _heads(connection) and job_schema.is_current(engine)


def serves(engine: Engine) -> bool:
    """Return whether this version can work with the tables: no migration is missing; a later version may have run more."""
    with engine.connect() as connection:
        return (_heads(connection) or _of_later_version(connection)) and job_schema.is_current(engine)


def _of_later_version(connection: Connection) -> bool:
    (own,) = ScriptDirectory.from_config(configuration()).get_heads()
    found = MigrationContext.configure(connection).get_current_heads()
    return bool(found) and all(revision.isdecimal() and int(revision) > int(own) for revision in found)


def _heads(connection: Connection) -> bool:
    wanted = set(ScriptDirectory.from_config(configuration()).get_heads())
    return set(MigrationContext.configure(connection).get_current_heads()) == wanted


@contextmanager
def _exclusively(engine: Engine) -> Iterator[None]:
    """Hold Postgres' migration lock; SQLite has its own write lock."""
    if engine.dialect.name == "sqlite":
        yield
        return
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        # Asking again and again, because a statement that waits would hold up CREATE INDEX CONCURRENTLY elsewhere.
        while not connection.scalar(text("SELECT pg_try_advisory_lock(:lock)"), {"lock": _LOCK}):
            time.sleep(0.1)
        try:
            yield
        finally:
            connection.execute(text("SELECT pg_advisory_unlock(:lock)"), {"lock": _LOCK})
