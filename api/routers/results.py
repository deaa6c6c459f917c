"""/v1/results: studies that were asked to be kept."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response

from api.http.auth import Reader
from api.http.calls import Cursor, InstallationDep, Limit, OfATime, answer, respond
from api.schemas.replies import KeptResult, Page, ResultHead
from api.services.studies import results

router = APIRouter(prefix="/v1/results", tags=["results"])


@router.get("", response_model=Page[ResultHead], summary="List the kept results")
def page(
    caller: Reader,
    service: InstallationDep,
    narrowing: OfATime,
    kind: Annotated[str | None, Query(max_length=64)] = None,
    cursor: Cursor = None,
    limit: Limit = 100,
) -> Response:
    """Newest first, without their bodies."""
    with service.database.session() as session:
        body = results.page(session, caller, kind=kind, narrowing=narrowing, cursor=cursor, limit=limit)
    return respond(answer(body))


@router.get("/{identifier}", response_model=KeptResult, summary="Get a kept result")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return the reply as it was given, the request, the document revision and the versions used."""
    with service.database.session() as session:
        body = results.get(session, caller, identifier)
    return respond(answer(body))
