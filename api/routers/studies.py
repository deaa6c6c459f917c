"""What is computed at once: simulations, frequency responses, influence studies."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response

from api.auth import Runner
from api.bodies import DocumentRoute
from api.calls import CreationDep, InstallationDep, answer, respond
from api.schemas.replies import FrequencyReply, InfluenceReply, SimulationReply, StateSpaceReply
from api.schemas.studies import FrequencyRequest, InfluenceRequest, SimulationRequest, StateSpaceRequest
from api.services import exports, studies

MATLAB = "application/x-matlab-data"

FileFormat = Annotated[Literal["json", "mat"], Query(alias="format", description="a JSON document or a MATLAB file")]

router = APIRouter(prefix="/v1", tags=["studies"], route_class=DocumentRoute)


@router.post("/simulations", response_model=SimulationReply, summary="Simulate")
def simulate(request: SimulationRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Curves and metrics of every output, exact and independent of `samples`."""
    return creation.study(
        caller, "simulation", lambda: studies.run_simulation(service, caller, request), kept=request.keep
    )


@router.post("/frequency-responses", response_model=FrequencyReply, summary="Frequency response")
def frequency_response(
    request: FrequencyRequest, caller: Runner, service: InstallationDep, creation: CreationDep
) -> Response:
    """A path from input to output, or the loop opened at a block's output, with margins."""
    return creation.study(
        caller,
        "frequency_response",
        lambda: studies.run_frequency_response(service, caller, request),
        kept=request.keep,
    )


@router.post("/influence", response_model=InfluenceReply, summary="Influence of parameters on metrics")
def influence(request: InfluenceRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Exact elasticities, and the influence coefficients at a finite change."""
    return creation.study(
        caller, "influence", lambda: studies.run_influence(service, caller, request), kept=request.keep
    )


@router.post(
    "/state-space",
    response_model=StateSpaceReply,
    responses={200: {"content": {MATLAB: {"schema": {"type": "string", "format": "binary"}}}}},
    summary="Matrices and poles of a system, stored or not",
)
def state_space(
    request: StateSpaceRequest, caller: Runner, service: InstallationDep, file_format: FileFormat = "json"
) -> Response:
    """What `/v1/systems/{id}/state-space` tells of a stored one, at given values of its parameters."""
    found = exports.state_space(service, caller, request)
    if file_format == "json":
        return respond(answer(found.document()))
    headers = {"Content-Disposition": 'attachment; filename="system.mat"'}
    return Response(found.file(), media_type=MATLAB, headers=headers)
