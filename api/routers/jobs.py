"""Long work: optimisations and identifications are answered 202 with a job; /v1/jobs tells how it goes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Header, Query, Request, Response
from fastapi.responses import PlainTextResponse
from fastapi.sse import EventSourceResponse, ServerSentEvent
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from api.http.auth import Reader, Runner
from api.http.bodies import DocumentRoute
from api.http.calls import CreationDep, Cursor, InstallationDep, Limit, OfATime, answer, respond
from api.problems.documents import invalid
from api.schemas.identifications import AnyIdentification, IdentificationRequest
from api.schemas.optimizations import OptimizationRequest
from api.schemas.replies import ExpectedReply, JobReply, Page
from api.services.identifications import direct_identifications, identifications
from api.services.jobs import jobs
from api.services.optimizations import optimizations, scripts
from storage.repositories import Answer

router = APIRouter(prefix="/v1", tags=["jobs"], route_class=DocumentRoute)

#: How often (s) a stream looks for new events; a cancellation is seen well within a second.
_POLL = 0.15


def _accepted(job: dict[str, object]) -> Answer:
    return answer(job, status=202, headers={"Location": f"/v1/jobs/{job['id']}", "Retry-After": "1"})


@router.post("/optimizations", status_code=202, response_model=JobReply, summary="Optimise parameters")
def optimize(request: OptimizationRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Prove that the problem makes sense, then hand it to a worker."""
    prepared = optimizations.prepare(service, caller, request)

    def work(session: Session) -> Answer:
        return _accepted(optimizations.submit(service, session, caller, request, prepared))

    return creation.create(work)


@router.post(
    "/identifications",
    status_code=202,
    response_model=JobReply,
    responses={200: {"model": ExpectedReply, "description": "dry_run: what it would take; nothing is started"}},
    summary="Identify parameters",
)
def identify(
    request: AnyIdentification,
    caller: Runner,
    service: InstallationDep,
    creation: CreationDep,
    *,
    dry_run: Annotated[bool, Query(description="only tell what it would take")] = False,
) -> Response:
    """Prove that the recording and what is asked of it fit together, then hand them to a worker.

    With a system its parameters are estimated (`grey_box`). Without one, `subspace` and `transfer_function` make a model,
    `inverse_dynamics` finds the mass and friction of a drive, and `static_curve` draws a characteristic.
    """
    if isinstance(request, IdentificationRequest):
        prepared = identifications.prepare(service, caller, request)
        if dry_run:
            return respond(answer({"expected": asdict(prepared.cost), "warnings": prepared.warnings()}))
        return creation.create(
            lambda session: _accepted(identifications.submit(service, session, caller, request, prepared))
        )
    direct_identifications.prepare(service, caller, request)
    if dry_run:
        return respond(answer({"expected": None, "warnings": []}))
    return creation.create(lambda session: _accepted(direct_identifications.submit(service, session, caller, request)))


Status = Literal["queued", "running", "succeeded", "failed", "cancelled"]


