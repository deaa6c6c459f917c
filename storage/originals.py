"""Leaves out the original of a recording whose channels hold all that was in it.

What was read from the original once is read from it again, compared with what is kept, sample by sample and bit by bit, and only then are
the bytes forgotten; the recording goes on to know their SHA-256, size and segments. Raw samples are put together again from the channels
whenever somebody asks for what was sent: nothing else was in it. Blobs that nobody needs any more go with the
hourly sweep, so that an original which several recordings share stays until the last of them is done with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import delete, exists, func, select
from sqlalchemy.orm import Session

from storage import quotas
from storage.audit import record
from storage.channels import BLOCK, ChannelReader
from storage.models import Dataset, DatasetSegment, DatasetStatus


class Comparison:
    """Takes the samples of each channel in order, as an import does, and compares them with those that are kept.

    Parameters
    ----------
    session : callable
        Opens a session, for as long as one piece is compared.
    identifier : str
        The recording, which must be ``ready``.
    """

    def __init__(self, session: Callable[[], AbstractContextManager[Session]], identifier: str) -> None:
        self._session = session
        self._identifier = identifier
        with session() as opened:
            row = opened.get_one(Dataset, identifier, populate_existing=True)
            self._count = row.sample_count or 0
            self._counts = dict.fromkeys(range(len(row.channels)), 0)
        self._same = True

    def add(self, channel: int, samples: NDArray[np.float64]) -> None:
        """Compare the next samples (n,) of a channel."""
        start = self._counts.get(channel, self._count)
        stop = start + samples.size
        if not self._same or stop > self._count:
            self._same = False
            return
        with self._session() as session:
            kept = ChannelReader(session, self._identifier, channel, count=self._count).samples(start, stop)
        self._counts[channel] = stop
        # as bits: a missing sample is the same as itself, and -0 is not 0
        self._same = kept.tobytes() == np.ascontiguousarray(samples, dtype=np.float64).tobytes()

    @property
    def same(self) -> bool:
        """Whether all samples of all channels have come by, and each was the one that is kept."""
        return self._same and set(self._counts.values()) == {self._count}


def rebuilt(session: Session, dataset: Dataset) -> Iterator[bytes]:
    """Give the bytes that raw samples were sent as, from the channels of the recording."""
    count = dataset.sample_count or 0
    readers = [ChannelReader(session, dataset.id, channel, count=count) for channel in range(len(dataset.channels))]
    for start in range(0, count, BLOCK):
        stop = min(start + BLOCK, count)
        yield np.column_stack([reader.samples(start, stop) for reader in readers]).astype("<f8").tobytes()


def is_left_out(session: Session, dataset: Dataset) -> bool:
    """Return whether the bytes of a recording that was sent are not kept any more."""
    there = exists().where(DatasetSegment.dataset_id == dataset.id)
    return bool(dataset.manifest) and dataset.status == DatasetStatus.READY and not session.scalar(select(there))


def leave_out(session: Session, workspace_id: str, identifier: str, *, raw: bool) -> None:
    """Forget the bytes of a recording that a `Comparison` found in its channels.

    ``raw`` says that its samples were counted as the bytes that were received; from now on they are counted as samples.
    """
    dataset = session.get(Dataset, identifier, populate_existing=True, with_for_update=True)
    if dataset is None:
        return  # somebody has deleted it meanwhile
    of_it = DatasetSegment.dataset_id == identifier
    size = session.scalar(select(func.sum(DatasetSegment.size)).where(of_it)) or 0
    session.execute(delete(DatasetSegment).where(of_it))
    samples = 8 * (dataset.sample_count or 0) * len(dataset.channels) if raw else 0
    dataset.sample_bytes += samples
    session.flush()
    record(session, workspace_id, "dataset.leave-out", identifier, sha256=dataset.sha256)
    quotas.add_bytes(session, workspace_id, samples - int(size))
