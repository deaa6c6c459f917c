"""Brings the samples of a file into its dataset, in transactions so short that nobody else has to wait for them.

The dataset shows nothing of it until the last of them. An import that is overtaken (its job was cancelled, or another
worker began the job again) finds that out at its next transaction and stops; what it has written is replaced or swept.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import datetime
from types import TracebackType
from typing import Any, Self

from sqlalchemy import CursorResult, Select, delete, select, update
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.blobs import Packed, brought, packed
from storage.channels import BATCH, ChannelCutter, Float, write_blocks
from storage.errors import StateError
from storage.ids import new_id
from storage.lineage import remember
from storage.models import ChannelBlock, Dataset, DatasetStatus
from storage.models.base import Document
from storage.session import Database

RAW = "raw"
"""The format of samples that are received as such."""
PROCESSED = "processed"
"""The format of recordings that were made from others."""

#: Threads that compress, and bring blocks to the object store; both compression and checksum leave the interpreter to others.
_THREADS = 2


class Import:
    """The samples of a committed file on their way into the database.

    Use it as a context manager: `add` the samples of each channel in order, then `finish` with what is known of them.

    Parameters
    ----------
    database : Database
    workspace_id, identifier : str
        The dataset, whose status must be ``parsing``.

    Raises
    ------
    StateError
        When it is not; also from `add` and `finish`, once the import is overtaken.
    QuotaExceededError
        From `add` and `finish`, when the workspace may not store so many samples beside the file itself.
    """

    def __init__(self, database: Database, workspace_id: str, identifier: str) -> None:
        self._database = database
        self._workspace_id = workspace_id
        self._identifier = identifier
        self._token = new_id("imp")
        self._cutters: dict[int, ChannelCutter] = {}
        self._waiting: deque[tuple[dict[str, Any], Future[Packed]]] = deque()
        self._counted = False
        self._ending: dict[str, Any] = {}
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="compress")
        with database.session() as session:
            self._claim(session, DatasetStatus.PARSING, writer=self._token)
            session.execute(delete(ChannelBlock).where(ChannelBlock.dataset_id == identifier))
            # raw samples are what was received, and counted as such
            self._counted = session.get_one(Dataset, identifier).format != RAW

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pool.shutdown(cancel_futures=True)

    def add(self, channel: int, samples: Float) -> None:
        """Append samples (n,) to a channel."""
        if channel not in self._cutters:
            self._cutters[channel] = ChannelCutter(channel, self._put)
        self._cutters[channel].add(samples)

    @property
    def _bytes(self) -> int:
        """What the samples until now add to what is stored."""
        return 8 * sum(self.counts.values()) if self._counted else 0

    @property
    def counts(self) -> dict[int, int]:
        """How many samples each channel has by now."""
        return {channel: cutter.count for channel, cutter in self._cutters.items()}

    def prepare(
        self,
        *,
        channels: Sequence[Document],
        report: Document,
        sample_rate: float | None = None,
        start_time: datetime | None = None,
        uneven: bool = False,
    ) -> int:
        """Write what is left, say what the dataset will be, and return how many samples each channel has, 0 without any.

        A sample rate or a start that a file tells replaces what was known before; where the samples are ``uneven`` there
        is no rate, and the first channel holds their instants.

        Raises
        ------
        ValueError
            When the channels are not as many as were written, or not of one length.
        """
        for cutter in self._cutters.values():
            cutter.close()
        while self._waiting:
            self._write()
        counts = set(self.counts.values()) if channels else {0}
        if len(counts) != 1 or len(self._cutters) != len(channels):
            raise ValueError(f"channels must be {len(channels)} of one length, got {self.counts}")
        (count,) = counts
        values: dict[str, Any] = {
            "channels": list(channels),
            "sample_count": count,
            "sample_bytes": self._bytes,
            "report": report,
            "error": None,
            "writer": None,
        }
        told = {"sample_rate": sample_rate, "start_time": start_time}
        values |= {name: value for name, value in told.items() if value is not None}
        if uneven:
            values["sample_rate"] = None
        self._ending = values
        return count

    def finish(self, **known: Any) -> int:
        """Make the dataset ``ready`` as `prepare` describes it."""
        count = self.prepare(**known)
        publish([self])
        return count

    def _publish(self, session: Session) -> None:
        self._claim(session, DatasetStatus.READY, held_by=self._token, **self._ending)
        quotas.add_bytes(session, self._workspace_id, self._bytes)

    def _put(self, channel: int, level: int, number: int, cells: Float) -> None:
        place = {"dataset_id": self._identifier, "channel": channel, "level": level, "number": number}
        self._waiting.append((place, self._pool.submit(self._packed, cells.tobytes())))
        if len(self._waiting) >= 2 * BATCH:
            self._write()

    def _write(self) -> None:
        """Write the oldest blocks that wait."""
        batch = [self._waiting.popleft() for _ in range(min(BATCH, len(self._waiting)))]
        contents = [content.result() for _, content in batch]
        with self._database.session() as session:
            self._claim(session, DatasetStatus.PARSING, held_by=self._token)
            quotas.check_bytes(session, self._workspace_id, self._bytes)
            write_blocks(session, [(place, content.result()) for place, content in batch], contents)

    def _packed(self, samples: bytes) -> Packed:
        (content,) = brought(self._database.objects, [packed(samples, itemsize=8)])
        return content

    def _claim(self, session: Session, status: DatasetStatus, *, held_by: str | None = None, **values: Any) -> None:
        """Write to the dataset's row, which locks it; refuse when it is not (or no longer) this import's."""
        mine = update(Dataset).where(
            Dataset.id == self._identifier,
            Dataset.workspace_id == self._workspace_id,
            Dataset.status == DatasetStatus.PARSING,
        )
        if held_by is not None:
            mine = mine.where(Dataset.writer == held_by)
        done = session.execute(mine.values(status=status, **values).execution_options(synchronize_session=False))
        assert isinstance(done, CursorResult)
        if not done.rowcount:
            raise StateError(f"dataset {self._identifier!r} must be parsing and in the hands of this import")


def publish(imports: Sequence[Import]) -> None:
    """Make prepared datasets of one database ``ready`` together, or none of them."""
    with imports[0]._database.session() as session:  # noqa: SLF001 - a function of the class, for several
        for one in imports:
            one._publish(session)  # noqa: SLF001 - as above


def open_groups(
    database: Database, workspace_id: str, identifier: str, groups: Mapping[str, Document]
) -> dict[str, str]:
    """Open a recording for each further group of a file (name -> its import description), and return their ids.

    They are ``parsing`` as long as their file is, and made from it. Those of an earlier attempt at the file go.
    """
    with database.session() as session:
        file = session.get_one(Dataset, identifier)
        for row in session.scalars(_groups(file.job_id).where(Dataset.status == DatasetStatus.PARSING)).all():
            session.delete(row)
        made = {}
        for name, described in groups.items():
            opened = Dataset(
                id=new_id("ds"),
                workspace_id=workspace_id,
                name=f"{file.name[:120]}: {name[:78]}",
                format=file.format,
                status=DatasetStatus.PARSING,
                channels=[],
                start_time=file.start_time,
                description={"name": file.name, "format": file.format, "import": described},
                origin={"dataset": identifier, "group": name},
                job_id=file.job_id,
            )
            session.add(opened)
            session.flush()
            remember(session, workspace_id, opened.id, [identifier])
            record(session, workspace_id, "dataset.create", opened.id)
            made[name] = opened.id
    return made


def _groups(job_id: str | None) -> Select[Dataset]:
    """Return the further groups of the file that a job reads: recordings that it opened and nobody sent."""
    return select(Dataset).where(Dataset.job_id == job_id, Dataset.manifest.is_(None), Dataset.format != PROCESSED)


def abandon(session: Session, job_id: str, error: Document) -> None:
    """Say that the dataset whose file a job was to read cannot be read, and forget its further groups; nothing happens for a job of another kind."""
    for row in session.scalars(_groups(job_id).where(Dataset.status == DatasetStatus.PARSING)).all():
        session.delete(row)
    session.flush()
    failed = (
        update(Dataset)
        .where(Dataset.job_id == job_id, Dataset.status == DatasetStatus.PARSING)
        .values(status=DatasetStatus.FAILED, error=error, writer=None)
        .returning(Dataset.id)
    )
    for identifier in session.scalars(failed.execution_options(synchronize_session=False)).all():
        session.execute(delete(ChannelBlock).where(ChannelBlock.dataset_id == identifier))
