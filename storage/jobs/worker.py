"""A worker: takes jobs from the queue of the database, and takes over those of workers that died."""

from __future__ import annotations

import logging
import os
import secrets
import socket
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from typing import ClassVar

from dbos import DBOS, DBOSClient, DBOSConfig

from storage import models
from storage.errors import UNAVAILABLE, StateError
from storage.jobs.children import Zygote
from storage.jobs.engine import APPLICATION, QUEUE, SERIALIZER, SHAPE, WORKFLOW
from storage.jobs.supervision import Supervisor
from storage.models.base import utc_now
from storage.repositories.workers import HEARTBEAT_INTERVAL, STALE_AFTER, WorkerRepository
from storage.session import Database, open_database

#: How often (s) a worker asks for a job.
_POLLING_INTERVAL = 0.1
#: How long (s) a stopping worker waits for its children to be gone.
_STOP_TIMEOUT = 10.0

_log = logging.getLogger(__name__)


@DBOS.workflow(name=WORKFLOW, max_recovery_attempts=None)
def _run_job(job_id: str) -> None:
    _compute(job_id)


@DBOS.step(name="compute")
def _compute(job_id: str) -> None:
    assert Worker.current is not None
    Worker.current.supervisor.run(job_id)


class Worker:
    """Does jobs in child processes; one for each process, because the job engine is one for each process.

    Parameters
    ----------
    url : str
        The database.
    compute : str
        ``module:function`` of the function that computes, see `storage.jobs.compute`.
    slots : int
        How many jobs it does at a time.
    """

    current: ClassVar[Worker | None] = None

    def __init__(self, url: str, *, compute: str, slots: int = 1) -> None:
        if slots < 1:
            raise ValueError(f"slots must be >= 1, got {slots}")
        self._url = url
        self._compute = compute
        self._slots = slots
        self._token = secrets.token_hex(8)
        self._ended = threading.Event()
        self._undo = ExitStack()

    def start(self) -> None:
        """Begin to take jobs, in threads of this process, from a migrated database.

        Raises
        ------
        StateError
            When this process has a worker already, or the database is not migrated.
        """
        if Worker.current is not None:
            raise StateError("a process can have one worker only")
        with ExitStack() as undo:  # in reverse order, whether the start fails or the worker stops
            self._ended.clear()
            self._database = open_database(self._url)
            undo.callback(self._database.dispose)
            if not self._database.is_current():
                raise StateError("the database must be migrated before a worker starts")
            zygote = Zygote(self._compute)
            undo.callback(zygote.close)
            zygote.warm_up()
            self.name = _claim_name(self._database, self._token, self._slots)
            undo.callback(self._retire)
            self.supervisor = Supervisor(self._database, zygote, worker=self.name, slots=self._slots)
            undo.callback(setattr, Worker, "current", None)
            Worker.current = self
            undo.callback(DBOS.destroy)
            self._launch()
            undo.callback(self.supervisor.stop, _STOP_TIMEOUT)
            heart = threading.Thread(target=self._beat, name="worker-heart", daemon=True)
            heart.start()
            undo.callback(heart.join)
            undo.callback(self._ended.set)
            self._undo = undo.pop_all()

    def stop(self) -> None:
        """Kill the children, give their jobs back to the queue, and let go of everything."""
        self._undo.close()

    def run(self, stop: threading.Event) -> None:
        """Work until ``stop`` is set, or until another process has taken this worker's name."""
        self.start()
        try:
            while not stop.wait(0.2) and not self._ended.is_set():
                pass
        finally:
            self.stop()

    def _launch(self) -> None:
        engine = self._database.engine
        client = DBOSClient(system_database_engine=engine, serializer=SERIALIZER, application_name=APPLICATION)
        # Before the launch, which would notice a new queue a second later.
        client.register_queue(QUEUE, worker_concurrency=self._slots, polling_interval_sec=_POLLING_INTERVAL)
        client.destroy()
        config: DBOSConfig = {
            "name": APPLICATION,
            "system_database_engine": engine,
            "executor_id": self.name,
            "application_version": SHAPE,
            "serializer": SERIALIZER,
            "log_level": "WARNING",
            "run_migrations": False,
        }
        DBOS(config=config)
        DBOS.listen_queues([QUEUE])
        DBOS.launch()

    def _retire(self) -> None:
        try:
            with self._database.session() as session:
                WorkerRepository(session).retire(self.name, self._token)
        except UNAVAILABLE as error:
            _log.warning("worker %s could not say that it stops: %s", self.name, error)

    def _beat(self) -> None:
        """Say that the worker lives, and look for those that do not."""
        while not self._ended.wait(HEARTBEAT_INTERVAL):
            try:
                with self._database.session() as session:
                    workers = WorkerRepository(session)
                    if not workers.beat(self.name, self._token):
                        _log.error("worker %s stops: another process has taken its name", self.name)
                        self._ended.set()
                        return
                    dead = workers.dead()
                recover(dead)
                with self._database.session() as session:
                    WorkerRepository(session).forget()
            except UNAVAILABLE as error:
                _log.warning("worker %s cannot reach the database: %s", self.name, error)


def recover(dead: Sequence[str]) -> None:
    """Put the unfinished jobs of dead workers back into the queue, where any worker takes them.

    The engine does this for an executor that starts again under its old name; for one that does not it offers a
    private call only (or a commercial service), which is used here and nowhere else, and held by a test.
    """
    if dead:
        DBOS._recover_pending_workflows(list(dead))  # noqa: SLF001 - no public call; held by a test


def _claim_name(database: Database, token: str, slots: int) -> str:
    """Take the first name ``<host>-<n>`` that no living process holds; its unfinished jobs come with it."""
    host = socket.gethostname()[:50]
    number = 0
    while True:
        name = f"{host}-{number}"
        with database.session() as session:
            workers = WorkerRepository(session)
            holder = workers.get(name)
            if holder is None or not _is_alive(holder):
                replaces = None if holder is None else holder.token
                if workers.claim(name, token=token, replaces=replaces, host=host, pid=os.getpid(), slots=slots):
                    return name
        number += 1


def _is_alive(holder: models.Worker) -> bool:
    """Tell whether another process of this host still holds a name: it exists, and its heartbeat is fresh."""
    if holder.pid == os.getpid() or holder.seen_at <= utc_now() - STALE_AFTER:
        return False
    try:
        os.kill(holder.pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True  # it exists, under another user
    return True
