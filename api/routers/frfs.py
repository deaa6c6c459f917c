"""Measured frequency response functions."""

from __future__ import annotations

from fastapi import APIRouter, Response

from api.auth import Runner
from api.bodies import DocumentRoute
from api.calls import CreationDep, InstallationDep
from api.schemas.frfs import FrfReply, FrfRequest
from api.services import frfs

router = APIRouter(prefix="/v1/frfs", tags=["studies"], route_class=DocumentRoute)


@router.post("", response_model=FrfReply, summary="Frequency response function of a recording")
def frf(request: FrfRequest, caller: Runner, service: InstallationDep, creation: CreationDep) -> Response:
    """Averaged, of a multisine or of stepped sines; coherence, confidence bands, sensor corrections, modes, a model beside it."""
    return creation.study(caller, frfs.KIND, lambda: frfs.run_frf(service, caller, request), kept=request.keep)
