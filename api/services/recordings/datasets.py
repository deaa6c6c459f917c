"""Recordings: opened, filled in verified segments, committed, read channel by channel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from api.convert.recordings import Values, envelope, in_si, physical
from api.convert.signals import Channel, ReadChannel
from api.convert.values import check_unit, numbers, si
from api.formats import FormatError
from api.problems.documents import Problem, invalid
from api.problems.pointers import Place
from api.schemas.datasets import ChannelDocument, CommitRequest, DatasetRequest, ImportDocument, PreviewRequest
from api.schemas.queue import QueueDocument
from api.services.jobs import jobs
from api.services.lineage.lineage import check_free
from api.services.operation.app_context import Caller, Installation
from api.services.recordings import raw_samples
from api.services.recordings.importing import zone_of
from api.services.recordings.instants import Instants, even_rate, uneven
from api.services.recordings.recognising import UNKNOWN, recognise
from storage.errors import NotFoundError
from storage.models import Dataset, DatasetStatus
from storage.pagination import Narrowing
from storage.repositories import DatasetRepository, ProcessingRepository
from storage.session import Database

PARSING = "dataset"
"""Kind of the job that reads a file, or many raw samples."""
PREVIEW = "preview"
"""Kind of the job that looks at a file."""
_READING_S = 3600.0


def create(session: Session, caller: Caller, request: DatasetRequest) -> dict[str, Any]:
    """Open a recording for its segments."""
    _check(request)
    document = request.model_dump(by_alias=True, exclude_unset=True, mode="json")
    described = document.get("import") or {}
    row = DatasetRepository(session, caller.workspace).create(
        name=request.name,
        format=request.format or UNKNOWN,
        channels=document.get("channels") or described.get("columns") or [],
        sample_rate=request.sample_rate or described.get("sample_rate"),
        start_time=request.start_time,
        description=document,
        origin=request.origin,
    )
    return to_wire(row)


def _check(request: DatasetRequest) -> None:
    raw = request.format == "raw"
    if raw and request.file is not None:
        raise invalid("file must be left out for the format raw", "file")
    given = {"channels": request.channels, "sample_rate": request.sample_rate, "import": request.import_}
    for name, value in given.items():
        if raw and name != "import" and value is None:
            raise invalid(f"{name} must be given for the format {request.format}", name)
        if raw == (name == "import") and value is not None:
            raise invalid(f"{name} must be left out for the format {request.format or 'of a file'}", name)
    if request.channels:
        _check_channels(request.channels, ("channels",))
    if request.import_ is not None:
        check_import(request.import_)


def check_import(document: ImportDocument) -> None:
    """Refuse an import description that no file can satisfy.

    Raises
    ------
    Problem
        422 with the place.
    """
    if document.delimiter is not None and document.delimiter == document.decimal == ".":
        raise invalid(
            f"delimiter must differ from a decimal point, got {document.delimiter!r} for both", "import", "delimiter"
        )
    handles = [(("columns", i), column.index, column.source) for i, column in enumerate(document.columns or ())]
    time = [(("time",), document.time.index, document.time.source)] if document.time else []
    for place, index, source in (*handles, *time):
        if (index is None) == (source is None):
            raise invalid("one of index and source must be given, got both or none", "import", *place, "index")
    if document.columns:
        _check_channels(document.columns, ("import", "columns"))
    if document.time is not None and document.time.unit is not None:
        si({"value": 1.0, "unit": document.time.unit}, "s", name="unit of time", place=("import", "time", "unit"))
    if document.time_zone is not None:
        try:
            zone_of(document.time_zone)
        except FormatError as error:
            raise invalid(error.message, "import", "time_zone") from error


def _check_channels(channels: Sequence[ChannelDocument], place: Place) -> None:
    seen: set[str] = set()
    for i, channel in enumerate(channels):
        if channel.name in seen:
            raise invalid(f"name must be different for each channel, got {channel.name!r} twice", *place, i, "name")
        seen.add(channel.name)
        check_unit(channel.unit, name=f"unit of {channel.name}", place=(*place, i, "unit"))
        if channel.scale == 0.0:
            raise invalid(f"scale of {channel.name} must not be 0, got 0", *place, i, "scale")


def to_wire(row: Dataset) -> dict[str, Any]:
    """Return a recording with everything that is known of it but its samples."""
    rate, count = row.sample_rate, row.sample_count
    told = ((row.report or {}).get("time") or {}).get("duration")
    return {
        **_head(row),
        "revision": revision(row),
        "document": row.description,
        "sample_rate": rate,
        "sample_count": count,
        "duration": (count - 1) / rate if count and rate else told,
        "uneven": uneven(row),
        "channels": row.channels,
        "size": row.size,
        "sha256": row.sha256,
        "error": row.error,
        "report": row.report,
        "functions": (row.report or {}).get("functions", []),
        "groups": (row.report or {}).get("groups", []),
    }


def revision(row: Dataset) -> int:
    """Return a number that grows with each change of the status: 1, 2, 3, and 4, 5 of a file that is read again."""
    if row.status == DatasetStatus.OPEN:
        return 1
    ended = row.status in {DatasetStatus.READY, DatasetStatus.FAILED}
    return 2 * max(row.commits, 1) + ended


def _head(row: Dataset) -> dict[str, Any]:
    return {
        "id": row.id,
        "name": row.name,
        "format": row.format,
        "status": row.status,
        "created_at": row.created_at.isoformat(),
        "start_time": row.start_time.isoformat() if row.start_time else None,
    }


def get(session: Session, caller: Caller, identifier: str) -> dict[str, Any]:
    """Return a recording, with how it was made where it was made from others."""
    body = to_wire(DatasetRepository(session, caller.workspace).get(identifier))
    return body | {"processing": ProcessingRepository(session, caller.workspace).described(identifier)}


def page(
    session: Session,
    caller: Caller,
    *,
    file_format: str | None,
    status: str | None,
    narrowing: Narrowing,
    cursor: str | None,
    limit: int,
) -> dict[str, Any]:
    """Return one page of the recordings, newest first."""
    found = DatasetRepository(session, caller.workspace).page(
        format=file_format, status=status, narrowing=narrowing, cursor=cursor, limit=limit
    )
    return {"items": [_head(row) for row in found.items], "next_cursor": found.next_cursor}


def delete(session: Session, caller: Caller, identifier: str, *, expected_revision: int, force: bool = False) -> None:
    """Forget a recording, unless something depends on it."""
    repository = DatasetRepository(session, caller.workspace)
    actual = revision(repository.get(identifier))
    if actual != expected_revision:
        raise Problem(412, "revision-conflict", f"revision of {identifier!r} must be {actual}, got {expected_revision}")
    check_free(session, caller, identifier, force=force)
    repository.delete(identifier)


def put_segment(session: Session, caller: Caller, identifier: str, sha256: str, data: bytes) -> bool:
    """Keep a segment; return whether it is new."""
    if not data:
        raise invalid("a segment must hold at least one byte, got none")
    repository = DatasetRepository(session, caller.workspace)
    row = repository.get(identifier)
    if row.format == "raw" and len(data) % (8 * len(row.channels)):
        raise invalid(
            f"a segment must hold whole samples of {len(row.channels)} channels x 8 bytes, got {len(data)} bytes"
        )
    return repository.put_segment(identifier, sha256, data)


def segments(session: Session, caller: Caller, identifier: str, *, cursor: str | None, limit: int) -> dict[str, Any]:
    """Return one page of the segments that are there."""
    found = DatasetRepository(session, caller.workspace).segments(identifier, cursor=cursor, limit=limit)
    items = [{"sha256": row.sha256, "size": row.size} for row in found.items]
    return {"items": items, "next_cursor": found.next_cursor}


@dataclass(frozen=True, slots=True, kw_only=True)
class Committed:
    """A committed recording, and the job that reads it where it is a file or large."""

    dataset: dict[str, Any]
    job: dict[str, Any] | None


def commit(
    service: Installation, session: Session, caller: Caller, identifier: str, request: CommitRequest
) -> Committed:
    """Close a recording: raw samples are ready at once unless they are many; those, and files, are read by a job."""
    repository = DatasetRepository(session, caller.workspace)
    before = repository.get(identifier)
    recognise(repository, before, request.segments)
    status, description = before.status, None
    if request.import_ is not None:
        if before.format == "raw":
            raise invalid("import must be left out for the format raw", "import")
        check_import(request.import_)
        described = request.import_.model_dump(by_alias=True, exclude_unset=True, mode="json")
        description = {**(before.description or {}), "import": described}
    row = repository.commit(identifier, segments=request.segments, sha256=request.sha256, description=description)
    if row.status != DatasetStatus.PARSING or status == DatasetStatus.PARSING:
        return Committed(dataset=to_wire(row), job=None)
    if row.format == "raw" and (row.size or 0) <= raw_samples.AT_ONCE:
        row = raw_samples.ingest(repository, row)
        if service.settings.keep_originals == "until-verified":
            raw_samples.leave_out_at_once(session, repository, row)
        return Committed(dataset=to_wire(row), job=None)
    job = jobs.enqueue(
        service, session, caller, kind=PARSING, body={"dataset": identifier}, queue=_in_time(request.queue)
    )
    row.job_id = job["id"]
    session.flush()
    return Committed(dataset=to_wire(row), job=job)


def _in_time(queue: QueueDocument | None) -> QueueDocument:
    """Let a job that reads a file end within an hour unless its user says otherwise: nobody knows what a file makes its reader do."""
    asked = queue or QueueDocument()
    return asked if asked.time_limit is not None else asked.model_copy(update={"time_limit": _READING_S})


def preview(
    service: Installation, session: Session, caller: Caller, identifier: str, request: PreviewRequest
) -> dict[str, Any]:
    """Let a worker look at a file that need not be committed yet, and propose how it is read."""
    repository = DatasetRepository(session, caller.workspace)
    row = repository.get(identifier)
    if row.format == "raw":
        raise Problem(409, "conflict", f"dataset {identifier!r} must be a file to be looked at, it is raw")
    repository.received(identifier, request.segments)
    recognise(repository, row, request.segments)
    given = row.description.get("import") if row.description else None
    if request.import_ is not None:
        check_import(request.import_)
        given = request.import_.model_dump(by_alias=True, exclude_unset=True, mode="json")
    body = {"dataset": identifier, "segments": request.segments, "import": given}
    job = jobs.enqueue(service, session, caller, kind=PREVIEW, body=body, queue=_in_time(request.queue))
    return {"dataset": identifier, "job": job}


def original(service: Installation, caller: Caller, identifier: str) -> Iterator[bytes]:
    """Give the bytes as they were received, piece by piece."""
    with service.database.session() as session:
        yield from DatasetRepository(session, caller.workspace).original(identifier)


def check_committed(session: Session, caller: Caller, identifier: str) -> int:
    """Return the size in bytes of a recording that has a file, 409 for one that has none (yet)."""
    return DatasetRepository(session, caller.workspace).sent(identifier).size or 0


def channel(
    service: Installation,
    caller: Caller,
    identifier: str,
    name: str,
    *,
    start: float | None,
    end: float | None,
    points: int | None,
) -> dict[str, Any]:
    """Return a stretch of a channel in its unit: every sample, or minimum and maximum of at most ``points`` stretches."""
    with service.database.session() as session:
        repository = DatasetRepository(session, caller.workspace)
        row = repository.get(identifier)
        described = channel_of(row, name)
        instants = Instants(repository=repository, row=row)
        first, stop = instants.stretch(start, end)
        count = stop - first
        if points is not None and count > points:
            found = repository.read_decimated(identifier, name, first, stop, points=points)
            low, high = envelope(found.minimum, found.maximum, described)
            curves = {"time": numbers(instants.of(found.index)), "min": numbers(low), "max": numbers(high)}
        else:
            limit = service.settings.max_numbers
            if count > limit:
                raise invalid(f"points must be given for more than {limit} samples, got {count}")
            values = physical(repository.read_channel(identifier, name, first, stop), described)
            curves = {"time": numbers(instants.at(first, stop)), "values": numbers(values)}
    return {"unit": described.get("unit", ""), "sample_rate": row.sample_rate, **curves}


def check_ready(row: Dataset) -> None:
    """Refuse a recording whose samples are not there yet, or that has none, with 409."""
    if row.status != DatasetStatus.READY:
        raise Problem(409, "conflict", f"dataset {row.id!r} must be ready, it is {row.status}")
    if not row.channels:
        remedy = "POST /v1/frfs with the estimator measured takes its responses"
        detail = f"dataset {row.id!r} must have channels, it has functions of frequency alone: {remedy}"
        raise Problem(409, "conflict", detail)


def channel_of(row: Dataset, name: str) -> Mapping[str, Any]:
    """Return what is known of a channel; 404 for one that is not there, 409 while the recording is not ready."""
    check_ready(row)
    for described in row.channels:
        if described["name"] == name:
            found: Mapping[str, Any] = described
            return found
    raise NotFoundError("channel", name)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Channels of one dataset in SI."""

    sample_time: float
    channels: Mapping[str, Values]
    units: Mapping[str, str]

    @property
    def length(self) -> float:
        """Time from the first to the last sample, s."""
        return self.sample_time * (next(iter(self.channels.values())).size - 1)


def read_recording(
    database: Database, workspace: str, identifier: str, names: Mapping[Place, str], *, place: Place = ("dataset",)
) -> Recording:
    """Return channels of a dataset in SI.

    Parameters
    ----------
    names : mapping
        Place in the request -> name of a channel.

    Raises
    ------
    Problem
        422 with the place for a dataset or channel that does not exist or has missing samples, 409 for one not ready.
    """
    with database.session() as session:
        repository = DatasetRepository(session, workspace)
        row = _existing(repository, identifier, place)
        rate = even_rate(row, *place)
        values, units = _in_si(repository, row, names)
    return Recording(sample_time=1.0 / rate, channels=values, units=units)


def _existing(repository: DatasetRepository, identifier: str, place: Place) -> Dataset:
    try:
        return repository.get(identifier)
    except NotFoundError as error:
        raise invalid(f"dataset must be one that exists, got {identifier!r}", *place) from error


def _in_si(
    repository: DatasetRepository, row: Dataset, names: Mapping[Place, str]
) -> tuple[dict[str, Values], dict[str, str]]:
    """Return channels in SI, none of whose samples are missing, with their units."""
    values: dict[str, Values] = {}
    units: dict[str, str] = {}
    for where, name in names.items():
        try:
            described = channel_of(row, name)
            raw = repository.read_channel(row.id, name)
        except NotFoundError as error:
            known = ", ".join(str(entry["name"]) for entry in row.channels)
            raise invalid(f"channel must be one of the dataset's ({known}), got {name!r}", *where) from error
        values[name], units[name] = in_si(raw, described, place=where)
        if not np.all(np.isfinite(values[name])):
            missing = int(np.sum(~np.isfinite(values[name])))
            remedy = "cut or fill them in a processing, or resample with a larger longest where gaps are to be bridged"
            raise invalid(
                f"channel {name!r} must have no missing samples to be used here, got {missing}: {remedy}", *where
            )
        if values[name].size < 2:
            raise invalid(f"channel {name!r} must have at least 2 samples, got {values[name].size}", *where)
    return values, units


def channel_reader(service: Installation, caller: Caller) -> ReadChannel:
    """Return the function that reads the channel a sampled signal names."""
    return reader_of(service.database, caller.workspace)


def reader_of(database: Database, workspace: str) -> ReadChannel:
    """Return the function that reads the channel a sampled signal names, in one workspace."""

    def read(dataset: str, name: str, place: Place) -> Channel:
        with database.session() as session:
            repository = DatasetRepository(session, workspace)
            row = _existing(repository, dataset, (*place, "dataset"))
            values, _ = _in_si(repository, row, {(*place, "channel"): name})
            time = Instants(repository=repository, row=row).at(0, values[name].size)
        return time, values[name]

    return read
