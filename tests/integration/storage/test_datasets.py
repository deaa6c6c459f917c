from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from sqlalchemy import func, select

from storage import Database
from storage.blobs import iterate_bytes, sha256_of
from storage.channels import BLOCK
from storage.errors import ChecksumError, MissingSegmentsError, NotFoundError, StateError
from storage.models import DEFAULT_WORKSPACE, Blob, ChannelBlock, DatasetSegment
from storage.repositories import DatasetRepository

CHANNELS = [{"name": "command", "unit": "mm"}, {"name": "position", "unit": "mm"}]
SAMPLES = 3 * BLOCK + 4321


@pytest.fixture(scope="module")
def samples() -> np.ndarray:
    """A recording of two channels, one with a gap."""
    values = np.random.default_rng(7).normal(size=(SAMPLES, 2))
    values[5000:9000, 1] = np.nan
    return values


def cut(data: bytes, size: int) -> dict[str, bytes]:
    pieces = [data[start : start + size] for start in range(0, len(data), size)]
    return {sha256_of(piece): piece for piece in pieces}


def create(database: Database, **more) -> str:
    with database.session() as session:
        values = {"name": "0A", "format": "raw", "channels": CHANNELS, "sample_rate": 1000.0} | more
        return DatasetRepository(session, DEFAULT_WORKSPACE).create(**values).id


def upload(database: Database, identifier: str, segments: dict[str, bytes]) -> None:
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        for sha256, data in reversed(segments.items()):  # any order will do
            assert datasets.put_segment(identifier, sha256, data)


def ready(database: Database, samples: np.ndarray) -> str:
    data = samples.astype("<f8").tobytes()
    identifier = create(database)
    segments = cut(data, 1_600_000)
    upload(database, identifier, segments)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        assert datasets.commit(identifier, segments=list(segments), sha256=sha256_of(data)).status == "parsing"
        assert datasets.ingest_raw(identifier).status == "ready"
    return identifier


def test_a_recording_comes_back_bit_by_bit(database, samples):
    identifier = ready(database, samples)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        assert b"".join(datasets.original(identifier)) == samples.astype("<f8").tobytes()
        dataset = datasets.get(identifier)
        assert (dataset.sample_count, dataset.size) == (SAMPLES, SAMPLES * 16)
        for name, column in (("command", 0), ("position", 1)):
            for start, stop in (
                (0, None),
                (BLOCK - 1, BLOCK + 1),
                (17, 17),
                (2 * BLOCK, 3 * BLOCK),
                (SAMPLES - 1, SAMPLES),
            ):
                values = datasets.read_channel(identifier, name, start, stop)
                np.testing.assert_array_equal(values, samples[start:stop, column])


def test_decimation_gives_the_exact_extremes(database, samples):
    identifier = ready(database, samples)
    ranges = [
        (0, SAMPLES, 500),
        (17, SAMPLES - 5, 50),
        (0, SAMPLES, 2),
        (5, 7, 10),
        (123, 65_432, 2),
        (4990, 9010, 37),
        (6000, 7000, 20),
        (3, 3, 5),
        (0, SAMPLES, 1),
        (17, SAMPLES - 5, 1),
        (5, 7, 1),
        (3, 3, 1),
    ]
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        for start, stop, points in ranges:
            envelope = datasets.read_decimated(identifier, "position", start, stop, points=points)
            edges = [*envelope.index, stop]
            assert len(envelope.index) <= points
            assert all(np.diff(edges) > 0)
            assert edges[0] == start
            for number, (first, last) in enumerate(itertools.pairwise(edges)):
                stretch = samples[first:last, 1]
                stretch = stretch[~np.isnan(stretch)]
                low, high = (stretch.min(), stretch.max()) if len(stretch) else (np.nan, np.nan)
                assert np.array_equal([envelope.minimum[number], envelope.maximum[number]], [low, high], equal_nan=True)


