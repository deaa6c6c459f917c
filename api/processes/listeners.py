"""A service of several processes: each listens on the same port, and the system deals the connections out to them.

An interpreter computes on one core at a time, so one process answers no more requests than one core can; what Postgres does
for them comes on top. The first process also looks after schedules, leases and messages; the worker beside the service
belongs to the one that started them all, which answers nothing itself.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prometheus_client.multiprocess import mark_process_dead

from api.runtime.arguments import at_end_of_input, stopped_by_signals
from api.runtime.child_process import Kept, worker_beside
from api.runtime.shared_memory import SiblingOfWorker, Siblings

if TYPE_CHECKING:
    from api.settings import Settings

_CODE = "import sys; from api.commands.service import answer; sys.exit(answer({}))"


def run(*, host: str, port: int, count: int, worker: bool) -> None:
    """Let processes answer requests until this one is told to stop; one that dies is replaced.

    Raises
    ------
    OSError
        When nobody may listen there.
    """
    stop = stopped_by_signals()
    with tempfile.TemporaryDirectory(prefix="servotune-") as folder, _reserved(host, port) as reserved:
        siblings = Siblings(Path(folder), count)
        kept = []
        try:
            if worker:
                kept.append(worker_beside(started=siblings.worker.set, ended=lambda _: siblings.worker.set(0)))
            for number in range(count):
                told = {"folder": folder, "count": count, "number": number, "host": host, "port": reserved}
                kept.append(_kept(siblings, {**told, "worker": worker}))
            stop.wait()
        finally:
            with ThreadPoolExecutor(count + 1) as threads:
                list(threads.map(Kept.stop, kept))


def _kept(siblings: Siblings, told: dict[str, Any]) -> Kept:
    numbers = str(siblings.numbers)
    return Kept(
        f"process {told['number'] + 1} of the service",
        _CODE.format(repr(json.dumps(told))),
        environment={"PROMETHEUS_MULTIPROC_DIR": numbers},
        ended=lambda pid: mark_process_dead(pid, numbers),  # type: ignore[no-untyped-call]  # as the library has it
    )


def answer(settings: Settings, told: str) -> bool:
    """Be one of the processes, as ``told`` by the one that started it, until that is gone; return whether it ever began to."""
    from api.app.main import create_app  # noqa: PLC0415 - as above
    from api.processes import serving  # noqa: PLC0415 - the process that starts the others needs none of it

    given = json.loads(told)
    at_end_of_input(lambda: os.kill(os.getpid(), signal.SIGTERM))
    siblings = Siblings(Path(given["folder"]), given["count"])
    app = create_app(
        settings.model_copy(update={"compute_slots": max(settings.compute_slots // siblings.count, 1)}),
        beside=SiblingOfWorker(siblings) if given["worker"] else None,
        siblings=siblings,
        keeps_time=given["number"] == 0,
    )
    with _bound(given["host"], given["port"]) as own:
        return serving.run(
            app, host=given["host"], port=given["port"], listeners=[own], proxies=settings.trusted_proxies
        )


@contextmanager
def _reserved(host: str, port: int) -> Iterator[int]:
    """Keep a port, where nobody listens yet, for these processes; give its number."""
    with socket.create_server((host, port), family=_family(host)) as alone:
        free = int(alone.getsockname()[1])
    with _bound(host, free):
        yield free


def _bound(host: str, port: int) -> socket.socket:
    """Return a socket at a port that the processes of one user share; connections come to it once somebody listens.

    Its protocol is named: otherwise asyncio does not know that it is TCP, and leaves the second packet of each answer waiting
    until the client has acknowledged the first, which takes it 40 ms.
    """
    own = socket.socket(_family(host), proto=socket.IPPROTO_TCP)
    own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    own.bind((host, port))
    return own


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET
