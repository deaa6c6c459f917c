"""Processed recordings: made from others step by step, at once where they are short, by a worker where they are long."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import Any

import numpy as np
from sqlalchemy.orm import Session

from api.convert.processing import described, steps_from_wire
from api.convert.recordings import physical
from api.problems.documents import at, invalid
from api.schemas.processing import ProcessingRequest, ResampleStep
from api.services.jobs import jobs
from api.services.operation.app_context import Caller, Installation
from api.services.recordings.datasets import check_ready, to_wire
from api.services.recordings.instants import Instants, even_rate
from api.services.studies.results import versions
from engine.recordings.processing.cut import Cut
from engine.recordings.processing.merge import Merged, appended, side_by_side
from engine.recordings.processing.record import Record, Step, process
from engine.recordings.processing.resample import Resample
from storage.errors import NotFoundError
from storage.imports import Import
from storage.models import Dataset
from storage.repositories import DatasetRepository, ProcessingRepository
from storage.session import Database

KIND = "processing"
_AT_ONCE = 2_000_000
"""Numbers (samples of all sources and channels) that are processed inside a request: a second or two."""

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Started:
    """A processed recording, and the job that computes it where it is long."""

    dataset: dict[str, Any]
    job: dict[str, Any] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Computed:
    merged: Merged
    channels: list[dict[str, Any]]


def submit(service: Installation, session: Session, caller: Caller, request: ProcessingRequest) -> Started:
    """Make a recording from others, in the caller's transaction.

    Raises
    ------
    Problem
        422 with the place of a step that makes no sense, of a source that does not exist; 409 for one that is not ready.
    """
    steps = steps_from_wire(request)
    sources = _sources(session, caller.workspace, request)
    numbers = sum((row.sample_count or 0) * len(row.channels) for row in sources)
    computed = None
    if numbers <= _AT_ONCE:
        computed = service.computing.bounded(lambda: _compute(session, caller.workspace, request, steps, sources))
    repository = ProcessingRepository(session, caller.workspace)
    asked = request.model_dump(by_alias=True, exclude_unset=True, mode="json", exclude={"queue"})
    row = repository.create(
        name=request.name,
        sources=request.sources,
        steps=[step.model_dump(by_alias=True, exclude_unset=True, mode="json") for step in request.steps],
        combine=request.combine if len(sources) > 1 else None,
        description=asked,
        versions=versions(),
        start_time=sources[0].start_time,
    )
    if computed is None:
        body = {"request": asked, "dataset": row.id}
        job = jobs.enqueue(service, session, caller, kind=KIND, body=body, queue=request.queue)
        repository.assign(row.id, job["id"])
        return Started(dataset=to_wire(row), job=job)
    record = computed.merged.record
    samples = np.stack(list(record.channels.values()), axis=1)
    DatasetRepository(session, caller.workspace).write_channels(
        row.id,
        [samples],
        channels=computed.channels,
        sample_rate=record.rate,
        start_time=_start(sources[0], record),
    )
    repository.computed(row.id, experiments=computed.merged.experiments, size=samples.nbytes)
    session.refresh(row)
    return Started(dataset=to_wire(row), job=None)


def run(body: Mapping[str, Any], *, database: Database, workspace: str, progress: Progress) -> dict[str, Any]:
    """Compute a long processing (in a worker).

    Raises
    ------
    Problem
        422 that says which step cannot be done; the recording is ``failed`` then.
    """
    request = ProcessingRequest.model_validate(body["request"])
    identifier = str(body["dataset"])
    progress(0.0, "reads the sources")
    with database.session() as session:
        sources = _sources(session, workspace, request)
        computed = _compute(session, workspace, request, steps_from_wire(request), sources)
        first = sources[0]
        session.expunge_all()
    record = computed.merged.record
    progress(0.5, f"keeps {record.samples} samples of {len(record.channels)} channels")
    with database.session() as session:
        size = 8 * record.samples * len(record.channels)
        repository = ProcessingRepository(session, workspace)
        repository.computed(identifier, experiments=computed.merged.experiments, size=size)
    with Import(database, workspace, identifier) as target:
        for number, values in enumerate(record.channels.values()):
            target.add(number, values)
        target.finish(channels=computed.channels, sample_rate=record.rate, start_time=_start(first, record), report={})
    return {"dataset": identifier, "sample_count": record.samples}


def _sources(session: Session, workspace: str, request: ProcessingRequest) -> list[Dataset]:
    repository = DatasetRepository(session, workspace)
    rows = []
    for number, identifier in enumerate(request.sources):
        try:
            row = repository.get(identifier)
        except NotFoundError as error:
            detail = f"source must be a dataset that exists, got {identifier!r}"
            raise invalid(detail, "sources", number) from error
        check_ready(row)
        first = request.steps[0] if request.steps else None
        if not isinstance(first, ResampleStep):
            even_rate(row, "sources", number, what="source")
        rows.append(row)
    return rows


def _compute(
    session: Session, workspace: str, request: ProcessingRequest, steps: Sequence[Step], sources: Sequence[Dataset]
) -> _Computed:
    """Return the processed samples of all sources as one record."""
    processed: list[Record] = []
    for row in sources:
        experiments, done = _experiments(session, workspace, row, steps)
        if request.combine == "side_by_side" and len(sources) > 1 and len(experiments) > 1:
            detail = f"sources must be single experiments to be put side by side, {row.id!r} holds {len(experiments)}"
            raise invalid(detail, "combine")
        with at():
            processed += [process(record, steps[done:], first=done) for record in experiments]
    with at():
        merged = side_by_side(processed) if request.combine == "side_by_side" else appended(processed)
    known = {channel["name"]: channel for row in sources for channel in row.channels}
    return _Computed(merged=merged, channels=described(merged.record, known))


def _experiments(session: Session, workspace: str, row: Dataset, steps: Sequence[Step]) -> tuple[list[Record], int]:
    """Return the calibrated experiments of a recording, and how many steps reading has done: a cut only reads less."""
    assert row.sample_count is not None
    if row.sample_rate is None:
        resample = steps[0]
        assert isinstance(resample, Resample)
        read = _read(session, workspace, row, 0, row.sample_count)
        time = Instants(repository=DatasetRepository(session, workspace), row=row).at(0, row.sample_count)
        instants = str(row.channels[0]["name"])
        channels = {name: values for name, values in read.channels.items() if name != instants}
        with at("steps", 0):
            return [resample.evened(time, channels, read.units)], 1
    counts = ProcessingRepository(session, workspace).experiments(row.id) or (row.sample_count,)
    ends = np.cumsum(counts)
    spans = [(int(end) - count, int(end)) for end, count in zip(ends, counts, strict=True)]
    done, begin = 0, 0.0
    if len(spans) == 1 and steps and isinstance(steps[0], Cut):
        with at("steps", 0):
            first, stop = steps[0].span(row.sample_count, row.sample_rate)
        spans, done, begin = [(first, stop)], 1, first / row.sample_rate
    return [replace(_read(session, workspace, row, *span), begin=begin) for span in spans], done


def _read(session: Session, workspace: str, row: Dataset, first: int, stop: int) -> Record:
    repository = DatasetRepository(session, workspace)
    channels = {
        channel["name"]: physical(repository.read_channel(row.id, channel["name"], first, stop), channel)
        for channel in row.channels
    }
    units = {channel["name"]: str(channel.get("unit", "")) for channel in row.channels}
    return Record(rate=float(row.sample_rate or 1.0), channels=channels, units=units)


def _start(source: Dataset, record: Record) -> Any:
    return None if source.start_time is None else source.start_time + timedelta(seconds=record.begin)
