from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import inspect, text

from storage import open_database
from storage.migrations.filter import is_ours
from storage.models import DEFAULT_WORKSPACE, Base, Workspace


def test_an_empty_database_gets_every_table(empty_database_url):
    database = open_database(empty_database_url)
    assert not database.is_current()
    database.migrate()
    assert database.is_current()
    assert set(Base.metadata.tables) <= set(inspect(database.engine).get_table_names())
    with database.session() as session:
        assert session.get_one(Workspace, DEFAULT_WORKSPACE).name == "default"
    database.migrate()  # a second time changes nothing
    assert database.is_current()
    database.dispose()


def test_models_and_migrations_agree(database):
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"include_name": is_ours, "compare_type": True})
        assert compare_metadata(context, Base.metadata) == []


@pytest.mark.parametrize("statement", ["DELETE FROM alembic_version", "UPDATE {dbos}dbos_migrations SET version = 1"])
def test_a_database_that_is_behind_is_not_current(fresh_database, statement):
    dbos = "" if fresh_database.engine.dialect.name == "sqlite" else "dbos."
    with fresh_database.engine.begin() as connection:
        connection.execute(text(statement.format(dbos=dbos)))
    assert not fresh_database.is_current()


def test_a_new_file_may_be_opened_by_many_at_once(tmp_path):
    """SQLite refuses all but one of those who switch a file to write-ahead logging; nobody may notice."""

    def ping(url: str, start: threading.Barrier) -> None:
        database = open_database(url)
        start.wait()
        try:
            database.ping()
        finally:
            database.dispose()

    with ThreadPoolExecutor(4) as threads:
        for number in range(60):
            start = threading.Barrier(4)
            waiting = [threads.submit(ping, f"sqlite:///{tmp_path}/{number}.db", start) for _ in range(4)]
            for each in waiting:
                each.result()


def test_two_processes_migrate_at_once(empty_database_url):
    # Should they ever wait for each other, their tracebacks say where.
    code = (
        "import faulthandler, sys, storage; faulthandler.dump_traceback_later(90, exit=True); "
        "storage.open_database(sys.argv[1]).migrate()"
    )
    processes = [
        subprocess.Popen([sys.executable, "-c", code, empty_database_url], stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    for process in processes:
        _output, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    database = open_database(empty_database_url)
    assert database.is_current()
    with database.session() as session:
        assert session.query(Workspace).count() == 1
    database.dispose()
