"""Whoever stands still in the middle of a transaction on Postgres keeps what it has locked for ten seconds, not for hours."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from sqlalchemy import select, text, update

from storage import Database, open_database, postgres
from storage.errors import UNAVAILABLE
from storage.models import DEFAULT_WORKSPACE, Workspace
from tests.support.postgres import create_database, drop_database

BOUND = 0.2
NAME = select(Workspace.name).where(Workspace.id == DEFAULT_WORKSPACE)


def rename(name: str):
    return update(Workspace).where(Workspace.id == DEFAULT_WORKSPACE).values(name=name)


@pytest.fixture
def own(postgres_url: str, postgres_template: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Database]:
    """A database whose transactions are waited for as long as `BOUND`."""
    monkeypatch.setattr(postgres, "LONGEST_PAUSE", BOUND)
    database = open_database(create_database(postgres_url, "still", template=postgres_template))
    yield database
    database.dispose()
    drop_database(postgres_url, "still")


def test_a_transaction_waits_for_less_than_a_takeover_may_take() -> None:
    assert postgres.LONGEST_PAUSE < 15.0  # the promise: from the death of a worker to the next line of another one


def test_who_stands_still_holds_up_nobody_and_learns_that_nothing_was_written(own: Database) -> None:
    with own.sessions() as still:
        still.execute(rename("never"))
        with own.session() as other:  # waits for the lock until the first one has been given up
            other.execute(rename("changed"))
        with pytest.raises(UNAVAILABLE):
            still.execute(rename("never at all"))
    with own.session() as again:
        assert again.scalar(NAME) == "changed"


def test_a_commit_that_comes_too_late_is_none(own: Database) -> None:
    with own.sessions() as still:
        still.execute(rename("never"))
        with own.session() as other:
            other.execute(rename("changed"))
        with pytest.raises(UNAVAILABLE):
            still.commit()
    with own.session() as again:
        assert again.scalar(NAME) == "changed"


def test_a_copy_and_a_migration_take_their_time(own: Database) -> None:
    with own.engine.begin() as connection:
        postgres.take_time(connection)
        connection.execute(rename("slowly"))
        time.sleep(2 * BOUND)
        connection.execute(text("SELECT 1"))
    with own.session() as again:
        assert again.scalar(NAME) == "slowly"
        assert again.scalar(text("SHOW idle_in_transaction_session_timeout")) == f"{1000 * BOUND:.0f}ms"
