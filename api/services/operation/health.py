"""Whether the installation can work: database, migrations, a worker with a fresh heartbeat."""

from __future__ import annotations

import socket
from typing import Any

from api.services.operation.app_context import Installation
from storage.clock import shared_now
from storage.errors import UNAVAILABLE
from storage.repositories import WorkerRepository


def readiness(service: Installation) -> tuple[bool, dict[str, Any]]:
    """Return whether the service is ready, and what was found.

    A missing worker counts only where one runs beside the service.
    """
    checks = {"database": "ok", "migrations": "ok", "worker": "absent"}
    try:
        service.database.ping()
        if service.database.serves():
            checks["worker"] = _worker(service)
        else:
            checks["migrations"] = "behind"
    except UNAVAILABLE:
        checks["database"] = checks["migrations"] = "unavailable"
    sound = checks["database"] == "ok" and checks["migrations"] == "ok"
    ready = sound and (checks["worker"] == "ok" or service.beside is None)
    return ready, {"status": "ready" if ready else "not ready", "checks": checks}


def _worker(service: Installation) -> str:
    """Return how the worker beside the service is; without one, whether any worker lives."""
    beside = service.beside
    if beside is not None and not beside.alive():
        return "absent"
    with service.database.session() as session:
        workers = WorkerRepository(session)
        seen = workers.last_seen() if beside is None else workers.seen_of(socket.gethostname(), beside.pid)
        now = shared_now(session)
    if seen is None:
        return "absent"
    # A heartbeat of the future was written before the clock was set back, and none since.
    age = abs((now - seen).total_seconds())
    return "ok" if age <= service.settings.worker_stale_seconds else "stale"
