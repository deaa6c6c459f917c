"""What is left of a database that was let go."""

from __future__ import annotations

import sqlite3

import psycopg
import pytest

from storage import open_database
from storage.session import readable_by_others


def test_a_new_database_is_its_users_alone(tmp_path):
    path = tmp_path / "own.db"
    database = open_database(f"sqlite:///{path}")
    assert not path.exists()
    database.migrate()
    with database.session() as session:
        session.connection().exec_driver_sql("SELECT 1")
        modes = {file.name: file.stat().st_mode & 0o777 for file in tmp_path.iterdir()}
    assert modes == {"own.db": 0o600, "own.db-wal": 0o600, "own.db-shm": 0o600}
    assert readable_by_others(f"sqlite:///{path}") is None
    path.chmod(0o644)
    assert readable_by_others(f"sqlite:///{path}") == str(path)
    database.dispose()


def test_a_connection_at_work_while_the_database_is_let_go_is_closed_when_it_comes_back(database_url):
    database = open_database(database_url)
    early, late = database.engine.connect(), database.engine.connect()
    connections = [connection.connection.dbapi_connection for connection in (early, late)]
    early.close()
    database.dispose()
    late.close()
    for connection in connections:
        with pytest.raises((psycopg.OperationalError, sqlite3.ProgrammingError), match="closed"):
            connection.execute("SELECT 1")


def test_what_is_asked_of_a_database_that_was_let_go_leaves_nothing_open(database_url):
    database = open_database(database_url)
    database.dispose()
    with database.engine.connect() as connection:
        last = connection.connection.dbapi_connection
    with pytest.raises((psycopg.OperationalError, sqlite3.ProgrammingError), match="closed"):
        last.execute("SELECT 1")
