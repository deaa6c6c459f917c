"""Recordings as files of other programs: calibrated samples of all or some channels, streamed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from api.convert.recordings import physical
from api.formats import FormatError, Values
from api.formats.writing import Column, Outgoing, hdf5, mat, parquet, text
from api.problems.documents import invalid
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import channel_of, check_ready
from api.services.recordings.instants import Instants, uneven
from storage.repositories import DatasetRepository

WRITERS: Mapping[str, tuple[Callable[[Outgoing], Iterator[bytes]], str, str]] = MappingProxyType(
    {
        "csv": (text.write, "text/csv", "csv"),
        "mat": (mat.write, "application/x-matlab-data", "mat"),
        "parquet": (parquet.write, "application/vnd.apache.parquet", "parquet"),
        "hdf5": (hdf5.write, "application/x-hdf5", "h5"),
    }
)
"""Format -> how it is written, its media type and the ending of its name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """A file on its way: its bytes, media type and name."""

    pieces: Iterator[bytes]
    media_type: str
    filename: str


def export(
    service: Installation,
    caller: Caller,
    identifier: str,
    *,
    format_: str,
    channels: Sequence[str] | None,
    start: float | None,
    end: float | None,
) -> Export:
    """Return a recording as a file.

    Raises
    ------
    Problem
        404 for a channel that is not there, 409 for a recording that is not ready, 422 for a stretch without samples or
        one that the format cannot hold.
    """
    with service.database.session() as session:
        row = DatasetRepository(session, caller.workspace).get(identifier)
        check_ready(row)
        all_names = [str(channel["name"]) for channel in row.channels]
        # uneven instants leave as the time of the file, which every format has
        names = list(channels or dict.fromkeys(all_names[1:] if uneven(row) else all_names))
        described = [channel_of(row, name) for name in names]
        found = Instants(repository=DatasetRepository(session, caller.workspace), row=row)
        first, stop = found.stretch(start, end)
    where = {i: (name, one) for i, (name, one) in enumerate(zip(names, described, strict=True))}

    def read(channel: int, begin: int, until: int) -> Values:
        # a transaction for each piece, so that a slow reader holds none
        name, one = where[channel]
        with service.database.session() as session:
            raw = DatasetRepository(session, caller.workspace).read_channel(
                identifier, name, first + begin, first + until
            )
        return physical(raw, one)

    def instants(begin: int, until: int) -> Values:
        with service.database.session() as session:
            repository = DatasetRepository(session, caller.workspace)
            found = Instants(repository=repository, row=repository.get(identifier))
            return found.at(first + begin, first + until)

    outgoing = Outgoing(
        name=row.name,
        columns=[
            Column(name=name, unit=str(one.get("unit", "")), quantity=str(one.get("quantity", "")))
            for name, one in where.values()
        ],
        sample_rate=row.sample_rate,
        instants=instants,
        start_time=row.start_time.isoformat() if row.start_time else "",
        count=stop - first,
        read=read,
    )
    if where and outgoing.count:
        read(0, 0, 1)  # samples that cannot be read are told before the reply begins
    write, media_type, ending = WRITERS[format_]
    try:
        pieces = begun(write(outgoing))
    except FormatError as error:
        raise invalid(error.message, "format") from error
    return Export(pieces=pieces, media_type=media_type, filename=f"{identifier}.{ending}")


def begun(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Take the first piece, so that what cannot be written is refused before the reply begins."""
    first = next(pieces)

    def whole() -> Iterator[bytes]:
        yield first
        yield from pieces

    return whole()
