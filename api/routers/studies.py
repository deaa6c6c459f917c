"""What is computed at once: simulations, frequency responses, influence studies."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response

from api.http.auth import Runner
from api.http.bodies import DocumentRoute
from api.http.calls import BY_A_WORKER, CreationDep, InstallationDep, Prefer, answer, recalled, respond
from api.schemas.replies import FrequencyReply, InfluenceReply, SimulationReply, StateSpaceReply
from api.schemas.studies import FrequencyRequest, InfluenceRequest, SimulationRequest, StateSpaceRequest
from api.services.systems import exports

MATLAB = "application/x-matlab-data"

FileFormat = Annotated[Literal["json", "mat"], Query(alias="format", description="a JSON document or a MATLAB file")]

router = APIRouter(prefix="/v1", tags=["studies"], route_class=DocumentRoute)


@router.post("/simulations", response_model=SimulationReply, responses=BY_A_WORKER, summary="Simulate")
async def simulate(
    request: SimulationRequest, caller: Runner, creation: CreationDep, prefer: Prefer = None
) -> Response:
    """Curves and metrics of every output, exact and independent of `samples`."""
    return await creation.study(caller, "simulation", request, kept=request.keep, prefer=prefer)


@router.post("/frequency-responses", response_model=FrequencyReply, responses=BY_A_WORKER, summary="Frequency response")
async def frequency_response(
    request: FrequencyRequest, caller: Runner, creation: CreationDep, prefer: Prefer = None
) -> Response:
    """A path from input to output, or the loop opened at a block's output, with margins."""
    return await creation.study(caller, "frequency_response", request, kept=request.keep, prefer=prefer)


@router.post(
    "/influence", response_model=InfluenceReply, responses=BY_A_WORKER, summary="Influence of parameters on metrics"
)
async def influence(
    request: InfluenceRequest, caller: Runner, creation: CreationDep, prefer: Prefer = None
) -> Response:
    """Exact elasticities, and the influence coefficients at a finite change."""
    return await creation.study(caller, "influence", request, kept=request.keep, prefer=prefer)


@router.post(
    "/state-space",
    response_model=StateSpaceReply,
    responses={200: {"content": {MATLAB: {"schema": {"type": "string", "format": "binary"}}}}},
    summary="Matrices and poles of a system, stored or not",
)
async def state_space(
    request: StateSpaceRequest,
    caller: Runner,
    service: InstallationDep,
    http: Request,
    file_format: FileFormat = "json",
) -> Response:
    """What `/v1/systems/{id}/state-space` tells of a stored one, at given values of its parameters."""

    def work() -> Response:
        found = exports.state_space(service, caller, request)
        if file_format == "json":
            return respond(answer(found.document()))
        headers = {"Content-Disposition": 'attachment; filename="system.mat"'}
        return Response(found.file(), media_type=MATLAB, headers=headers)

    computing = service.computing
    async with recalled(http.receive) as recall:
        return await computing.in_thread(computing.threads, caller.workspace, caller.principal, work, recall=recall)
