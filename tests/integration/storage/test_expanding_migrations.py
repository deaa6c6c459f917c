"""A version works with the tables of the next one, so that old and new processes serve side by side while an installation is upgraded.

Each migration since `SINCE` adds: whatever was there stays as it was, and what is new does not get in the way of a process that does not
know it. What nobody uses any more may go with the version after that which has stopped to use it; such a migration names it in ``gone``
(``("table.column", "table")``).
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Collection
from dataclasses import dataclass

import pytest
import sqlalchemy as sa
from alembic import command
from alembic.migration import MigrationContext
from alembic.operations import Operations
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect, text

from storage import Database, open_database
from storage.migrations import configuration, upgrade_tables
from tests.support.desk import COMPUTE, Desk
from tests.support.later_version import expand

SINCE = "0018"
"""The last revision before the rule."""

SCRIPTS = {script.revision: script for script in ScriptDirectory.from_config(configuration()).walk_revisions()}
LATER = sorted(revision for revision in SCRIPTS if revision > SINCE)
RULE = "a migration only adds, what the version before uses must stay"


@dataclass(frozen=True)
class Tables:
    """What a process may rely on: types and obligations of columns, and what rows must be."""

    columns: dict[str, str]
    demanded: frozenset[str]  # columns that every new row must give
    constraints: frozenset[str]


def tables(connection: Connection) -> Tables:
    """Read the tables as they are."""
    found = inspect(connection)
    columns, demanded, constraints = {}, set(), set()
    for table in found.get_table_names():
        for column in found.get_columns(table):
            name = f"{table}.{column['name']}"
            columns[name] = str(column["type"])
            if not column["nullable"] and column["default"] is None:
                demanded.add(name)
        constraints |= {
            f"{table} unique {sorted(filter(None, i['column_names']))}" for i in found.get_indexes(table) if i["unique"]
        }
        constraints |= {f"{table} unique {sorted(i['column_names'])}" for i in found.get_unique_constraints(table)}
        constraints |= {f"{table} check {i['sqltext']}" for i in found.get_check_constraints(table)}
        constraints |= {f"{table} refers {i['constrained_columns']}" for i in found.get_foreign_keys(table)}
    return Tables(columns=columns, demanded=frozenset(demanded), constraints=frozenset(constraints))


def in_the_way(before: Tables, after: Tables, *, gone: Collection[str] = ()) -> list[str]:
    """Return what a process that knows the tables as they were ``before`` would stumble over."""
    old = {name.partition(".")[0] for name in before.columns}
    said = []
    for name, kind in before.columns.items():
        if name in gone or name.partition(".")[0] in gone:
            continue
        if name not in after.columns:
            said.append(f"{name} is gone")
        elif after.columns[name] != kind:
            said.append(f"{name} was {kind} and is {after.columns[name]}")
    said += [f"{name} must be given" for name in after.demanded - before.demanded if name.partition(".")[0] in old]
    return said + [f"{rule} is new" for rule in after.constraints - before.constraints if rule.partition(" ")[0] in old]


@pytest.fixture
def empty(empty_database_url):
    opened = open_database(empty_database_url)
    yield opened
    opened.dispose()


def at(database: Database, revision: str) -> Tables:
    """Bring a database to a revision, and read its tables."""
    config = configuration()
    with database.engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, revision)
    with database.engine.connect() as connection:
        return tables(connection)


@pytest.mark.parametrize("revision", LATER)
def test_a_migration_only_adds(empty, revision) -> None:
    script = SCRIPTS[revision]
    assert isinstance(script.down_revision, str)
    before = at(empty, script.down_revision)
    gone = getattr(script.module, "gone", ())
    assert in_the_way(before, at(empty, revision), gone=gone) == [], RULE


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda op: op.drop_column("job", "time_limit"), "job.time_limit is gone"),
        (lambda op: op.rename_table("elected", "chosen"), "elected.role is gone"),
        (lambda op: op.alter_column("job", "message", new_column_name="said"), "job.message is gone"),
        (lambda op: op.add_column("job", sa.Column("colour", sa.Text(), nullable=False)), "job.colour must be given"),
        (
            lambda op: op.create_index("ix_once", "system", ["name"], unique=True),
            "system unique ['name'] is new",
        ),
        (lambda op: op.add_column("job", sa.Column("colour", sa.Text(), nullable=True)), None),
        (lambda op: op.add_column("job", sa.Column("n", sa.Integer(), nullable=False, server_default="0")), None),
        (lambda op: op.create_table("other", sa.Column("id", sa.Text(), nullable=False, unique=True)), None),
        (lambda op: op.create_index("ix_name", "job", ["kind", "message"]), None),
    ],
    ids=[
        "drop",
        "rename a table",
        "rename a column",
        "demand",
        "unique",
        "add",
        "add with a default",
        "a table",
        "an index",
    ],
)
def test_what_takes_away_is_found(fresh_database, change, said) -> None:
    with fresh_database.engine.connect() as connection:
        before = tables(connection)
    with fresh_database.engine.begin() as connection:
        if connection.dialect.name == "sqlite" and said == "job.colour must be given":
            pytest.skip("SQLite itself refuses such a column")
        change(Operations(MigrationContext.configure(connection)))
    with fresh_database.engine.connect() as connection:
        found = in_the_way(before, tables(connection))
    assert said in found if said else found == []


def test_a_worker_does_jobs_beside_a_later_version(fresh_database) -> None:
    expand(fresh_database)
    assert not fresh_database.is_current()
    assert fresh_database.serves()
    upgrade_tables(fresh_database.engine)  # whoever starts now has nothing to do
    with fresh_database.engine.connect() as connection:
        assert connection.scalar(text("SELECT version_num FROM alembic_version")) == "9999"
    code = (
        "import sys, threading; from storage.jobs.worker import Worker; stop = threading.Event(); "
        "threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start(); "
        f"Worker(sys.argv[1], compute={COMPUTE!r}).run(stop)"
    )
    worker = subprocess.Popen([sys.executable, "-c", code, fresh_database.url], stdin=subprocess.PIPE)
    desk = Desk(fresh_database)
    try:
        assert desk.wait(desk.ask("square", values=[1, 2]), timeout=120).status == "succeeded"
    finally:
        assert worker.stdin is not None
        worker.stdin.close()
        worker.wait(60)
        desk.queue.close()


def test_tables_of_an_earlier_version_are_not_served(empty) -> None:
    at(empty, SINCE)
    assert not empty.serves()
