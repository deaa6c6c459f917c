"""A channel of any length is read by one question, a few blocks in memory at a time; blocks of earlier versions among them."""

from __future__ import annotations

import tracemalloc
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import psycopg
import pytest
from psycopg.pq import TransactionStatus
from sqlalchemy import delete, event, select, update

from storage import Database
from storage.channels import BLOCK
from storage.errors import NotFoundError
from storage.models import DEFAULT_WORKSPACE, BlobChunk, ChannelBlock, DatasetStatus
from storage.repositories import DatasetRepository

BLOCKS = 40
SAMPLES = np.random.default_rng(5).normal(size=BLOCKS * BLOCK - 77)


@pytest.fixture
def recording(database: Database) -> str:
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        row = datasets.create(name="long", format="raw", channels=[{"name": "y"}], sample_rate=51_200.0)
        row.status = DatasetStatus.PARSING
        session.flush()
        datasets.write_channels(row.id, SAMPLES[:, np.newaxis][np.newaxis])
        return row.id


@contextmanager
def statements(database: Database) -> Iterator[list[Any]]:
    """Collect the cursors of all that is asked."""
    asked: list[Any] = []

    def note(_connection: Any, cursor: Any, *_: Any) -> None:
        asked.append(cursor)

    event.listen(database.engine, "after_cursor_execute", note)
    yield asked
    event.remove(database.engine, "after_cursor_execute", note)


def read(database: Database, identifier: str, **part: int) -> np.ndarray:
    with database.session() as session:
        return DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(identifier, "y", **part)


def test_forty_blocks_take_as_many_questions_as_one(database: Database, recording: str) -> None:
    with statements(database) as few:
        one = read(database, recording, start=10, stop=20)
    with statements(database) as many:
        whole = read(database, recording)
    np.testing.assert_array_equal(whole, SAMPLES)
    np.testing.assert_array_equal(one, SAMPLES[10:20])
    assert len(many) == len(few) == 2  # the recording, and its samples
    if database.engine.dialect.name == "postgresql":
        assert isinstance(many[1], psycopg.ServerCursor)


@pytest.mark.parametrize(
    ("start", "stop"),
    [(0, 1), (BLOCK - 1, BLOCK + 1), (BLOCK, 2 * BLOCK), (5, 3 * BLOCK), (len(SAMPLES) - 1, len(SAMPLES)), (7, 7)],
)
def test_any_part_is_that_part(database: Database, recording: str, start: int, stop: int) -> None:
    np.testing.assert_array_equal(read(database, recording, start=start, stop=stop), SAMPLES[start:stop])


def test_no_more_than_some_blocks_are_in_memory_beside_the_samples(database: Database, recording: str) -> None:
    read(database, recording, stop=10)  # whatever is loaded once
    tracemalloc.start()
    try:
        assert read(database, recording).nbytes == SAMPLES.nbytes
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < SAMPLES.nbytes + 24 * 8 * BLOCK  # eight blocks ahead and eight at hand, and what is unpacked


def test_who_reads_keeps_no_transaction_and_who_writes_keeps_his(database: Database, recording: str) -> None:
    if database.engine.dialect.name == "sqlite":
        pytest.skip("SQLite: whoever reads has no transaction to keep")
    with database.session() as session:
        own = session.connection().connection.dbapi_connection
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        datasets.read_channel(recording, "y")
        assert own.info.transaction_status == TransactionStatus.IDLE
        datasets.create(name="begun", format="raw")
        datasets.read_channel(recording, "y")
        assert own.info.transaction_status == TransactionStatus.INTRANS
    with database.session() as session:
        assert len(DatasetRepository(session, DEFAULT_WORKSPACE).page().items) == 2


def test_blocks_of_earlier_versions_are_read_among_new_ones(database: Database, recording: str) -> None:
    with database.session() as session:
        for number in (0, 3):
            block = SAMPLES[number * BLOCK : (number + 1) * BLOCK].tobytes()
            old = zlib.compress(b"".join(block[place::8] for place in range(8)), 1)
            head = select(ChannelBlock.sha256).where(ChannelBlock.level == 0, ChannelBlock.number == number)
            session.execute(
                update(BlobChunk)
                .where(BlobChunk.sha256.in_(head))
                .values(encoding="zlib/8", data=old)
                .execution_options(synchronize_session=False)
            )
        assert set(session.scalars(select(BlobChunk.encoding))) >= {"zlib/8", "zstd/8"}
    np.testing.assert_array_equal(read(database, recording), SAMPLES)


@pytest.mark.parametrize("number", [0, 17, BLOCKS - 1])
def test_a_block_that_is_gone_is_told_with_its_place(database: Database, recording: str, number: int) -> None:
    with database.session() as session:
        session.execute(delete(ChannelBlock).where(ChannelBlock.level == 0, ChannelBlock.number == number))
    with pytest.raises(NotFoundError, match=rf"channel 0, level 0, cell {number * BLOCK}"):
        read(database, recording)