def test_decimation_reads_little(database, samples):
    identifier = ready(database, samples)
    with database.session() as session:
        count = session.scalar(
            select(func.count())
            .select_from(ChannelBlock)
            .where(ChannelBlock.dataset_id == identifier, ChannelBlock.level == 2)
        )
        assert count == 2  # of each channel one: the 400 cells of 256 samples fit into one block
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        read: list[tuple[int, int, int]] = []
        reader, _count = datasets._reader(identifier, "command")
        fetch = reader._read
        reader._read = lambda level, first, last: read.append((level, first, last)) or fetch(level, first, last)
        reader.envelope(0, SAMPLES, points=300)
        assert sum(last - first for _level, first, last in read) < 600


@pytest.mark.parametrize(("start", "stop"), [(-1, 5), (5, 4), (0, SAMPLES + 1)])
def test_a_range_outside_the_recording_is_refused(database, samples, start, stop):
    identifier = ready(database, samples[:100])
    with database.session() as session, pytest.raises(ValueError, match="start and stop"):
        DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(identifier, "command", start, stop)


def test_an_unknown_channel_is_refused(database, samples):
    identifier = ready(database, samples[:100])
    with database.session() as session, pytest.raises(NotFoundError, match="channel 'force'"):
        DatasetRepository(session, DEFAULT_WORKSPACE).read_channel(identifier, "force")


def test_a_segment_arrives_once_however_often_it_is_sent(database):
    identifier = create(database)
    data = bytes(range(256)) * 10
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        assert datasets.put_segment(identifier, sha256_of(data), data)
        assert not datasets.put_segment(identifier, sha256_of(data), data)
        assert [(row.sha256, row.size) for row in datasets.segments(identifier).items] == [(sha256_of(data), 2560)]


def test_segments_are_paged_in_the_order_of_their_arrival(database):
    identifier = create(database)
    pieces = [bytes([number]) * 2560 for number in range(5)]
    seen = []
    cursor = None
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        for piece in pieces:
            datasets.put_segment(identifier, sha256_of(piece), piece)
        while True:
            page = datasets.segments(identifier, cursor=cursor, limit=2)
            seen += [row.sha256 for row in page.items]
            if (cursor := page.next_cursor) is None:
                break
    assert seen == [sha256_of(piece) for piece in pieces]


def test_a_corrupt_segment_leaves_nothing(database):
    identifier = create(database)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        with pytest.raises(ChecksumError):
            datasets.put_segment(identifier, sha256_of(b"right"), b"wrong")
        assert session.scalar(select(func.count()).select_from(Blob)) == 0
        assert session.scalar(select(func.count()).select_from(DatasetSegment)) == 0


def test_a_segment_may_be_eight_mebibytes_and_no_more(database):
    identifier = create(database)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        full = bytes(8 * 1024 * 1024)
        assert datasets.put_segment(identifier, sha256_of(full), full)
        with pytest.raises(StateError, match="at most 8388608 bytes, got 8388609"):
            datasets.put_segment(identifier, sha256_of(full + b"x"), full + b"x")


def test_the_same_bytes_are_kept_once(database, samples):
    first = ready(database, samples)
    with database.session() as session:
        count = session.scalar(select(func.count()).select_from(Blob))
    second = ready(database, samples)
    with database.session() as session:
        assert session.scalar(select(func.count()).select_from(Blob)) == count
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        datasets.delete(first)
        np.testing.assert_array_equal(datasets.read_channel(second, "command"), samples[:, 0])
        with pytest.raises(NotFoundError):
            datasets.get(first)


def test_the_same_bytes_sent_by_many_at_once_are_kept_once(database):
    identifiers = [create(database) for _ in range(6)]
    data = np.random.default_rng(1).bytes(300_000)

    def send(identifier: str) -> bool:
        with database.session() as session:
            return DatasetRepository(session, DEFAULT_WORKSPACE).put_segment(identifier, sha256_of(data), data)

    with ThreadPoolExecutor(6) as threads:
        assert all(threads.map(send, identifiers))
    with database.session() as session:
        assert session.scalar(select(func.count()).select_from(Blob)) == 1