@router.get("/jobs", response_model=Page[JobReply], summary="List the jobs")
def page(
    caller: Reader,
    service: InstallationDep,
    narrowing: OfATime,
    kind: Annotated[str | None, Query(max_length=64)] = None,
    status: Status | None = None,
    schedule: Annotated[str | None, Query(max_length=64, description="id of the schedule that asked for them")] = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first."""
    with service.database.session() as session:
        body = jobs.page(
            session,
            caller,
            kind=kind,
            status=status,
            schedule=schedule,
            narrowing=narrowing,
            cursor=cursor,
            limit=limit,
        )
    return respond(answer(body))


@router.get("/jobs/{identifier}", response_model=JobReply, summary="Get a job")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return how far the job is."""
    with service.database.session() as session:
        return respond(answer(jobs.get(session, caller, identifier)))


@router.get("/jobs/{identifier}/result", response_model=dict[str, object], summary="Get the result of a job")
def result(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return what came out of a succeeded job, or the best point of a search that was cancelled; 409 before, and where there is none."""
    with service.database.session() as session:
        body = jobs.result(session, caller, identifier)
    return respond(answer(body))


@router.get("/jobs/{identifier}/request", response_model=dict[str, object], summary="Get the request of a job")
def request(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return what was asked for, the system written out as it was then; 409 for a job without a request of its own."""
    with service.database.session() as session:
        body = jobs.request(session, caller, identifier)
    return respond(answer(body))


class PythonScript(PlainTextResponse):
    """A program to download."""

    media_type = "text/x-python"


@router.get(
    "/jobs/{identifier}/script",
    response_class=PythonScript,
    summary="Export an optimisation as a script",
)
def script(identifier: str, caller: Reader, service: InstallationDep) -> PythonScript:
    """Return a standalone Python script that repeats the optimisation through the client library."""
    with service.database.session() as session:
        text = scripts.script_of(session, caller, identifier)
    return PythonScript(
        text,
        headers={"Content-Disposition": f'attachment; filename="optimization_{identifier}.py"'},
    )


@router.post("/jobs/{identifier}/cancel", response_model=JobReply, summary="Cancel a job")
def cancel(identifier: str, caller: Runner, service: InstallationDep) -> Response:
    """Stop the computation within a second; a job that has ended stays as it is."""
    with service.database.session() as session:
        body = jobs.cancel(session, caller, identifier)
    return respond(answer(body))


@router.post("/jobs/{identifier}/pause", response_model=JobReply, summary="Pause a job")
def pause(identifier: str, caller: Runner, service: InstallationDep) -> Response:
    """Stop the computation within a second and keep its state, until the job is resumed; 409 for one that has ended."""
    with service.database.session() as session:
        body = jobs.pause(session, caller, identifier)
    return respond(answer(body))


@router.post("/jobs/{identifier}/resume", response_model=JobReply, summary="Resume a job")
def resume(identifier: str, caller: Runner, service: InstallationDep) -> Response:
    """Let a paused job go on from where it was; one that is not paused stays as it is."""
    with service.database.session() as session:
        body = jobs.resume(service, session, caller, identifier)
    return respond(answer(body))


def _existing(identifier: str, caller: Reader, service: InstallationDep) -> str:
    """Answer 404 before the stream begins."""
    with service.database.session() as session:
        jobs.get(session, caller, identifier)
    return identifier


LastEventId = Annotated[str | None, Header(alias="Last-Event-ID", description="resume after this event")]


async def _after(last_event_id: LastEventId = None) -> int:
    if last_event_id is None or last_event_id == "":
        return 0
    if not (last_event_id.isascii() and last_event_id.isdigit()) or len(last_event_id) > 15:
        raise invalid(f"the header Last-Event-ID must be a whole number, got {last_event_id!r}")
    return int(last_event_id)


After = Annotated[int, Depends(_after)]
"""The event after which a stream goes on."""


@router.get("/jobs/{identifier}/events", response_class=EventSourceResponse, summary="Follow a job")
async def events(
    request: Request,
    caller: Reader,
    service: InstallationDep,
    identifier: Annotated[str, Depends(_existing)],
    after: After,
) -> AsyncIterator[ServerSentEvent]:
    """Stream the job's events until it has ended; `Last-Event-ID` resumes without a gap."""

    def look(last: int) -> tuple[bool, list[tuple[int, str, dict[str, object]]]]:
        with service.database.session() as session:
            # First the status: once it is final, every event is there to be read; the other way round the last one,
            # written between the two questions, would be lost.
            ended = jobs.is_final(str(jobs.get(session, caller, identifier)["status"]))
            rows = jobs.events(session, caller, identifier, after=last)
            return ended, [(row.id, row.type, row.payload) for row in rows]

    while not await request.is_disconnected():
        ended, found = await run_in_threadpool(look, after)
        for number, kind, payload in found:
            after = number
            yield ServerSentEvent(id=str(number), event=kind, data=payload)
            if kind == "status" and jobs.is_final(str(payload["status"])):
                return
        if not found:
            if ended:  # a stream resumed after the last event must end too
                return
            await asyncio.sleep(_POLL)
