"""What is done for all workers: whatever should be in the queue and is not comes back there.

Every one looks after the dead and after its own claims; the rest is done by the one that is elected. Those that are not ask the
database half as often, and see by themselves when a process of their machine has ended: a hundred of them must cost it little. A worker
that sleeps until a job is handed out claims none meanwhile, so it looks once in each sleep whether it has claims.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

from sqlalchemy.orm import Session

from storage import models, processes
from storage.election import Election
from storage.errors import UNAVAILABLE
from storage.jobs import requeue
from storage.jobs.bell import ring
from storage.jobs.claims import Claims
from storage.jobs.liveness import Pulse
from storage.jobs.private_calls import recover
from storage.jobs.queue import JobQueue
from storage.jobs.supervision import Supervisor
from storage.jobs.time_limits import overdue_detail
from storage.repositories import jobs
from storage.repositories.workers import PATIENCE, Heartbeat, WorkerRepository
from storage.session import Database

#: How often (s) a worker looks for jobs that nobody carries.
_RECONCILE_INTERVAL = 60.0
#: Every how many looks a worker that is not elected asks the database.
_SELDOM = 2

_log = logging.getLogger(__name__)


class Keeper:
    """Takes over the jobs of dead workers, begins forgotten ones again, ends overdue ones, hands out what was put aside.

    Parameters
    ----------
    database : Database
    queue : JobQueue
    supervisor : Supervisor
        What does the jobs of this worker.
    worker : str
        Its name.
    interval : float
        How often (s) workers show that they live, and this one looks.
    asleep : callable
        Which of its sleeps the worker is in; None while it may claim jobs.
    ended : threading.Event
        Ends `run` and `watch`, and is set when one of them ends in any other way.
    """

    def __init__(
        self,
        database: Database,
        queue: JobQueue,
        supervisor: Supervisor,
        *,
        worker: str,
        interval: float,
        asleep: Callable[[], int | None],
        ended: threading.Event,
    ) -> None:
        self._database = database
        self._queue = queue
        self._supervisor = supervisor
        self._worker = worker
        self._interval = interval
        self._asleep = asleep
        self._without_claims: int | None = None  # the sleep in which nothing was found to be claimed
        self._ended = ended
        self._pulse = Pulse(PATIENCE * interval)
        self._claims = Claims(PATIENCE * interval)
        self._reconcile_at: float | None = None
        self._election = Election(database, "queue", patience=PATIENCE * interval)
        self._neighbours: Sequence[str | None] = ()
        self._watched = self._looked = 0

    def elected(self) -> bool:
        """Whether this worker was elected when it last looked."""
        return self._election.won

    def watch(self) -> None:
        """Take over the jobs of dead workers, again and again: nothing else that has to be done delays that."""
        self._again_and_again(self._take_over, "look after the other workers")

    def run(self) -> None:
        """Look after the queue again and again, first for those that wait for a worker."""
        self._again_and_again(self._look_after, "look after the queue")

    def resign(self) -> None:
        """Leave what is done for all to another worker, at once; nobody works for this one any more."""
        try:
            self._election.resign()
        except UNAVAILABLE as error:
            _log.warning("worker %s could not resign: %s", self._worker, error)

    def _again_and_again(self, work: Callable[[], None], what: str) -> None:
        try:
            while not self._ended.wait(self._interval):
                try:
                    work()
                except UNAVAILABLE as error:
                    _log.warning("worker %s cannot %s: %s", self._worker, what, error)
        finally:
            self._ended.set()

    def _look_after(self) -> None:
        self._looked += 1
        if self._looked % _SELDOM == 0:
            self._begin_again()
        if not self._election.due(usual=self._looked % _SELDOM == 1):
            return
        elected = self._election.elected()
        if elected:
            with self._database.session() as session:
                _end_overdue(session)
                self._queue.release(session)
        # Whoever begins looks once, elected or not: it may have lost its name, and what it claimed under that name before it noticed
        # would wait for the elected one's next look.
        if self._reconcile_at is None or (elected and time.monotonic() >= self._reconcile_at):
            self._reconcile()
            self._reconcile_at = time.monotonic() + _RECONCILE_INTERVAL

    def _take_over(self) -> None:
        """Put the jobs of dead workers back into the queue, and then forget these workers."""
        self._watched += 1
        gone = any(processes.alive(process) is False for process in self._neighbours)
        if not (self.elected() or gone or self._watched % _SELDOM == 1):
            return
        with self._database.one_by_one() as session:
            workers = WorkerRepository(session).heartbeats()
        dead = self._pulse.dead(workers)
        self._neighbours = [worker.process for worker in workers if processes.alive(worker.process)]
        if not dead:
            return
        _log.warning("the jobs of dead workers go on elsewhere: %s", ", ".join(worker.id for worker in dead))
        recover([worker.id for worker in dead])
        with self._database.session() as session:
            self._bury(session, dead)
            ring(session)

    def _bury(self, session: Session, dead: Sequence[Heartbeat]) -> None:
        for worker in dead:
            WorkerRepository(session).bury(worker.id, token=worker.token, seen_at=worker.seen_at)

    def _begin_again(self) -> None:
        """Put jobs that the engine claimed and never began back into the queue."""
        sleep = self._asleep()
        if sleep is not None and sleep == self._without_claims:
            return
        with self._database.one_by_one() as session:
            claimed = requeue.claimed(session, self._worker)
        self._without_claims = None if claimed else sleep
        forgotten = self._claims.forgotten(claimed, in_hand=self._supervisor.in_hand)
        if not forgotten:
            return
        with self._database.session() as session:
            rows = requeue.holders(session, forgotten)
            self._queue.carry(session, rows)
        for job in rows:
            _log.warning("job %s was claimed and never begun, and is in the queue again", job.id)

    def _reconcile(self) -> None:
        with self._database.one_by_one() as session:
            strangers = requeue.strangers(session)
        recover(strangers)
        with self._database.session() as session:
            whole = requeue.joined(session)
            self._queue.release(session)
        for identifier in whole:
            _log.warning(
                "job %s was cut into parts by an earlier version, and is in the queue again, whole", identifier
            )
        with self._database.session() as session:
            lost = requeue.uncarried(session)
            self._queue.carry(session, lost)
            if strangers:
                ring(session)
        for job in lost:
            _log.warning("job %s was carried by nobody and is in the queue again", job.id)


def _end_overdue(session: Session) -> None:
    for identifier in jobs.overdue(session):
        job = session.get_one(models.Job, identifier)
        problem = {"type": "urn:servotune:problem:overdue", "title": "Out of time", "detail": overdue_detail(job)}
        jobs.finish(session, identifier, status=models.JobStatus.FAILED, error=problem)
