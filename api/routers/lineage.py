"""/v1/lineage: what was made from what."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Response
from fastapi.responses import StreamingResponse

from api.http.auth import Reader
from api.http.calls import InstallationDep, answer, respond
from api.schemas.lineage import LineageReply
from api.services.lineage import bundles, lineage

ZIP = "application/zip"

router = APIRouter(prefix="/v1/lineage", tags=["lineage"])

Thing = Annotated[
    str,
    Path(
        max_length=64, description="a dataset, job, kept study, acquisition, system, or a system's revision `sys_...@3`"
    ),
]


@router.get("/{identifier}", response_model=LineageReply, summary="Get a lineage")
def get(
    identifier: Thing,
    caller: Reader,
    service: InstallationDep,
    direction: Annotated[
        Literal["both", "up", "down"], Query(description="up: what it was made from; down: what was made from it")
    ] = "both",
) -> Response:
    """Return the graph from the samples to the numbers, from any of its nodes in both directions."""
    with service.database.session() as session:
        body = lineage.graph(session, caller, identifier, direction=direction)
    return respond(answer(body))


@router.get(
    "/{identifier}/bundle",
    response_class=StreamingResponse,
    responses={200: {"content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}},
    summary="Export a lineage",
)
def bundle(
    identifier: Thing,
    caller: Reader,
    service: InstallationDep,
    direction: Annotated[
        Literal["both", "up", "down"],
        Query(description="up: what its numbers need; both: all that was made from it, too"),
    ] = "up",
) -> StreamingResponse:
    """Return one file with documents, samples, requests, results, versions and seeds; `servotune lineage replay` repeats it."""
    with service.database.session() as session:
        file = bundles.bundle(session, caller, identifier, direction=direction)
    headers = {"Content-Disposition": f'attachment; filename="lineage_{identifier}.zip"'}
    return StreamingResponse(bundles.pieces(file), media_type=ZIP, headers=headers)
