"""A worker: takes jobs from the queue of the database, and takes over those of workers that died."""

from __future__ import annotations

import logging
import os
import secrets
import socket
import threading
import time
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from typing import ClassVar

from dbos import DBOS, DBOSClient, DBOSConfig

from storage import models, processes
from storage.clock import shared_now
from storage.errors import UNAVAILABLE, StateError, UnmigratedError
from storage.jobs import private_calls
from storage.jobs.bell import Bell
from storage.jobs.children import Zygote
from storage.jobs.engine import APPLICATION, QUEUE, SERIALIZER, SHAPE, WORKFLOW
from storage.jobs.maintenance import Keeper
from storage.jobs.queue import JobQueue
from storage.jobs.supervision import Supervisor, Traced, untraced
from storage.objects import ObjectStore
from storage.repositories.workers import HEARTBEAT_INTERVAL, RETIRED, STALE_AFTER, WorkerRepository
from storage.session import Database, open_database

#: Jobs of one workspace: what limits them is its quota.
_NO_LIMIT = 1_000_000
#: How often (s) a worker asks for a job.
_POLLING_INTERVAL = 0.1
#: The pauses (s) before a worker asks again for a database that is away when it starts, the longest of them, and how long it
#: waits altogether.
_PAUSE, _LONGEST_PAUSE, _LONGEST_WAIT = 0.5, 10.0, 600.0
#: How long (s) a stopping worker waits for its children to be gone.
_STOP_TIMEOUT = 10.0

_log = logging.getLogger(__name__)


@DBOS.workflow(name=WORKFLOW, max_recovery_attempts=None)
def _run_job(job_id: str) -> None:
    ticket = DBOS.workflow_id
    assert ticket is not None
    _compute(job_id, ticket)