def test_a_manifest_may_name_a_segment_twice(database):
    identifier = create(database)
    silence = bytes(1600)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        datasets.put_segment(identifier, sha256_of(silence), silence)
        datasets.commit(identifier, segments=[sha256_of(silence)] * 3, sha256=sha256_of(silence * 3))
        assert datasets.ingest_raw(identifier).sample_count == 300


def test_commit_refuses_what_is_not_there_or_not_right(database):
    identifier = create(database)
    data = bytes(160)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        datasets.put_segment(identifier, sha256_of(data), data)
        with pytest.raises(MissingSegmentsError) as missing:
            datasets.commit(identifier, segments=[sha256_of(data), "0" * 64, "0" * 64], sha256="1" * 64)
        assert missing.value.missing == ("0" * 64,)
        with pytest.raises(ChecksumError):
            datasets.commit(identifier, segments=[sha256_of(data)], sha256="1" * 64)
        assert datasets.get(identifier).status == "open"


def test_a_commit_can_be_repeated_but_not_changed(database):
    identifier = create(database)
    data = bytes(160)
    manifest = {"segments": [sha256_of(data)], "sha256": sha256_of(data)}
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        datasets.put_segment(identifier, sha256_of(data), data)
        datasets.commit(identifier, **manifest)
        assert datasets.commit(identifier, **manifest).status == "parsing"
        with pytest.raises(StateError, match="must be open, it is parsing"):
            datasets.commit(identifier, segments=[], sha256=sha256_of(b""))
        with pytest.raises(StateError):
            datasets.put_segment(identifier, sha256_of(b"late"), b"late")


def test_raw_bytes_must_be_whole_samples(database):
    identifier = create(database)
    data = bytes(24)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        datasets.put_segment(identifier, sha256_of(data), data)
        datasets.commit(identifier, segments=[sha256_of(data)], sha256=sha256_of(data))
        with pytest.raises(StateError, match="whole samples of 16 bytes, got 24 bytes"):
            datasets.ingest_raw(identifier)


def test_a_file_becomes_readable_or_says_why_not(database):
    data = b"t;x\n0;1\n1;2\n"
    for outcome in ("ready", "failed"):
        identifier = create(database, format="csv", channels=[], sample_rate=None, description={"delimiter": ";"})
        upload(database, identifier, {sha256_of(data): data})
        with database.session() as session:
            datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
            datasets.commit(identifier, segments=[sha256_of(data)], sha256=sha256_of(data))
            if outcome == "ready":
                blocks = [np.array([[1.0]]), np.array([[2.0]])]
                datasets.write_channels(identifier, blocks, channels=[{"name": "x"}], sample_rate=1.0)
                np.testing.assert_array_equal(datasets.read_channel(identifier, "x"), [1.0, 2.0])
            else:
                datasets.fail(identifier, {"title": "Unreadable"})
                with pytest.raises(StateError, match="must be ready, it is failed"):
                    datasets.read_channel(identifier, "x")
            assert datasets.get(identifier).status == outcome


def test_nobody_waits_while_a_commit_reads_the_segments(database, monkeypatch):
    """Whoever writes meanwhile, at the moment in which the bytes are read, is let through."""
    data = bytes(range(256)) * 100
    identifier = create(database, format="tdms")
    segments = cut(data, 10_000)
    upload(database, identifier, segments)
    read, others = iterate_bytes, []

    def read_while_others_write(session, sha256):
        others.append(create(database))
        return read(session, sha256)

    monkeypatch.setattr("storage.repositories.datasets.iterate_bytes", read_while_others_write)
    with database.session() as session:
        datasets = DatasetRepository(session, DEFAULT_WORKSPACE)
        assert datasets.commit(identifier, segments=list(segments), sha256=sha256_of(data)).size == len(data)
    assert len(others) == len(segments)
