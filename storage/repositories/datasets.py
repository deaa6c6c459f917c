"""Recordings: received in verified segments, committed as a whole, read channel by channel."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.blobs import iterate_bytes, packed, put_packed, sha256_of, without_those_kept
from storage.channels import ChannelReader, Envelope, Float, write_channels
from storage.errors import ChecksumError, LeftOutError, MissingSegmentsError, NotFoundError, StateError
from storage.ids import new_id
from storage.imports import RAW
from storage.insertion import insert_if_absent
from storage.lineage import remember, sources_in
from storage.models import Dataset, DatasetSegment, DatasetStatus, ProcessingSource
from storage.models.base import Document
from storage.originals import is_left_out, rebuilt
from storage.pagination import EVERY, Narrowing, Page, paginate

#: The most bytes in one segment.
MAX_SEGMENT = 8 * 1024 * 1024


class DatasetRepository:
    """The recordings of one workspace."""

    def __init__(self, session: Session, workspace_id: str) -> None:
        self._session = session
        self._workspace_id = workspace_id

    def create(
        self,
        *,
        name: str,
        format: str,  # noqa: A002 - the contract's word
        channels: Sequence[Document] = (),
        sample_rate: float | None = None,
        start_time: datetime | None = None,
        description: Document | None = None,
        origin: Document | None = None,
    ) -> Dataset:
        """Open a recording for its segments; ``description`` tells how a file is read."""
        dataset = Dataset(
            id=new_id("ds"),
            workspace_id=self._workspace_id,
            name=name,
            format=format,
            status=DatasetStatus.OPEN,
            channels=list(channels),
            sample_rate=sample_rate,
            start_time=start_time,
            description=description,
            origin=origin,
        )
        self._session.add(dataset)
        self._session.flush()
        remember(self._session, self._workspace_id, dataset.id, sources_in(origin))
        record(self._session, self._workspace_id, "dataset.create", dataset.id)
        return dataset

    def get(self, identifier: str) -> Dataset:
        """Return a recording; raise `NotFoundError` when it is not in this workspace."""
        dataset = self._session.get(Dataset, identifier, populate_existing=True)
        if dataset is None or dataset.workspace_id != self._workspace_id:
            raise NotFoundError("dataset", identifier)
        return dataset

    def page(
        self,
        *,
        format: str | None = None,  # noqa: A002 - the contract's word
        status: str | None = None,
        narrowing: Narrowing = EVERY,
        cursor: str | None = None,
        limit: int = 100,
    ) -> Page[Dataset]:
        """Return the recordings of the workspace, newest first."""
        rows = select(Dataset).where(Dataset.workspace_id == self._workspace_id)
        if format is not None:
            rows = rows.where(Dataset.format == format)
        if status is not None:
            rows = rows.where(Dataset.status == status)
        return paginate(self._session, narrowing.of(rows, Dataset), Dataset, cursor=cursor, limit=limit)

    def newest(self, name: str) -> str | None:
        """Return the id of the recording of a name that was made last among those that are ready."""
        rows = select(Dataset.id).where(
            Dataset.workspace_id == self._workspace_id, Dataset.name == name, Dataset.status == DatasetStatus.READY
        )
        return self._session.scalar(rows.order_by(Dataset.created_at.desc(), Dataset.id.desc()).limit(1))

    def delete(self, identifier: str) -> None:
        """Forget a recording.

        Raises
        ------
        StateError
            When another one was made from it.
        """
        dataset = self.get(identifier)
        made = self._session.scalar(
            select(ProcessingSource.dataset_id).where(ProcessingSource.source_id == identifier).limit(1)
        )
        if made is not None:
            raise StateError(f"dataset {identifier!r} must outlive what was made from it: delete {made!r} first")
        size = self._session.scalar(
            select(func.sum(DatasetSegment.size)).where(DatasetSegment.dataset_id == identifier)
        )
        if dataset.manifest is None and size is None:
            size = dataset.size  # computed, not received
        self._session.delete(dataset)
        self._session.flush()
        record(self._session, self._workspace_id, "dataset.delete", identifier)
        quotas.add_bytes(self._session, self._workspace_id, -int(size or 0) - dataset.sample_bytes)

    def put_segment(self, identifier: str, sha256: str, data: bytes) -> bool:
        """Keep a segment; False when it was there already.

        Raises
        ------
        ChecksumError
            When ``data`` does not have this SHA-256; nothing is kept.
        StateError
            When the recording has been committed, or the segment is longer than `MAX_SEGMENT`.
        QuotaExceededError
            When the workspace may not store that much.
        """
        if len(data) > MAX_SEGMENT:
            raise StateError(f"a segment must be at most {MAX_SEGMENT} bytes, got {len(data)}")
        actual = sha256_of(data)
        if actual != sha256:
            raise ChecksumError("the content", expected=sha256, actual=actual)
        dataset = self.get(identifier)
        if sha256 in (dataset.manifest or ()) and is_left_out(self._session, dataset):
            return False  # it was here: whoever sends it again did not hear so
        # Compressed, and brought to where it will lie, before the first write: in SQLite everybody else waits from then on,
        # heartbeats of a rig among them.
        contents = without_those_kept(self._session, [packed(data, sha256=sha256)])
        self._lock(identifier, DatasetStatus.OPEN)
        put_packed(self._session, contents)
        new = insert_if_absent(self._session, DatasetSegment, dataset_id=identifier, sha256=sha256, size=len(data))
        if new:
            quotas.add_bytes(self._session, self._workspace_id, len(data))
        return new

    def segments(self, identifier: str, *, cursor: str | None = None, limit: int = 100) -> Page[DatasetSegment]:
        """Return the segments that are there, in the order of their arrival."""
        self.get(identifier)
        return paginate(
            self._session,
            select(DatasetSegment).where(DatasetSegment.dataset_id == identifier),
            DatasetSegment,
            cursor=cursor,
            limit=limit,
            identifier="sha256",
            oldest_first=True,
        )

    def commit(
        self, identifier: str, *, segments: Sequence[str], sha256: str, description: Document | None = None
    ) -> Dataset:
        """Close a recording: its bytes are these segments in this order; its status becomes ``parsing``.

        A repeated commit with the same manifest changes nothing, but for a file that could not be read as it was
        described: with another ``description`` it is ``parsing`` again.

        Raises
        ------
        MissingSegmentsError
            When a segment of the manifest has not been received.
        ChecksumError
            When the segments together do not have this SHA-256.
        StateError
            When the recording was committed with another manifest.
        """
        if self.get(identifier).status != DatasetStatus.OPEN:
            return self._commit_again(identifier, list(segments), sha256, description)
        # Read before the lock, which is short then: a segment never changes. In SQLite everybody else waits for it.
        size = self._checked(identifier, segments, sha256)
        dataset = self._lock(identifier, DatasetStatus.OPEN)
        dataset.manifest = list(segments)
        dataset.sha256 = sha256
        dataset.size = size
        dataset.status = DatasetStatus.PARSING
        dataset.commits += 1
        dataset.description = dataset.description if description is None else description
        self._session.flush()
        record(self._session, self._workspace_id, "dataset.commit", identifier, sha256=sha256)
        return dataset

    def _commit_again(self, identifier: str, segments: list[str], sha256: str, description: Document | None) -> Dataset:
        dataset = self.get(identifier)
        if (dataset.manifest, dataset.sha256) != (segments, sha256):
            raise StateError(f"dataset {identifier!r} must be {DatasetStatus.OPEN}, it is {dataset.status}")
        if dataset.status == DatasetStatus.FAILED and description is not None:
            dataset = self._lock(identifier, DatasetStatus.FAILED)
            dataset.status, dataset.error, dataset.description = DatasetStatus.PARSING, None, description
            dataset.commits += 1
            self._session.flush()
            record(self._session, self._workspace_id, "dataset.commit", identifier, sha256=sha256)
        return dataset

    def _checked(self, identifier: str, segments: Sequence[str], sha256: str) -> int:
        """Return the size (bytes) of the segments, which together must have this SHA-256."""
        size, pieces = self.received(identifier, segments)
        whole = hashlib.sha256()
        for piece in pieces:
            whole.update(piece)
        if whole.hexdigest() != sha256:
            raise ChecksumError(f"dataset {identifier!r}", expected=sha256, actual=whole.hexdigest())
        return size

    def sent(self, identifier: str) -> Dataset:
        """Return a recording that has a file of its own.

        Raises
        ------
        StateError
            For one that is still open, a group of another's file, or one that was computed.
        LeftOutError
            When its file was left out; raw samples are put together again.
        """
        dataset = self.get(identifier)
        if dataset.format != RAW and is_left_out(self._session, dataset):
            raise LeftOutError(identifier, dataset.sha256)
        if dataset.manifest is not None:
            return dataset
        origin = dataset.origin or {}
        if origin.get("group"):
            raise StateError(
                f"dataset {identifier!r} is one group of a file, which {origin['dataset']!r} has as its original"
            )
        if dataset.status == DatasetStatus.READY:
            raise StateError(
                f"dataset {identifier!r} was computed, not sent: it has no original, export gives its samples"
            )
        raise StateError(f"dataset {identifier!r} must be committed first, it is {dataset.status}")

    def original(self, identifier: str) -> Iterator[bytes]:
        """Give the bytes of a committed recording, as they were received, piece by piece."""
        dataset = self.sent(identifier)
        if is_left_out(self._session, dataset):
            yield from rebuilt(self._session, dataset)
            return
        for segment in dataset.manifest or ():
            yield from iterate_bytes(self._session, segment)

    def received(self, identifier: str, segments: Sequence[str]) -> tuple[int, Iterator[bytes]]:
        """Return the size (bytes) and the bytes that segments give in this order, committed or not.

        Raises
        ------
        MissingSegmentsError
            When one of them has not been received.
        """
        self.get(identifier)
        sizes = self._sizes(identifier, segments)
        pieces = (piece for segment in segments for piece in iterate_bytes(self._session, segment))
        return sum(sizes[segment] for segment in segments), pieces

    def _sizes(self, identifier: str, segments: Sequence[str]) -> dict[str, int]:
        """Return the size of every segment that is there; refuse when one of ``segments`` is not."""
        there = select(DatasetSegment.sha256, DatasetSegment.size).where(DatasetSegment.dataset_id == identifier)
        sizes = {row.sha256: row.size for row in self._session.execute(there)}
        missing = [segment for segment in dict.fromkeys(segments) if segment not in sizes]
        if missing:
            raise MissingSegmentsError(identifier, missing)
        return sizes

    def ingest_raw(
        self,
        identifier: str,
        *,
        watch: Callable[[NDArray[np.float64]], None] | None = None,
        report: Callable[[], Document] | None = None,
    ) -> Dataset:
        """Read the channels of a committed ``raw`` recording: little-endian float64, the samples of all channels in turn.

        ``watch`` sees every piece (n, channels) before ``report`` is asked.

        Raises
        ------
        StateError
            When the bytes are no whole number of samples.
        """
        dataset = self.get(identifier)
        width = 8 * len(dataset.channels)
        if not width or dataset.size is None or dataset.size % width:
            raise StateError(
                f"a raw recording of {len(dataset.channels)} channels must be whole samples of {width} bytes, "
                f"got {dataset.size} bytes"
            )
        pieces = raw_samples(self.original(identifier), len(dataset.channels))
        return self.write_channels(identifier, _watched(pieces, watch) if watch else pieces, report=report)

    def write_channels(
        self,
        identifier: str,
        blocks: Iterable[NDArray[np.float64]],
        *,
        channels: Sequence[Document] | None = None,
        sample_rate: float | None = None,
        start_time: datetime | None = None,
        report: Callable[[], Document] | None = None,
    ) -> Dataset:
        """Keep the samples (pieces of shape (n, channels)) of a committed recording and make it ``ready``.

        Values are those recorded; the scales and offsets in ``channels`` are applied by whoever reads them.
        What a file says of its channels, sample rate or start replaces what was known before; ``report`` is asked
        for what was noticed when all pieces have passed.
        """
        dataset = self._lock(identifier, DatasetStatus.PARSING)
        if channels is not None:
            dataset.channels = list(channels)
        dataset.sample_rate = sample_rate if sample_rate is not None else dataset.sample_rate
        dataset.start_time = start_time if start_time is not None else dataset.start_time
        count = write_channels(self._session, identifier, blocks, channel_count=len(dataset.channels))
        dataset.sample_count = count
        dataset.status = DatasetStatus.READY
        dataset.error = None
        dataset.report = report() if report is not None else None
        self._session.flush()
        return dataset

    def fail(self, identifier: str, error: Document) -> Dataset:
        """Say why (a problem: type, title, detail) a committed recording cannot be read."""
        dataset = self._lock(identifier, DatasetStatus.PARSING)
        dataset.status = DatasetStatus.FAILED
        dataset.error = error
        self._session.flush()
        return dataset

    def read_channel(self, identifier: str, name: str, start: int = 0, stop: int | None = None) -> Float:
        """Return the samples start <= i < stop of a channel as recorded."""
        reader, count = self._reader(identifier, name)
        return reader.samples(start, count if stop is None else stop)

    def read_decimated(
        self, identifier: str, name: str, start: int = 0, stop: int | None = None, *, points: int
    ) -> Envelope:
        """Return the exact minima and maxima of at most ``points`` stretches of a channel, as recorded."""
        reader, count = self._reader(identifier, name)
        return reader.envelope(start, count if stop is None else stop, points=points)

    def _reader(self, identifier: str, name: str) -> tuple[ChannelReader, int]:
        dataset = self.get(identifier)
        if dataset.status != DatasetStatus.READY or dataset.sample_count is None:
            raise StateError(f"dataset {identifier!r} must be ready, it is {dataset.status}")
        names: list[Any] = [channel["name"] for channel in dataset.channels]
        if name not in names:
            raise NotFoundError("channel", name)
        count = dataset.sample_count
        return ChannelReader(self._session, identifier, names.index(name), count=count), count

    def _lock(self, identifier: str, status: DatasetStatus) -> Dataset:
        """Lock the recording's row, so that nobody commits or parses it at the same time, and check its status."""
        self._session.execute(
            update(Dataset)
            .where(Dataset.id == identifier, Dataset.workspace_id == self._workspace_id)
            .values(status=Dataset.status)
            .execution_options(synchronize_session=False)
        )
        dataset = self.get(identifier)
        if dataset.status != status:
            raise StateError(f"dataset {identifier!r} must be {status}, it is {dataset.status}")
        return dataset


def _watched(
    pieces: Iterable[NDArray[np.float64]], watch: Callable[[NDArray[np.float64]], None]
) -> Iterator[NDArray[np.float64]]:
    for piece in pieces:
        watch(piece)
        yield piece


def raw_samples(pieces: Iterable[bytes], channel_count: int) -> Iterator[NDArray[np.float64]]:
    """Turn little-endian float64 bytes into blocks (n, channel_count), also where pieces cut samples apart."""
    rest = b""
    for piece in pieces:
        data = rest + piece
        whole = len(data) // (8 * channel_count) * 8 * channel_count
        rest = data[whole:]
        yield np.frombuffer(data[:whole], dtype="<f8").reshape(-1, channel_count)
