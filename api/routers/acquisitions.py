"""/v1/acquisitions: measurements on rigs; agents take their attempts here."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from api.http.auth import Acquirer, Reader, Runner
from api.http.bodies import DocumentRoute
from api.http.calls import CreationDep, Cursor, InstallationDep, Limit, answer, respond
from api.routers.jobs import After
from api.schemas.acquisitions import (
    AcquisitionHead,
    AcquisitionReply,
    AcquisitionRequest,
    AttemptDatasetRequest,
    FinishRequest,
    HeartbeatReply,
    HeartbeatRequest,
    Status,
)
from api.schemas.replies import DatasetReply, Page
from api.services.jobs import jobs
from api.services.rigs import acquisitions, attempts
from storage.repositories import Answer

router = APIRouter(prefix="/v1/acquisitions", tags=["acquisitions"], route_class=DocumentRoute)

_POLL = 0.2
Number = Annotated[int, Path(ge=1, le=1_000_000)]


@router.post("", status_code=202, response_model=AcquisitionReply, summary="Measure on a rig")
def create(request: AcquisitionRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Prove that the rig can do it, and let its agent take it. `job` is followed like any other."""
    prepared = acquisitions.prepare(service, caller, request)

    def work(session: Session) -> Answer:
        body = acquisitions.submit(session, caller, prepared)
        return answer(body, status=202, headers={"Location": f"/v1/jobs/{body['job']}", "Retry-After": "1"})

    return creation.create(work)


@router.get("", response_model=Page[AcquisitionHead], summary="List the measurements")
def page(
    caller: Reader,
    service: InstallationDep,
    status: Status | None = None,
    rig: Annotated[str | None, Query(max_length=200)] = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first."""
    with service.database.session() as session:
        body = acquisitions.page(session, caller, status=status, rig=rig, cursor=cursor, limit=limit)
    return respond(answer(body))


@router.get("/{identifier}", response_model=AcquisitionReply, summary="Get a measurement")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return it with its attempts and what follows them."""
    with service.database.session() as session:
        return respond(answer(acquisitions.get(session, caller, identifier)))


@router.post("/{identifier}/cancel", response_model=AcquisitionReply, summary="Cancel a measurement")
def cancel(identifier: str, caller: Runner, service: InstallationDep) -> Response:
    """Let the agent stop; what it has recorded still comes."""
    with service.database.session() as session:
        return respond(answer(acquisitions.cancel(session, caller, identifier)))


@router.post("/{identifier}/retry", status_code=202, response_model=AcquisitionReply, summary="Try a measurement again")
def retry(identifier: str, caller: Runner, creation: CreationDep) -> Response:
    """Make the next attempt: nothing that moves a rig is repeated unless a person asks."""

    def work(session: Session) -> Answer:
        body = acquisitions.retry(session, caller, identifier)
        return answer(body, status=202, headers={"Location": f"/v1/jobs/{body['job']}", "Retry-After": "1"})

    return creation.create(work)


def _job(identifier: str, caller: Reader, service: InstallationDep) -> str:
    """Answer 404 before the stream begins."""
    with service.database.session() as session:
        return acquisitions.job_of(session, caller, identifier)


@router.get("/{identifier}/events", response_class=EventSourceResponse, summary="Follow a measurement live")
async def events(
    request: Request,
    caller: Reader,
    service: InstallationDep,
    job: Annotated[str, Depends(_job)],
    after: After,
) -> AsyncIterator[ServerSentEvent]:
    """Stream the latest attempt: `status`, `progress`, and `preview` with the decimated samples; `Last-Event-ID` resumes."""

    def look(last: int) -> tuple[bool, list[tuple[int, str, dict[str, object]]]]:
        with service.database.session() as session:
            ended = jobs.is_final(str(jobs.get(session, caller, job)["status"]))
            rows = jobs.events(session, caller, job, after=last)
            return ended, [(row.id, row.type, row.payload) for row in rows]

    while not await request.is_disconnected():
        ended, found = await run_in_threadpool(look, after)
        for number, kind, payload in found:
            after = number
            yield ServerSentEvent(id=str(number), event=kind, data=payload)
        if not found:
            if ended:
                return
            await asyncio.sleep(_POLL)


@router.post(
    "/{identifier}/attempts/{number}/heartbeat", response_model=HeartbeatReply, summary="Keep the lease of an attempt"
)
def heartbeat(
    identifier: str, number: Number, request: HeartbeatRequest, caller: Acquirer, service: InstallationDep
) -> Response:
    """409 `lease-lost`, or `cancelled`, when the attempt is over for this agent: the rig must come to rest."""
    with service.database.session() as session:
        return respond(answer(attempts.heartbeat(session, caller, identifier, number, request)))


@router.post(
    "/{identifier}/attempts/{number}/dataset", response_model=DatasetReply, summary="Open the recording of an attempt"
)
def open_dataset(
    identifier: str, number: Number, request: AttemptDatasetRequest, caller: Acquirer, service: InstallationDep
) -> Response:
    """Return the dataset that the samples go into; the same one when asked again, also long after the lease."""
    with service.database.session() as session:
        return respond(answer(attempts.open_dataset(session, caller, identifier, number, request)))


@router.post("/{identifier}/attempts/{number}/finish", response_model=dict[str, object], summary="End an attempt")
def finish(
    identifier: str, number: Number, request: FinishRequest, caller: Acquirer, service: InstallationDep
) -> Response:
    """Say that everything is there, or what went wrong; of an attempt given up before, the facts are kept."""
    with service.database.session() as session:
        return respond(answer(attempts.finish(session, caller, identifier, number, request)))
