"""/v1/agents, /v1/rigs: the processes on lab PCs, and the test benches that they drive."""

from __future__ import annotations

import asyncio
import time
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from api.http.auth import Acquirer, Reader
from api.http.bodies import DocumentRoute
from api.http.calls import Cursor, InstallationDep, Limit, answer, respond
from api.schemas.acquisitions import ClaimReply
from api.schemas.replies import Page
from api.schemas.rigs import AgentReply, AgentRequest, RigReply
from api.services.rigs import agents, attempts

router = APIRouter(prefix="/v1", tags=["agents"], route_class=DocumentRoute)

#: How often (s) a waiting agent's rig is looked at.
_POLL = 0.25


@router.post(
    "/agents",
    response_model=AgentReply,
    responses={204: {"description": "the rig makes sense; nothing was registered"}},
    summary="Register an agent and its rig",
)
def register(
    request: AgentRequest,
    caller: Acquirer,
    service: InstallationDep,
    *,
    check: Annotated[bool, Query(description="judge the document only, and register nothing")] = False,
) -> Response:
    """Take the rig: 409 while another agent has it and is alive. The same `instance` is the same agent for ever."""
    if check:
        agents.check(request)
        return Response(status_code=204)
    with service.database.session() as session:
        body = agents.register(session, caller, request)
    return respond(answer(body, headers={"Location": f"/v1/agents/{body['id']}"}))


@router.get("/agents", response_model=Page[AgentReply], summary="List the agents")
def page(caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100) -> Response:
    """Newest first."""
    with service.database.session() as session:
        return respond(answer(agents.page(session, caller, cursor=cursor, limit=limit)))


@router.get("/agents/{identifier}", response_model=AgentReply, summary="Get an agent")
def get(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return an agent, and when it was heard of."""
    with service.database.session() as session:
        return respond(answer(agents.get(session, caller, identifier)))


@router.post(
    "/agents/{identifier}/claim",
    response_model=ClaimReply,
    responses={204: {"description": "nothing waits for the rig"}},
    summary="Take the next attempt",
)
async def claim(
    request: Request,
    identifier: str,
    caller: Acquirer,
    service: InstallationDep,
    wait: Annotated[float, Query(ge=0.0, le=50.0, description="s to wait for one")] = 0.0,
) -> Response:
    """Wait for an attempt on the agent's rig and take it, with a lease; 204 when none came. One at a time for a rig."""

    def look() -> dict[str, Any] | None:
        with service.database.session() as session:
            return attempts.claim(session, caller, identifier)

    until = time.monotonic() + wait
    # A claim whose asker has gone would be lost for a whole lease: look whether it is there first.
    while not await request.is_disconnected():
        found = await run_in_threadpool(look)
        if found is not None:
            return respond(answer(found))
        if time.monotonic() >= until:
            break
        await asyncio.sleep(min(_POLL, max(until - time.monotonic(), 0.0)))
    return Response(status_code=204)


@router.get("/rigs", response_model=Page[RigReply], summary="List the rigs")
def rigs(caller: Reader, service: InstallationDep, cursor: Cursor = None, limit: Limit = 100) -> Response:
    """Newest first."""
    with service.database.session() as session:
        return respond(answer(agents.rigs(session, caller, cursor=cursor, limit=limit)))


@router.get("/rigs/{identifier}", response_model=RigReply, summary="Get a rig")
def rig(identifier: str, caller: Reader, service: InstallationDep) -> Response:
    """Return its devices, its inputs with sensors and calibration, its outputs with their limits."""
    with service.database.session() as session:
        return respond(answer(agents.get_rig(session, caller, identifier)))
