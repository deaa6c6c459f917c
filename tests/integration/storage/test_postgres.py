"""What Postgres is asked beside the questions themselves: nothing before the first write, and nothing of who has gone."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from psycopg.pq import TransactionStatus
from sqlalchemy import func, select, text

from storage import Database, open_database, postgres
from storage.errors import DatabaseUrlError
from storage.insertion import insert_if_absent
from storage.models import Workspace
from tests.support.postgres import create_database, drop_database

_numbers = itertools.count()
WORKSPACES = select(func.count()).select_from(Workspace)


@pytest.fixture
def own(postgres_url: str, postgres_template: str) -> Iterator[Database]:
    """A database whose connections nobody else has."""
    name = f"sparing_{next(_numbers)}"
    database = open_database(create_database(postgres_url, name, template=postgres_template))
    yield database
    database.dispose()
    drop_database(postgres_url, name)


def _state(session: Any) -> TransactionStatus:
    return session.connection().connection.dbapi_connection.info.transaction_status


def test_a_transaction_begins_with_the_first_statement_that_writes_or_locks(own: Database) -> None:
    with own.session() as session:
        session.scalars(select(Workspace)).all()
        assert _state(session) == TransactionStatus.IDLE
        insert_if_absent(session, Workspace, id="ws_new", name="new")
        assert _state(session) == TransactionStatus.INTRANS
    with own.session() as session:
        assert session.get(Workspace, "ws_new", with_for_update=True) is not None
        assert _state(session) == TransactionStatus.INTRANS
    with own.session() as session:
        session.execute(text("SELECT pg_advisory_xact_lock(1)"))
        assert _state(session) == TransactionStatus.INTRANS
    with own.session() as session:
        streamed = session.scalars(select(Workspace), execution_options={"yield_per": 1})
        assert next(streamed).id
        assert _state(session) == TransactionStatus.INTRANS
        streamed.close()
    with own.session() as session:  # and not for ever
        session.scalar(WORKSPACES)
        assert _state(session) == TransactionStatus.IDLE


def test_what_an_exception_passes_is_not_written_whatever_was_read_before(own: Database) -> None:
    def fail() -> None:
        with own.session() as session:
            assert session.scalar(WORKSPACES) == before
            insert_if_absent(session, Workspace, id="ws_never", name="never")
            assert session.scalar(WORKSPACES) == before + 1
            raise LookupError

    with own.session() as session:
        before = session.scalar(WORKSPACES)
    with pytest.raises(LookupError):
        fail()
    with own.session() as session:
        assert session.scalar(WORKSPACES) == before


def test_who_chose_an_isolation_level_has_it_from_the_first_question_on(own: Database) -> None:
    with own.engine.connect().execution_options(isolation_level="REPEATABLE READ") as early:
        before = early.scalar(WORKSPACES)
        with own.session() as session:
            insert_if_absent(session, Workspace, id="ws_late", name="late")
        assert early.scalar(WORKSPACES) == before
    with own.session() as session:
        assert session.scalar(WORKSPACES) == before + 1
        assert _state(session) == TransactionStatus.IDLE
    with own.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as alone:
        alone.execute(text("SELECT 1"))
        assert alone.connection.dbapi_connection.info.transaction_status == TransactionStatus.IDLE


@pytest.mark.parametrize("idle", [postgres.IDLE, -1.0], ids=["looked at", "tried out"])
def test_a_connection_that_the_server_has_closed_is_not_used_again(
    own: Database, postgres_url: str, monkeypatch: pytest.MonkeyPatch, idle: float
) -> None:
    monkeypatch.setattr(postgres, "IDLE", idle)
    with own.session() as session:
        gone = session.scalar(select(func.pg_backend_pid()))
    with own.session() as session:
        assert session.scalar(select(func.pg_backend_pid())) == gone
    home = postgres_url.partition("?host=")[2]
    with psycopg.connect(host=home, user="postgres", dbname="postgres", autocommit=True) as operator:
        operator.execute("SELECT pg_terminate_backend(%s, 60000)", [gone])
    with own.session() as session:
        assert session.scalar(select(func.pg_backend_pid())) != gone


@pytest.mark.parametrize("encoding", ["SQL_ASCII", "LATIN1"])
def test_a_database_of_another_encoding_is_refused(postgres_url: str, encoding: str) -> None:
    name = f"foreign_{next(_numbers)}"
    with psycopg.connect(host=postgres_url.partition("?host=")[2], user="postgres", autocommit=True) as server:
        server.execute(f"CREATE DATABASE {name} ENCODING '{encoding}' TEMPLATE template0".encode())
    database = open_database(postgres_url.format(name=name))
    try:
        with pytest.raises(DatabaseUrlError, match=f"must have the encoding UTF8, got {encoding}"):
            database.migrate()
        with pytest.raises(DatabaseUrlError, match="must have the encoding UTF8"):
            database.ping()
    finally:
        database.dispose()
        drop_database(postgres_url, name)
