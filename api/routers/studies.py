"""What is computed at once: simulations, frequency responses, influence studies."""

from __future__ import annotations

from fastapi import APIRouter, Response

from api.auth import Runner
from api.bodies import DocumentRoute
from api.calls import CreationDep, InstallationDep
from api.schemas.replies import FrequencyReply, InfluenceReply, SimulationReply
from api.schemas.studies import FrequencyRequest, InfluenceRequest, SimulationRequest
from api.services import studies

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
