"""The application: routers, errors as problems, keys, limits, the API reference."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager, suppress
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from fastapi import Depends, FastAPI
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from api.app import live, pages
from api.app.examples import add_examples
from api.http import handlers
from api.http.auth import Authentication, bearer
from api.http.queries import once
from api.http.rate_limits import Rates
from api.http.security_headers import Edge
from api.problems.documents import MEDIA_TYPE
from api.routers import HEALTH, ROUTERS, SIGN_IN
from api.runtime.child_process import Beside
from api.schemas.replies import ProblemReply
from api.services.access.openid import Provider
from api.services.jobs.computing import Computing
from api.services.operation.app_context import Installation, vault_of
from api.services.operation.housekeeping import INTERVAL, tidy
from api.services.rigs.following import look_after
from api.services.schedules.ticking import INTERVAL as TICK
from api.services.schedules.ticking import tick
from api.services.webhooks.webhook_delivery import Courier
from api.settings import Settings
from api.telemetry.metrics import Measured, Metrics
from api.telemetry.tracing import Traces, traces_of
from storage.election import Election
from storage.errors import UNAVAILABLE
from storage.jobs.queue import JobQueue
from storage.session import CONNECTIONS, open_database

if TYPE_CHECKING:
    from fastapi.telemetry import TelemetryConfig

    from api.runtime.shared_memory import Siblings

DESCRIPTION = """Assisted optimisation of the dynamic behaviour of servo drives and robot structures.

Systems are diagrams of blocks; their responses, metrics and elasticities are exact. Values are in SI unless a unit is
written. Everything under `/v1` needs a key: `Authorization: Bearer <key>`. Errors are RFC 9457 problem documents."""

_log = logging.getLogger("servotune.api")
#: s between two writings of when keys were used.
_USES = 1.0
#: Connections of one of several processes, however many there are.
_FEWEST_CONNECTIONS = 8
_SCHEMAS = "#/components/schemas/"
_PROBLEMS = {
    401: "no key, or one that opens nothing",
    403: "the key lacks the scope",
    404: "there is no such thing in this workspace",
    408: "the body does not arrive",
    409: "the thing is in a state that does not allow this, or an equal request is being answered",
    412: "the document has changed since the revision in `If-Match`",
    413: "the body is too large",
    422: "the document is wrong: `errors` says where",
    428: "`If-Match` is missing",
    429: "too many requests, too many that wait to be computed, or too many unfinished jobs: `Retry-After` says when to come again",
    500: "an error of the software; the log says more under the request's id",
    503: "the database, or what computes, is not to be had; `Retry-After` says when to come again",
}


async def _keep_house(service: Installation, election: Election) -> None:
    while True:
        if election.won:
            await run_in_threadpool(tidy, service)
        await asyncio.sleep(INTERVAL if election.won else TICK)


def _tick(service: Installation, election: Election) -> None:
    if election.elected():
        tick(service, now=service.database.now())
        look_after(service)


async def _keep_time(service: Installation, election: Election) -> None:
    away = False
    while True:
        try:
            await run_in_threadpool(_tick, service, election)
            away = False
        except UNAVAILABLE as error:
            if not away:  # say it once, not every second
                _log.warning("schedules and leases have to wait for the database: %s", error)
            away = True
        await asyncio.sleep(TICK)


async def _write_uses(service: Installation) -> None:
    while True:
        await asyncio.sleep(_USES)
        if service.callers.uses.due:
            await run_in_threadpool(service.callers.uses.write)


def _connections(siblings: Siblings | None) -> int:
    """Return how many connections to the database this process may have."""
    return CONNECTIONS if siblings is None else max(CONNECTIONS // siblings.count, _FEWEST_CONNECTIONS)


class Application(FastAPI):
    """The application, with the edge outside of all else, and a reference that also holds the schema of problems."""

    encrypted = False
    _making = threading.Lock()

    def build_middleware_stack(self) -> ASGIApp:
        """Put the edge outside of what answers errors that nobody foresaw."""
        return Edge(super().build_middleware_stack(), encrypted=self.encrypted)

    def openapi(self) -> dict[str, Any]:
        """Return the OpenAPI document; whoever asks while another makes it waits until it is whole."""
        with self._making:
            document = super().openapi()
            if "ProblemReply" not in document["components"]["schemas"]:
                problem = ProblemReply.model_json_schema(ref_template=_SCHEMAS + "{model}")
                document["components"]["schemas"] |= {**problem.pop("$defs"), "ProblemReply": problem}
                add_examples(document)
            return document


def _contract(request: Request) -> Response:
    """Return the OpenAPI document; making it takes seconds the first time, in which a thread lets others be answered."""
    return JSONResponse(request.app.openapi())


def _telemetry(traces: Traces) -> TelemetryConfig:
    """Return how the application traces its requests."""
    if traces.provider is None:
        return {"tracing": False, "metrics": False, "logs": False}
    return {"tracer_provider": traces.provider, "metrics": False, "logs": False}


def _lifespan(
    chosen: Settings,
    *,
    beside: Beside | None,
    siblings: Siblings | None,
    keeps_time: bool,
    metrics: Metrics,
    traces: Traces,
) -> Callable[[FastAPI], AbstractAsyncContextManager[None]]:
    """Return what opens the database and looks after everything until the application stops."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        database = open_database(chosen.database_url, connections=_connections(siblings), objects=chosen.objects)
        queue = JobQueue(database)
        service = Installation(
            settings=chosen,
            database=database,
            queue=queue,
            computing=Computing(chosen),
            openid=Provider(chosen) if chosen.oidc_issuer is not None else None,
            beside=beside,
            vault=vault_of(chosen),
            traces=traces,
            revocations=None if siblings is None else siblings.revocations,
        )
        app.state.installation = service
        metrics.read_from(database)
        app.state.metrics = metrics
        courier = Courier(service)
        election = Election(database, "time")
        loops = [_write_uses(service)]
        if keeps_time:
            loops += [_keep_house(service, election), _keep_time(service, election), courier.run()]
        tasks = [asyncio.create_task(loop) for loop in loops]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await courier.close()
            await run_in_threadpool(service.computing.close)
            service.callers.uses.write()
            with suppress(*UNAVAILABLE):  # the next one waits a little then
                election.resign()
            queue.close()
            database.dispose()
            traces.close()

    return lifespan


