"""/v1/validations: measured against simulated, at once or by a worker."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Header, Response
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from api.auth import Runner
from api.bodies import DocumentRoute
from api.calls import CreationDep, InstallationDep, answer
from api.schemas.replies import JobReply, ValidationReply
from api.schemas.validations import ValidationRequest
from api.services import validations
from storage.repositories import Answer

router = APIRouter(prefix="/v1", tags=["studies"], route_class=DocumentRoute)

Prefer = Annotated[
    str | None,
    Header(max_length=200, description="`respond-async` hands the validation to a worker and answers 202 with its job"),
]


@router.post(
    "/validations",
    response_model=ValidationReply,
    responses={202: {"model": JobReply, "description": "A worker validates"}},
    summary="Measured against simulated",
)
async def validate(
    request: ValidationRequest,
    caller: Runner,
    service: InstallationDep,
    creation: CreationDep,
    prefer: Prefer = None,
) -> Response:
    """Fit measures by name, trivial baselines, residual tests, the verdict against a limit, and what to try if it fails."""
    if prefer is None or "respond-async" not in prefer.lower():
        return await creation.study(caller, validations.KIND, request, kept=request.keep)
    subject = await run_in_threadpool(validations.prove, service, caller, request)

    def work(session: Session) -> Answer:
        job = validations.submit(service, session, caller, request, subject)
        headers = {
            "Location": f"/v1/jobs/{job['id']}",
            "Retry-After": "1",
            "Preference-Applied": "respond-async",
        }
        return answer(job, status=202, headers=headers)

    return await run_in_threadpool(creation.create, work)
