"""/v1/validations: measured against simulated, at once or by a worker."""

from __future__ import annotations

from fastapi import APIRouter, Response
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from api.http.auth import Runner
from api.http.bodies import DocumentRoute
from api.http.calls import BY_A_WORKER, CreationDep, InstallationDep, Prefer, accepted, prefers_job
from api.schemas.replies import ValidationReply
from api.schemas.validations import ValidationRequest
from api.services.validations import validations
from storage.repositories import Answer

router = APIRouter(prefix="/v1", tags=["studies"], route_class=DocumentRoute)


@router.post(
    "/validations",
    response_model=ValidationReply,
    responses=BY_A_WORKER,
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
    if not prefers_job(prefer):
        return await creation.study(caller, validations.KIND, request, kept=request.keep)
    subject = await run_in_threadpool(validations.prove, service, caller, request)

    def work(session: Session) -> Answer:
        return accepted(validations.submit(service, session, caller, request, subject))

    return await run_in_threadpool(creation.create, work)
