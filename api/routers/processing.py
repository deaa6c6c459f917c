"""/v1/processings: recordings made from others."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Response
from sqlalchemy.orm import Session

from api.http.auth import Runner
from api.http.bodies import DocumentRoute
from api.http.calls import CreationDep, InstallationDep, answer, etag
from api.schemas.processing import ProcessingRequest
from api.schemas.replies import DatasetReply
from api.services.recordings import processing
from storage.repositories import Answer

router = APIRouter(prefix="/v1/processings", tags=["datasets"], route_class=DocumentRoute)


@router.post(
    "",
    status_code=201,
    response_model=DatasetReply,
    responses={202: {"model": DatasetReply, "description": "a long recording: a job computes it"}},
    summary="Process recordings",
)
async def create(
    request: ProcessingRequest, caller: Runner, service: InstallationDep, creation: CreationDep
) -> Response:
    """Calibrate, filter, cut, resample, differentiate, integrate, merge: a new recording that remembers its sources and steps."""

    def work(session: Session) -> Answer:
        started = processing.submit(service, session, caller, request)
        if started.job is None:
            headers = {
                "Location": f"/v1/datasets/{started.dataset['id']}",
                "ETag": etag(started.dataset["revision"]),
            }
            return answer(started.dataset, status=201, headers=headers)
        headers = {"Location": f"/v1/jobs/{started.job['id']}", "Retry-After": "1"}
        return answer({**started.dataset, "job": started.job}, status=202, headers=headers)

    computing = service.computing
    return await computing.in_thread(
        computing.threads, caller.workspace, caller.principal, partial(creation.create, work)
    )
