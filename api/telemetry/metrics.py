"""Numbers for Prometheus: requests of this service, and the jobs and workers of the whole installation.

What concerns jobs is read from the database when it is asked for, so every process of the service tells the same, and its
counters outlive them all. Processes that share a port count requests in files, so that whichever is asked tells the sum.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.multiprocess import MultiProcessCollector
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from storage.clock import shared_now
from storage.errors import UNAVAILABLE
from storage.repositories import WorkerRepository
from storage.repositories import jobs as repository
from storage.repositories.workers import STALE_AFTER
from storage.session import Database

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"

_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.15, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60)

_log = logging.getLogger("servotune.requests")


class Metrics:
    """The numbers of a service.

    Parameters
    ----------
    shared : Path, optional
        The folder in which several processes count, as `prometheus_client` was told before it was loaded.
    """

    def __init__(self, shared: Path | None = None) -> None:
        self.registry = CollectorRegistry()
        self._told = self.registry if shared is None else CollectorRegistry()
        if shared is None:
            ProcessCollector(registry=self.registry)
        else:
            MultiProcessCollector(self._told, path=str(shared))  # type: ignore[no-untyped-call]  # as the library has it
            self._told.register(_Asked(partial(_of_processes, shared)))
        self.requests = Counter(
            "servotune_requests", "Requests answered", ("method", "route", "status"), registry=self.registry
        )
        self.seconds = Histogram(
            "servotune_request_seconds",
            "Time from request to the end of its reply",
            ("method", "route"),
            buckets=_SECONDS,
            registry=self.registry,
        )
        self.running = Gauge(
            "servotune_requests_running",
            "Requests being answered",
            registry=self.registry,
            multiprocess_mode="livesum",
        )

    def read_from(self, database: Database) -> None:
        """Let the numbers of jobs and workers come from this database."""
        self._told.register(_Asked(partial(_of_installation, database)))

    def text(self) -> bytes:
        """Return all numbers in Prometheus' text format."""
        return generate_latest(self._told)


class _Asked(Collector):
    """Tells what is found when somebody wants to know.

    Parameters
    ----------
    find : callable
        Yields the families of numbers as they are now.
    """

    def __init__(self, find: Callable[[], Iterator[Metric]]) -> None:
        self._find = find

    def describe(self) -> Iterable[Metric]:
        """Return nothing: what is registered is not asked yet."""
        return ()

    def collect(self) -> Iterator[Metric]:
        """Yield what is found."""
        yield from self._find()


def _of_processes(shared: Path) -> Iterator[Metric]:
    """Yield what each of several processes would tell alone, with its id as a label."""
    families: dict[str, Metric] = {}
    for file in sorted(shared.glob("gauge_livesum_*.db")):
        pid = file.stem.rpartition("_")[2]
        for family in ProcessCollector(pid=partial(int, pid), registry=None).collect():
            known = families.setdefault(family.name, Metric(family.name, family.documentation, family.type))
            for sample in family.samples:
                known.add_sample(sample.name, {**sample.labels, "process": pid}, sample.value)
    yield from families.values()


def _of_installation(database: Database) -> Iterator[Metric]:
    """Yield whether the database answers, and what it knows of jobs and workers."""
    try:
        found = list(_in_database(database))
    except UNAVAILABLE as error:
        _log.warning("the database does not tell the metrics: %s", error)
        found = []
    yield GaugeMetricFamily("servotune_database_up", "1 when the database answers", value=float(bool(found)))
    yield from found


def _in_database(database: Database) -> Iterator[Metric]:
    depth = GaugeMetricFamily("servotune_jobs", "Unfinished jobs and parts of jobs", labels=("kind", "status"))
    age = GaugeMetricFamily("servotune_queue_oldest_seconds", "Age of the oldest job that waits", labels=("kind",))
    ended = CounterMetricFamily("servotune_jobs_ended", "Jobs that have ended", labels=("kind", "status"))
    seconds = CounterMetricFamily(
        "servotune_job_seconds", "Time of ended jobs from their first start", labels=("kind", "status")
    )
    workers = GaugeMetricFamily("servotune_workers", "Workers by whether they live", labels=("state",))
    slots = GaugeMetricFamily("servotune_worker_slots", "Jobs that the living workers compute at a time")
    warm_up = GaugeMetricFamily(
        "servotune_kernel_warm_up_seconds", "Time that a worker took to load its kernels", labels=("worker",)
    )
    with database.session() as session:
        now = shared_now(session)
        for kind, status, count, oldest in repository.waiting(session):
            depth.add_metric((kind, status), count)
            if status == "queued":
                age.add_metric((kind,), max((now - oldest).total_seconds(), 0.0))
        for tally in repository.tallies(session):
            ended.add_metric((tally.kind, tally.status), tally.count)
            seconds.add_metric((tally.kind, tally.status), tally.seconds)
        known = WorkerRepository(session).all()
    living = [worker for worker in known if worker.seen_at >= now - STALE_AFTER]
    workers.add_metric(("alive",), len(living))
    workers.add_metric(("silent",), len(known) - len(living))
    slots.add_metric((), sum(worker.slots for worker in living))
    for worker in living:
        if worker.warm_up is not None:
            warm_up.add_metric((worker.id,), worker.warm_up)
    yield from (depth, age, ended, seconds, workers, slots, warm_up)


class Measured:
    """ASGI middleware: counts and times every request, by the route that answered it, and writes a line about it."""

    def __init__(self, app: ASGIApp, *, metrics: Metrics, level: int) -> None:
        self._app = app
        self._metrics = metrics
        self._level = level

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun, status = time.perf_counter(), 500

        async def noting(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        self._metrics.running.inc()
        try:
            await self._app(scope, receive, noting)
        finally:
            self._metrics.running.dec()
            taken = time.perf_counter() - begun
            # A path is of the caller's making; a route is ours, and there are only so many.
            route = getattr(scope.get("route"), "path", "none")
            method = scope["method"] if scope["method"] in _METHODS else "other"
            self._metrics.requests.labels(method, route, status).inc()
            self._metrics.seconds.labels(method, route).observe(taken)
            extra = {"method": method, "path": scope["path"], "status": status, "seconds": round(taken, 6)}
            _log.log(self._level, "%s %s: %d in %.3f s", method, scope["path"], status, taken, extra=extra)


_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
