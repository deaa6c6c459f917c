"""Blobs in an object store beside the database: the same door, moved while both serve, nothing lost and nothing left over."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import delete, func, select

from storage import Database, backup, blobs, open_database
from storage.blobs import forget_unused, sha256_of
from storage.channels import BLOCK
from storage.checking import check
from storage.errors import ObjectStoreError
from storage.imports import Import
from storage.models import DEFAULT_WORKSPACE, BlobChunk, ChannelBlock, Dataset, DatasetStatus, Result
from storage.models.base import utc_now
from storage.moving import forget_objects, move
from storage.objects import ObjectStore
from storage.repositories import DatasetRepository, ResultRepository
from tests.support.object_store import BUCKET, Door, object_store, opened

SAMPLES = np.random.default_rng(7).normal(size=20 * BLOCK - 5)
LATER = timedelta(hours=1)


@pytest.fixture
def door(monkeypatch: pytest.MonkeyPatch) -> Iterator[Door]:
    with object_store(monkeypatch) as door:
        yield door


@contextmanager
def using(url: str, objects: ObjectStore | None) -> Iterator[Database]:
    database = open_database(url, objects=objects)
    try:
        yield database
    finally:
        database.dispose()


def recorded(database: Database, *, samples: np.ndarray = SAMPLES) -> str:
    """Receive a recording in segments and read it within the request."""
    data = samples.tobytes()
    pieces = [data[start : start + (1 << 20)] for start in range(0, len(data), 1 << 20)]
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        row = datasets.create(name="r", format="raw", channels=[{"name": "y"}], sample_rate=1000.0)
        for piece in pieces:
            datasets.put_segment(row.id, sha256_of(piece), piece)
        datasets.commit(row.id, segments=[sha256_of(piece) for piece in pieces], sha256=sha256_of(data))
        datasets.ingest_raw(row.id)
        return row.id


def holds(database: Database, identifier: str, *, samples: np.ndarray = SAMPLES) -> None:
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        np.testing.assert_array_equal(datasets.read_channel(identifier, "y"), samples)
        assert b"".join(datasets.original(identifier)) == samples.tobytes()
        low = datasets.read_decimated(identifier, "y", points=50).minimum.min()
        assert low == samples.min()


def named(database: Database) -> set[str]:
    with database.session() as session:
        return set(session.scalars(select(BlobChunk.object).where(BlobChunk.object.is_not(None))))


def lying() -> set[str]:
    return {name for page in opened().older(utc_now() + LATER) for name in page}


def counts(database: Database) -> tuple[int, int]:
    """Return how many chunks lie in the database, and how many in the object store."""
    with database.session() as session:
        inside = session.scalar(select(func.count()).where(BlobChunk.object.is_(None), BlobChunk.data != b""))
        beside = session.scalar(select(func.count()).where(BlobChunk.object.is_not(None), BlobChunk.data == b""))
        assert inside + beside == session.scalar(select(func.count()).select_from(BlobChunk))
        return inside, beside


def test_everything_is_kept_there_and_read_back(door: Door, database_url: str) -> None:
    two_chunks = bytes(blobs.CHUNK_SIZE) + b"tail"
    with using(database_url, opened()) as database:
        recording = recorded(database)
        with database.session() as session:
            ref = blobs.put_bytes(session, two_chunks)
            curves = {"a": np.arange(50.0), "same": np.arange(50.0), "b": [np.eye(3)]}
            result = ResultRepository(session, DEFAULT_WORKSPACE).create(kind="simulation", body=curves).id
            file = DatasetRepository(session, DEFAULT_WORKSPACE).create(name="f", format="csv", channels=[])
            file.status = DatasetStatus.PARSING
            imported = file.id
        with Import(database, DEFAULT_WORKSPACE, imported) as writing:
            writing.add(0, SAMPLES[::-1])
            writing.finish(channels=[{"name": "y"}], report={})

        inside, beside = counts(database)
        assert inside == 0
        assert named(database) == lying()
        assert len(lying()) == beside > 50
        holds(database, recording)
        with database.session() as session:
            assert blobs.get_bytes(session, ref) == two_chunks
            found = ResultRepository(session, DEFAULT_WORKSPACE).body(session.get_one(Result, result))
            np.testing.assert_array_equal(found["same"], np.arange(50.0))
            np.testing.assert_array_equal(found["b"][0], np.eye(3))
            read = DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(imported, "y")
            np.testing.assert_array_equal(read, SAMPLES[::-1])
        findings = check(database.engine, objects=opened())
        assert findings.faults == ()
        assert findings.bytes > 4 * SAMPLES.nbytes


def test_the_same_content_is_brought_there_once(door: Door, database: Database) -> None:
    with using(database.url, opened()) as own:
        first = recorded(own)
        there = lying()
        second = recorded(own)
        assert lying() == there
        holds(own, first)
        holds(own, second)


def test_who_does_not_know_the_store_says_what_is_missing(door: Door, database: Database) -> None:
    with using(database.url, opened()) as own:
        recording = recorded(own)
    with pytest.raises(ObjectStoreError, match="SERVOTUNE_OBJECT_STORE must name it, got none"):
        holds(database, recording)


def test_blobs_move_there_and_back_while_somebody_reads_and_writes(door: Door, database: Database) -> None:
    with using(database.url, opened(preferred=False)) as own:
        recording = recorded(own)
        before = counts(own)
        wrong: list[BaseException] = []
        done, rounds = threading.Event(), 0

        def read() -> None:
            nonlocal rounds
            try:
                while not done.is_set():
                    holds(own, recording)
                    recorded(own, samples=SAMPLES[: BLOCK + rounds])
                    rounds += 1
            except BaseException as error:  # noqa: BLE001 - the test tells it
                wrong.append(error)

        reader = threading.Thread(target=read)
        reader.start()
        there = move(own, to_objects=True)
        back = move(own, to_objects=False)
        done.set()
        reader.join()
        assert wrong == []
        assert rounds > 0
        assert there.chunks >= before[0]
        assert back.left == 0
        assert counts(own)[1] == 0
        assert lying() > set()  # backups of the time in between name them
        forget_objects(own, before=utc_now() + LATER)
        assert lying() == set()
        holds(own, recording)


MOVE = "import sys; from api.commands.maintenance import move_blobs; sys.exit(move_blobs(sys.argv[1:]))"


def moving(url: str, to: str) -> subprocess.Popen[str]:
    environment = os.environ | {"SERVOTUNE_DATABASE_URL": url, "SERVOTUNE_OBJECT_STORE": f"s3://{BUCKET}/of/one"}
    return subprocess.Popen(
        [sys.executable, "-c", MOVE, to],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.parametrize(("to", "method"), [("objects", "PUT"), ("objects", "GET"), ("database", "GET")])
def test_a_move_that_is_killed_loses_nothing_goes_on_and_leaves_nothing(
    door: Door, database: Database, to: str, method: str
) -> None:
    with using(database.url, opened(preferred=to == "database")) as own:
        recording = recorded(own)
        chunks = sum(counts(own))
        # The third time eight of them are written, the second time they are read back, the second time they are read to be written here.
        door.befall("slow", methods=(method,), spared={"PUT": 20, "GET": 12}[method])
        first = moving(own.url, to)
        assert door.struck.wait(60)
        os.kill(first.pid, signal.SIGKILL)
        first.communicate()
        door.befall("")

        inside, beside = counts(own)
        assert 0 < inside < chunks
        assert inside + beside == chunks
        holds(own, recording)
        assert named(own) < lying()  # some were written, or have been moved, and no row names them

        second = moving(own.url, to)
        told, _ = second.communicate()
        assert second.returncode == 0, told
        assert f"{inside if to == 'objects' else beside} chunks" in told
        assert counts(own) == ((0, chunks) if to == "objects" else (chunks, 0))
        assert forget_objects(own, before=utc_now() - LATER) == 0  # somebody might be about to commit
        assert forget_objects(own, before=utc_now() + LATER) > 0
        assert lying() == named(own)
        holds(own, recording)


def test_what_was_never_committed_or_is_needed_no_more_is_swept(door: Door, database: Database) -> None:
    with using(database.url, opened()) as own:
        kept = recorded(own)
        with own.sessions() as session:
            blobs.put_bytes(session, b"never committed")
            session.rollback()
        gone = recorded(own, samples=SAMPLES[:100])
        assert len(lying()) > len(named(own))
        with own.session() as session:
            session.execute(delete(ChannelBlock).where(ChannelBlock.dataset_id == gone))
            session.delete(session.get_one(Dataset, gone))
        with own.session() as session:
            forget_unused(session, before=utc_now() + LATER)
        assert (
            forget_objects(own, before=utc_now() + LATER) == 3
        )  # the one, and of the other a block like its segment and one of extremes
        assert lying() == named(own)
        holds(own, kept)


def test_what_a_backup_names_stays_for_a_while_behind_whatever_takes_its_name(
    door: Door, database: Database, tmp_path: Path
) -> None:
    with using(database.url, opened()) as own:
        kept, deleted = recorded(own), recorded(own, samples=SAMPLES[:100])
        backup.make(own, tmp_path / "night.backup", version="0")
        written, long_after = lying(), utc_now()
        while {name for page in opened().older(long_after) for name in page} != written:
            long_after = utc_now()  # the store tells whole seconds

        with own.session() as session:
            session.execute(delete(ChannelBlock).where(ChannelBlock.dataset_id == deleted))
            session.delete(session.get_one(Dataset, deleted))
        with own.session() as session:
            forget_unused(session, before=utc_now() + LATER)
        move(own, to_objects=False)
        assert named(own) == set()
        assert lying() == written
        for _ in range(2):  # they are old, and have had no name for a moment
            assert forget_objects(own, before=long_after) == 0
        _, findings = backup.verify(tmp_path / "night.backup", objects=opened())
        assert findings.faults == ()
        assert forget_objects(own, before=utc_now() + LATER) == len(written)
        assert lying() == set()
        holds(own, kept)
