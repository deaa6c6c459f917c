"""A job whose workers are killed one after the other goes on from its last state on the next one."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from tests.integration.faults.load import start_worker
from tests.support.desk import Desk, wait_for


def test_a_job_outlives_two_killed_workers_and_does_no_kept_step_twice(
    fresh_database, database_url, tmp_path: Path
) -> None:
    desk = Desk(fresh_database)
    log, hold = tmp_path / "log", tmp_path / "log.hold"
    # States are kept once a second; each step is a little longer, so every one of them is.
    job = desk.ask("climb", steps=5, log=str(log), pause=1.01)
    running = {worker.pid: worker for worker in (start_worker(database_url, elsewhere=True) for _ in range(3))}
    delays = []
    for step in (1, 2):
        wait_for(lambda s=step: log.exists() and len(log.read_text().split()) > s, f"step {step}")
        hold.touch()  # it stays in this step until its worker is dead
        killed = desk.get(job)
        with desk.database.session() as session:
            pid = next(row.pid for row in _workers(session) if row.id == killed.worker)
        os.kill(pid, signal.SIGKILL)
        begun = time.monotonic()
        running.pop(pid).wait()
        hold.unlink()
        wait_for(lambda a=killed.attempts: desk.get(job).attempts > a, "the next worker")
        delays.append(time.monotonic() - begun)
    ended = desk.wait(job)
    for worker in running.values():
        worker.kill()
        worker.wait()
    desk.queue.close()
    assert (ended.status, ended.attempts) == ("succeeded", 3)
    steps = [int(line) for line in log.read_text().split()]
    assert sorted(set(steps)) == [0, 1, 2, 3, 4]
    # What was done before the step in which a worker died is done once.
    assert len(steps) <= 5 + 2
    assert steps == sorted(steps)
    # Missed by their heartbeats alone, of 0.2 s: with the 1 s of a service this is five times as long, and must be within 15 s.
    assert max(delays) < 10.0


def _workers(session):
    from storage.repositories import WorkerRepository

    return WorkerRepository(session).all()
