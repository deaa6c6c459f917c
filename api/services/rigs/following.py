"""What follows a recording by itself: the mean of its repetitions, an identification, a validation of what was found."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Iterator, Mapping
from datetime import timedelta
from typing import Any

import numpy as np
import numpy.typing as npt
from sqlalchemy.orm import Session

from api.problems.documents import invalid
from api.problems.exceptions import KNOWN, problem_of
from api.schemas.datasets import DatasetRequest
from api.services.operation.app_context import Caller, Installation
from api.services.recordings import datasets
from api.services.rigs.agents import LEASE
from api.services.schedules import scheduled
from storage.clock import jumps
from storage.errors import UNAVAILABLE
from storage.models import AcquisitionAttempt, FollowUp, Job, JobStatus
from storage.repositories import DatasetRepository, ResultRepository, follow_ups
from storage.repositories.acquisitions import end_leases, renew_leases
from storage.repositories.datasets import MAX_SEGMENT

_BATCH = 20
_log = logging.getLogger(__name__)


def look_after(service: Installation) -> int:
    """End leases that are over, begin the steps that can begin; return how many of all those there were.

    Raises
    ------
    storage.errors.UNAVAILABLE
        When the database does not answer.
    """
    with service.database.session() as session:
        now = renew_leases(session, lease=LEASE)
    with service.database.session() as session:
        jumps(session).note(now)
        count = end_leases(session)
    with service.database.session() as session:
        over = follow_ups.ended(session, limit=_BATCH)
        for step, job in over:
            _take_result(session, step, job)
    with service.database.session() as session:
        ready = follow_ups.ready(session, limit=_BATCH)
    for step, attempt, workspace in ready:
        _begin(service, step, attempt, workspace)
    return count + len(over) + len(ready)


def _take_result(session: Session, step: FollowUp, job: Job) -> None:
    if job.status != JobStatus.SUCCEEDED or job.result_id is None:
        detail = (job.error or {}).get("detail", f"job {job.id} was {job.status}")
        follow_ups.move(session, step, came_from="running", status="failed", detail=str(detail))
        return
    results = ResultRepository(session, job.workspace_id)
    body = results.body(results.get(job.result_id))
    told = _essence(step.kind, body)
    failed = told.get("verdict") == "fail"
    follow_ups.move(
        session,
        step,
        came_from="running",
        status="failed" if failed else "done",
        result=told,
        detail="the model must reproduce the recording within its limit, it does not" if failed else None,
    )


def _essence(kind: str, body: Mapping[str, Any]) -> dict[str, Any]:
    """Return of a result what the next step needs and a user wants to see first."""
    if kind == "identification":
        found = body["parameters"]
        return {"parameters": {name: entry["value"] for name, entry in found.items()}, "offsets": body.get("offsets")}
    errors = {name: entry["relative_error_percent"] for name, entry in body.get("outputs", {}).items()}
    return {"verdict": body.get("verdict"), "relative_error_percent": errors}


def _begin(service: Installation, step: FollowUp, attempt: AcquisitionAttempt, workspace: str) -> None:
    caller = Caller(principal=attempt.acquisition_id, workspace=workspace, scopes=frozenset({"run", "write"}))
    try:
        if step.kind == "average":
            with service.database.session() as session:
                if follow_ups.move(session, step, came_from="waiting", status="running"):
                    dataset = _average(session, caller, attempt)
                    follow_ups.move(session, step, came_from="running", status="done", result={"dataset": dataset})
            return
        with service.database.session() as session:
            body = _body(session, step, attempt)
        submit = scheduled.prepare(service, caller, step.kind, body)
        with service.database.session() as session:
            if follow_ups.move(session, step, came_from="waiting", status="running"):
                follow_ups.set_job(session, step, submit(session))
    except UNAVAILABLE:
        raise
    except KNOWN as error:
        problem = problem_of(error)
        assert problem is not None
        with service.database.session() as session:
            follow_ups.move(session, step, came_from="waiting", status="failed", detail=problem.detail)
    except Exception:  # noqa: BLE001 - what is wrong with one step must not stop all the others
        _log.exception("step %s of %s cannot begin", step.number, step.acquisition_id)
        detail = "the service failed on it; its log says where"
        with service.database.session() as session:
            follow_ups.move(session, step, came_from="waiting", status="failed", detail=detail)


def _body(session: Session, step: FollowUp, attempt: AcquisitionAttempt) -> dict[str, Any]:
    """Return a step's body with the recording, and what the identification before it has found."""
    body: dict[str, Any] = {"dataset": attempt.dataset_id}
    for earlier in reversed(follow_ups.before(session, step)):
        result = earlier.result or {}
        if earlier.kind == "average":
            body["dataset"] = result["dataset"]
        elif earlier.kind == "identification" and step.kind == "validation":
            body["identification"] = earlier.job_id
    return {**body, **step.body}


def _average(session: Session, caller: Caller, attempt: AcquisitionAttempt) -> str:
    """Make the mean of the repetitions of a recording a dataset of its own, and return its id."""
    repository = DatasetRepository(session, caller.workspace)
    assert attempt.dataset_id is not None
    row = repository.get(attempt.dataset_id)
    repeats = (attempt.facts or {}).get("repeats") or {}
    first, length, count = (int(repeats.get(key, 0)) for key in ("first", "length", "count"))
    if count < 2 or length < 1 or row.sample_count is None or first + length * count > row.sample_count:
        raise invalid("a recording must have at least 2 whole repetitions to be averaged, this one has not")
    before, after = (int(number) for number in repeats.get("fading", (0, 0)))
    if before + after >= count:
        raise invalid(
            f"a recording must have more repetitions than those in which its drive fades in and out ({before} and {after}) "
            f"to be averaged, got {count}: ask for more averages, or lower soft_start and soft_stop of the output"
        )
    first, count = first + before * length, count - before - after
    request = DatasetRequest(
        name=f"{row.name}, mean of {count}",
        format="raw",
        # that of the first sample of the first repetition that is in it
        start_time=row.start_time + timedelta(seconds=first / row.sample_rate)
        if row.start_time and row.sample_rate
        else None,
        sample_rate=row.sample_rate,
        channels=(row.description or {})["channels"],
        origin={
            **(row.origin or {}),
            "mean_of": {"dataset": row.id, "repeats": {"first": first, "length": length, "count": count}},
        },
    )
    target = datasets.create(session, caller, request)["id"]
    names = [str(channel["name"]) for channel in row.channels]
    segments, whole = [], hashlib.sha256()
    for block in _means(repository, row.id, names, first=first, length=length, count=count):
        data = block.astype("<f8").tobytes()
        whole.update(data)
        segments.append(hashlib.sha256(data).hexdigest())
        repository.put_segment(target, segments[-1], data)
    repository.commit(target, segments=segments, sha256=whole.hexdigest())
    repository.ingest_raw(target)
    return str(target)


def _means(
    repository: DatasetRepository, dataset: str, names: list[str], *, first: int, length: int, count: int
) -> Iterator[npt.NDArray[np.float64]]:
    """Give the mean of the repetitions in blocks of shape (n, channels), each a segment long at most."""
    step = max(MAX_SEGMENT // (8 * len(names)), 1)
    for start in range(0, length, step):
        stop = min(start + step, length)
        block = np.zeros((stop - start, len(names)))
        for repeat in range(count):
            offset = first + repeat * length
            for column, name in enumerate(names):
                block[:, column] += repository.read_channel(dataset, name, offset + start, offset + stop)
        yield block / count
