"""/v1/schedules: jobs that are run again and again."""

from __future__ import annotations

from fastapi import APIRouter, Response
from sqlalchemy.orm import Session

from api.http.auth import Reader, Runner
from api.http.bodies import DocumentRoute
from api.http.calls import (
    CreationDep,
    Cursor,
    IfMatch,
    InstallationDep,
    Limit,
    answer,
    etag,
    expected_revision,
    respond,
)
from api.schemas.replies import Page
from api.schemas.schedules import RunReply, ScheduleHead, ScheduleReply, ScheduleRequest
from api.services.schedules import schedules
from storage.repositories import Answer

router = APIRouter(prefix="/v1/schedules", tags=["schedules"], route_class=DocumentRoute)


@router.post("", status_code=201, response_model=ScheduleReply, summary="Schedule a job")
def create(request: ScheduleRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Prove that the job can be run, then run it at every instant of the cron expression."""
    values = schedules.check(service, caller, request)

    def work(session: Session) -> Answer:
        body = schedules.create(session, caller, values)
        headers = {"Location": f"/v1/schedules/{body['id']}", "ETag": etag(body["revision"])}
        return answer(body, status=201, headers=headers)

    return creation.create(work)


@router.get("", response_model=Page[ScheduleHead], summary="List the schedules")
def page(caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100) -> Response:
    """Newest first, without the bodies of their jobs."""
    with service.database.session() as session:
        return respond(answer(schedules.page(session, caller, cursor=cursor, limit=limit)))


@router.get("/{identifier}", response_model=ScheduleReply, summary="Get a schedule")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return it with its next instants, and its ETag."""
    with service.database.session() as session:
        body = schedules.get(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.put("/{identifier}", response_model=ScheduleReply, summary="Change a schedule")
def update(
    identifier: str, request: ScheduleRequest, caller: Runner, service: InstallationDep, if_match: IfMatch = None
) -> Response:
    """Go on with the next instant of the new expression."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: schedules.get(session, caller, identifier)["revision"])
        schedules.get(session, caller, identifier)
    values = schedules.check(service, caller, request)
    with service.database.session() as session:
        body = schedules.update(session, caller, identifier, values, expected_revision=expected)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.delete("/{identifier}", status_code=204, summary="Delete a schedule")
def delete(identifier: str, caller: Runner, service: InstallationDep, if_match: IfMatch = None) -> Response:
    """Forget it and its history; its jobs stay, and those that run go on."""
    with service.database.session() as session:
        expected = expected_revision(if_match, lambda: schedules.get(session, caller, identifier)["revision"])
        schedules.delete(session, caller, identifier, expected_revision=expected)
    return Response(status_code=204)


@router.post("/{identifier}/trigger", status_code=202, response_model=RunReply, summary="Run a schedule's job now")
def trigger(identifier: str, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Whether it is due or paused; the overlap policy counts."""
    row, submit = schedules.prepare_trigger(service, caller, identifier)

    def work(session: Session) -> Answer:
        body = schedules.trigger(session, row, submit)
        headers = {"Location": f"/v1/jobs/{body['job']}", "Retry-After": "1"} if body["job"] else {}
        return answer(body, status=202, headers=headers)

    return creation.create(work)


@router.post("/{identifier}/pause", response_model=ScheduleReply, summary="Pause a schedule")
def pause(identifier: str, caller: Runner, service: InstallationDep) -> Response:
    """Start nothing until it is resumed."""
    with service.database.session() as session:
        body = schedules.pause(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.post("/{identifier}/resume", response_model=ScheduleReply, summary="Resume a schedule")
def resume(identifier: str, caller: Runner, service: InstallationDep) -> Response:
    """Go on with the next instant; those of the pause are not made up for."""
    with service.database.session() as session:
        body = schedules.resume(session, caller, identifier)
    return respond(answer(body, headers={"ETag": etag(body["revision"])}))


@router.get("/{identifier}/runs", response_model=Page[RunReply], summary="List what a schedule has done")
def runs(
    identifier: str, caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100
) -> Response:
    """Newest first: which jobs it started, and why it started none."""
    with service.database.session() as session:
        return respond(answer(schedules.runs(session, caller, identifier, cursor=cursor, limit=limit)))
