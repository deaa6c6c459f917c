"""Raw samples, little-endian float64 with all channels of a sample together: cut into channels, and looked at meanwhile.

A recording of some size is read within the request that closes it, a large one by a job, in short transactions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from api.convert.recordings import Values
from engine.recordings.signal_quality import ChannelQuality, remarks
from storage.blobs import iterate_bytes
from storage.imports import Import
from storage.models import Dataset
from storage.originals import Comparison, leave_out
from storage.repositories import DatasetRepository
from storage.repositories.datasets import raw_samples
from storage.session import Database

AT_ONCE = 64 << 20
"""The most bytes that are read within a request: about a second."""


def ingest(repository: DatasetRepository, row: Dataset) -> Dataset:
    """Read all samples at once."""
    watch = _Watch(row.channels)
    return repository.ingest_raw(row.id, watch=watch.add, report=watch.report)


def leave_out_at_once(session: Session, repository: DatasetRepository, row: Dataset) -> None:
    """Leave out the bytes of a recording that has just been read, once they are found in its channels."""
    compared = Comparison(lambda: nullcontext(session), row.id)
    _compare(compared, raw_samples(repository.original(row.id), len(row.channels)))
    if compared.same:
        leave_out(session, row.workspace_id, row.id, raw=True)


def _compare(compared: Comparison, pieces: Iterator[Values]) -> None:
    for samples in pieces:
        for channel, values in enumerate(samples.T):
            compared.add(channel, values)


def run(
    identifier: str,
    *,
    database: Database,
    workspace: str,
    progress: Callable[[float, str], None],
    leaving_out: bool = False,
) -> dict[str, Any]:
    """Read the samples of a committed recording segment by segment; return how many each channel has.

    ``leaving_out`` asks to forget the bytes once they are found in the channels.
    """
    with database.session() as session:
        row = DatasetRepository(session, workspace).get(identifier)
        channels, size, segments = row.channels, row.size or 1, list(row.manifest or ())
    watch, done = _Watch(channels), 0
    with Import(database, workspace, identifier) as writing:
        for samples in raw_samples(_pieces(database, segments), len(channels)):
            watch.add(samples)
            for channel, values in enumerate(samples.T):
                writing.add(channel, values)
            done += samples.nbytes
            progress(min(done / size, 1.0), f"{done / 1e6:.1f} of {size / 1e6:.1f} MB")
        count = writing.finish(channels=channels, report=watch.report())
    if leaving_out:
        progress(1.0, "comparing what is kept with what was sent")
        compared = Comparison(database.session, identifier)
        _compare(compared, raw_samples(_pieces(database, segments), len(channels)))
        if compared.same:
            with database.session() as session:
                leave_out(session, workspace, identifier, raw=True)
    return {"dataset": identifier, "sample_count": count}


def _pieces(database: Database, segments: Sequence[str]) -> Iterator[bytes]:
    """Give the bytes; each segment is read by itself, so that no transaction stays open while blocks are written."""
    for segment in segments:
        with database.session() as session:
            content = b"".join(iterate_bytes(session, segment))
        yield content


class _Watch:
    """What there is to notice in channels (name, unit, scale ...) while their samples pass."""

    def __init__(self, channels: Sequence[Mapping[str, Any]]) -> None:
        self._qualities = {str(channel["name"]): ChannelQuality() for channel in channels}

    def add(self, samples: Values) -> None:
        """Look at the next samples (n, channels)."""
        for quality, values in zip(self._qualities.values(), samples.T, strict=True):
            quality.add(np.ascontiguousarray(values))

    def report(self) -> dict[str, Any]:
        """Return what was noticed in each channel, and as sentences."""
        noticed = {name: quality.document() for name, quality in self._qualities.items()}
        said = [line for name, one in noticed.items() for line in remarks(name, one, self._qualities[name].count)]
        return {"channels": noticed, "remarks": said}