@DBOS.step(name="compute")
def _compute(job_id: str, ticket: str) -> None:
    worker = Worker.current
    assert worker is not None
    try:
        worker.supervisor.run(job_id, ticket)
    finally:
        worker.bell.wake()  # there is room for another one


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
    heartbeat : float
        How often (s) it shows that it lives, half as often while it has nothing to do; another one that does not for `PATIENCE` times as long is dead.
    traced : Traced, optional
        What surrounds each attempt at a job, for whoever collects traces.
    direct : str, optional
        The same database past the pooler that ``url`` names: there the worker listens for jobs.
    objects : ObjectStore, optional
        Where blobs may lie beside the database.
    """

    current: ClassVar[Worker | None] = None

    def __init__(
        self,
        url: str,
        *,
        compute: str,
        slots: int = 1,
        heartbeat: float = HEARTBEAT_INTERVAL,
        traced: Traced = untraced,
        direct: str | None = None,
        objects: ObjectStore | None = None,
    ) -> None:
        if slots < 1:
            raise ValueError(f"slots must be >= 1, got {slots}")
        self._url = url
        self._direct = direct
        self._objects = objects
        self._compute = compute
        self._lost = ""
        self._slots = slots
        self._heartbeat = heartbeat
        self._traced = traced
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
            self._database = open_database(self._url, objects=self._objects)
            undo.callback(self._database.dispose)
            if not self._database.serves():
                raise UnmigratedError("the database must be migrated before a worker starts")
            zygote = Zygote(self._compute)
            undo.callback(zygote.close)
            zygote.warm_up()
            self.name = _claim_name(self._database, self._token, self._slots, lost=self._lost)
            undo.callback(self._retire)
            self._queue = JobQueue(self._database)
            undo.callback(self._queue.close)
            self.supervisor = Supervisor(
                self._database, self._queue, zygote, worker=self.name, slots=self._slots, traced=self._traced
            )
            heard = self._database if self._direct is None else open_database(self._direct, connections=1)
            undo.callback(heard.dispose)
            self.bell = Bell(heard, ended=self._ended)
            undo.callback(setattr, Worker, "current", None)
            Worker.current = self
            undo.callback(DBOS.destroy)
            engine = self._launch(zygote)
            undo.callback(_wait_for_ended, engine)
            undo.callback(self.supervisor.stop, _STOP_TIMEOUT)
            keeper = Keeper(
                self._database,
                self._queue,
                self.supervisor,
                worker=self.name,
                interval=self._heartbeat,
                asleep=lambda: self.bell.asleep,
                ended=self._ended,
            )
            undo.callback(keeper.resign)
            private_calls.rest(engine, keeper.elected)
            for work, name in (
                (self.bell.listen, "worker-bell"),
                (partial(self._beat, zygote), "worker-heart"),
                (keeper.watch, "worker-watch"),
                (keeper.run, "worker-keeper"),
            ):
                thread = threading.Thread(target=work, name=name, daemon=True)
                thread.start()
                undo.callback(thread.join)
            undo.callback(self.bell.wake)
            undo.callback(self._ended.set)
            self._undo = undo.pop_all()

    def stop(self) -> None:
        """Kill the children, give their jobs back to the queue, and let go of everything."""
        self._undo.close()

    def run(self, stop: threading.Event) -> None:
        """Work until ``stop`` is set; a worker that was silent for so long that it lost its name begins again.

        Raises
        ------
        StateError
            When the database is not migrated for ten minutes.
        storage.errors.UNAVAILABLE
            When it does not answer for ten minutes.
        """
        while self._start_patiently(stop):
            try:
                while not stop.wait(0.2) and not self._ended.is_set():
                    pass
            finally:
                self.stop()

    def _start_patiently(self, stop: threading.Event) -> bool:
        """Start, once the database answers and is migrated; False when told to stop before."""
        awaited_errors: tuple[type[Exception], ...] = (*UNAVAILABLE, UnmigratedError)
        pause, give_up_at = _PAUSE, time.monotonic() + _LONGEST_WAIT
        while not stop.is_set():
            try:
                self.start()
            except awaited_errors as error:
                if time.monotonic() >= give_up_at:
                    raise
                awaited = "the database to be migrated" if isinstance(error, UnmigratedError) else "the database"
                reason = str(error).splitlines()[0]
                _log.warning("the worker waits for %s, and asks again in %.1f s: %s", awaited, pause, reason)
                stop.wait(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)
            else:
                return True
        return False

    def _launch(self, zygote: Zygote) -> DBOS:
        engine = self._database.engine
        client = DBOSClient(system_database_engine=engine, serializer=SERIALIZER, application_name=APPLICATION)
        # Before the launch, which would notice a new queue a second later. A limit for each partition is what makes the
        # engine ask them in turn; with no slots for anybody nothing is taken before `limit_claims`.
        client.register_queue(
            QUEUE, worker_concurrency=0, partition_concurrency=_NO_LIMIT, polling_interval_sec=_POLLING_INTERVAL
        )
        client.destroy()
        config: DBOSConfig = {
            "name": APPLICATION,
            "system_database_engine": engine,
            "executor_id": self.name,
            "application_version": SHAPE,
            "serializer": SERIALIZER,
            "log_level": "WARNING",
            "run_migrations": False,
            "use_listen_notify": False,  # messages between workflows, of which ours send none: it looks for them a hundred times a second
        }
        engine_instance = DBOS(config=config)
        DBOS.listen_queues([QUEUE])
        DBOS.launch()
        # Workers have different numbers of slots. One that has just been started, perhaps in place of one that died, would keep a
        # job waiting for as long as it loads, while another one could go on with it at once.
        private_calls.limit_claims(
            engine_instance,
            QUEUE,
            lambda: self._slots if zygote.settled(0.0) else 0,
            wait=lambda: self.bell.wait() if zygote.settled(0.0) else None,
        )
        return engine_instance

    def _retire(self) -> None:
        try:
            with self._database.session() as session:
                WorkerRepository(session).retire(self.name, self._token)
        except UNAVAILABLE as error:
            _log.warning("worker %s could not say that it stops: %s", self.name, error)

    def _beat(self, zygote: Zygote) -> None:
        """Say that the worker lives, and nothing else, so that nothing keeps it from being said; half as often while it has nothing to do."""
        warm = said = False
        try:
            while not self._ended.wait(self._heartbeat):
                if said and not self.supervisor.in_hand:
                    said = False
                    continue
                try:
                    with self._database.one_by_one() as session:
                        workers = WorkerRepository(session)
                        if not workers.beat(self.name, self._token):
                            _log.warning("worker %s lost its name, because it was silent for too long", self.name)
                            self._lost = self.name
                            return
                        if not warm and zygote.warm_up_seconds is not None:
                            workers.warmed_up(self.name, self._token, zygote.warm_up_seconds)
                            warm = True
                    said = True
                except UNAVAILABLE as error:
                    _log.warning("worker %s cannot reach the database: %s", self.name, error)
        finally:
            self._ended.set()  # whatever stopped the heart: `run` begins again


def _wait_for_ended(engine: DBOS) -> None:
    """Wait until the engine has written down how the workflows ended that this process has left.

    Without its database it could not, and the workflow of a job that has ended would count as unfinished until a worker of
    the same name begins. The engine's own wait takes a second at least.
    """
    give_up_at = time.monotonic() + _STOP_TIMEOUT
    while private_calls.running_workflows(engine, QUEUE) and time.monotonic() < give_up_at:
        time.sleep(0.01)


def _claim_name(database: Database, token: str, slots: int, *, lost: str) -> str:
    """Take the first name ``<host>-<n>`` that no living process holds and that was not lost; its unfinished jobs come with it."""
    host = socket.gethostname()[:50]
    number = 0
    while True:
        name = f"{host}-{number}"
        with database.session() as session:
            workers = WorkerRepository(session)
            holder = workers.get(name)
            if name != lost and (holder is None or not _is_alive(holder, now=shared_now(session))):
                replaces = None if holder is None else holder.token
                if workers.claim(
                    name,
                    token=token,
                    replaces=replaces,
                    host=host,
                    pid=os.getpid(),
                    process=processes.this_process(),
                    slots=slots,
                ):
                    return name
        number += 1


def _is_alive(holder: models.Worker, *, now: datetime) -> bool:
    """Tell whether another process still holds a name of this host, as far as can be told without waiting."""
    if holder.seen_at == RETIRED:
        return False
    known = processes.alive(holder.process)
    return abs(now - holder.seen_at) < STALE_AFTER if known is None else known
