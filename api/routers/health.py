"""Liveness and readiness, without a key."""

from __future__ import annotations

from anyio import CapacityLimiter, to_thread
from fastapi import APIRouter, Request, Response
from fastapi.responses import PlainTextResponse

from api.http.calls import InstallationDep, answer, respond
from api.schemas.replies import Health, Readiness
from api.services.operation.health import readiness
from api.telemetry.metrics import MEDIA_TYPE, Metrics

router = APIRouter(tags=["health"])
#: A thread of its own: whoever asks whether the service works waits for nobody who works.
_ONE = CapacityLimiter(1)


@router.get("/healthz", response_model=Health, summary="Is the process alive?")
async def healthz() -> Response:
    """Answer without asking anything else."""
    return respond(answer({"status": "ok"}))


@router.get("/readyz", response_model=Readiness, summary="Can the service work?")
async def readyz(service: InstallationDep) -> Response:
    """200 when the database answers, migrations are current and the worker beside the service is alive; else 503."""
    ready, body = await to_thread.run_sync(readiness, service, limiter=_ONE)
    return respond(answer(body, status=200 if ready else 503))


@router.get("/metrics", response_class=PlainTextResponse, summary="Numbers for Prometheus")
def metrics(request: Request) -> Response:
    """Requests of this process; jobs and workers of the whole installation. No names and no contents."""
    numbers: Metrics = request.app.state.metrics
    return PlainTextResponse(numbers.text(), media_type=MEDIA_TYPE)