def _add_routes(app: FastAPI) -> None:
    """Add every route, with the problems that it may answer."""
    problems: dict[int | str, dict[str, Any]] = {
        status: {"description": text, "content": {MEDIA_TYPE: {"schema": {"$ref": f"{_SCHEMAS}ProblemReply"}}}}
        for status, text in _PROBLEMS.items()
    }
    for router in ROUTERS:
        app.include_router(router, dependencies=[Depends(bearer), Depends(once)], responses=problems)
    app.include_router(HEALTH)
    app.include_router(SIGN_IN, dependencies=[Depends(once)])
    app.include_router(live.router)
    app.router.routes.append(Route("/openapi.json", _contract))
    app.router.routes.extend(pages.ROUTES)  # the last ones: they answer every address that no other does


def create_app(
    settings: Settings | None = None,
    *,
    beside: Beside | None = None,
    siblings: Siblings | None = None,
    keeps_time: bool = True,
) -> FastAPI:
    """Return the application; the database is opened when it starts, and must have been migrated.

    Parameters
    ----------
    settings : Settings, optional
        Read from the environment by default.
    beside : Beside, optional
        The worker without which the service is not ready.
    siblings : Siblings, optional
        The processes that answer on the same port, this one among them.
    keeps_time : bool
        Whether this one looks after schedules, leases, messages and what is to be thrown away.
    """
    chosen = settings if settings is not None else Settings()
    traces = traces_of(chosen, "servotune")
    metrics = Metrics(None if siblings is None else siblings.numbers)
    app = Application(
        title="Servotune",
        version=version("servotune"),
        description=DESCRIPTION,
        lifespan=_lifespan(
            chosen, beside=beside, siblings=siblings, keeps_time=keeps_time, metrics=metrics, traces=traces
        ),
        openapi_url=None,  # a route of its own serves it, and the reference is one of the pages
        separate_input_output_schemas=False,
        telemetry=_telemetry(traces),
    )
    handlers.install(app)
    _add_routes(app)
    app.add_middleware(
        Authentication,
        rates=Rates(chosen.requests_per_minute, buckets=None if siblings is None else siblings.requests),
        failures=Rates(chosen.wrong_keys_per_minute, buckets=None if siblings is None else siblings.wrong_keys),
    )
    # The outermost one: also what is refused for want of a key is counted.
    level = logging.INFO if chosen.log_format == "json" else logging.DEBUG
    app.add_middleware(Measured, metrics=metrics, level=level)
    app.encrypted = chosen.encrypted
    return app
