"""Back to a moment before a mistake: Postgres' own log brings the rows back, the objects are still there, and what came later goes."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta

import numpy as np
import pytest
from sqlalchemy import text

from storage import Database, open_database
from storage.blobs import forget_unused
from storage.checking import check
from storage.errors import NotFoundError
from storage.models import DEFAULT_WORKSPACE
from storage.models.base import utc_now
from storage.moving import forget_objects
from storage.repositories import DatasetRepository
from tests.integration.storage.test_objects import holds, lying, named, recorded
from tests.support.object_store import object_store, opened
from tests.support.postgres import Server, create_database

A_DAY = timedelta(days=1)
FIRST, SECOND, THIRD = (np.random.default_rng(seed).normal(size=300_000) for seed in range(3))


@pytest.fixture
def servers() -> Iterator[list[Server]]:
    started: list[Server] = []
    try:
        yield started
    finally:
        for server in started:
            server.stop()
            server.remove()


def deleted(database: Database, *identifiers: str) -> None:
    with database.session() as session:
        for identifier in identifiers:
            DatasetRepository(session, DEFAULT_WORKSPACE).delete(identifier)
        forget_unused(session, before=utc_now() + A_DAY)  # as a day later
    forget_objects(database, before=utc_now())  # as within the hour: what is in no row any more stays for another day


def test_a_mistake_is_undone_and_nothing_is_left_over(servers: list[Server], monkeypatch: pytest.MonkeyPatch) -> None:
    with object_store(monkeypatch):
        server = Server(archive_mode="on", full_page_writes="on")
        archive = server.folder("archive")
        server.start(archive_command=f"test ! -f {archive}/%f && cp %p {archive}/%f")
        servers.append(server)
        database = open_database(create_database(server.url, "servotune"), objects=opened())
        database.migrate()
        first = recorded(database, samples=FIRST)
        nightly = Server(copy_of=server)
        second = recorded(database, samples=SECOND)
        with database.session() as session:
            moment = session.scalar(text("SELECT clock_timestamp()"))
        assert isinstance(moment, datetime)
        deleted(database, first, second)
        third = recorded(database, samples=THIRD)
        database.dispose()
        server.archived()
        server.stop()

        nightly.recover(archive, until=moment)
        servers.append(nightly)
        database = open_database(nightly.url.format(name="servotune"), objects=opened())
        assert check(database.engine, objects=opened()).faults == ()
        holds(database, first, samples=FIRST)
        holds(database, second, samples=SECOND)
        with database.session() as session, pytest.raises(NotFoundError):
            DatasetRepository(session, DEFAULT_WORKSPACE).get(third)
        # what was written after the moment is in no row: it is found within the hour and goes a day later
        assert lying() > named(database)
        assert forget_objects(database, before=utc_now()) == 0
        assert forget_objects(database, before=utc_now() + A_DAY) > 0
        assert lying() == named(database)
        assert check(database.engine, objects=opened()).faults == ()
        database.dispose()
