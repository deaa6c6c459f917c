"""What is left of a database that was let go."""

from __future__ import annotations

import sqlite3

import psycopg
import pytest

from storage import open_database


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
