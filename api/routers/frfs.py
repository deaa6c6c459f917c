"""Measured frequency response functions."""

from __future__ import annotations

from fastapi import APIRouter, Response
from fastapi.responses import PlainTextResponse

from api.http.auth import Reader, Runner
from api.http.bodies import DocumentRoute
from api.http.calls import BY_A_WORKER, CreationDep, InstallationDep, Prefer
from api.schemas.frfs import FrfReply, FrfRequest
from api.services.frequency import frf_files, frfs

router = APIRouter(prefix="/v1/frfs", tags=["studies"], route_class=DocumentRoute)


@router.post("", response_model=FrfReply, responses=BY_A_WORKER, summary="Frequency response function of a recording")
async def frf(request: FrfRequest, caller: Runner, creation: CreationDep, prefer: Prefer = None) -> Response:
    """Averaged, of a multisine or of stepped sines; coherence, confidence bands, sensor corrections, modes, a model beside it."""
    return await creation.study(caller, frfs.KIND, request, kept=request.keep, prefer=prefer)


@router.get(
    "/{identifier}/uff",
    response_class=PlainTextResponse,
    summary="Frequency response functions as a universal file",
)
def universal_file(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return a kept reply as datasets 58 in text: every response and its coherence, lines in Hz."""
    with service.database.session() as session:
        content = frf_files.universal_file(session, caller, identifier)
    headers = {"Content-Disposition": f'attachment; filename="{identifier}.uff"'}
    return PlainTextResponse(content, headers=headers)
