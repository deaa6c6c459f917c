"""The worker that does what is done for all is killed with `kill -9`: another one does it, nothing is lost and nothing is done twice."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import func, select

from storage.models import DEFAULT_WORKSPACE, Elected, Job, JobState, Result
from storage.repositories import JobRepository
from tests.integration.faults.load import start_worker
from tests.support.desk import FINAL, Desk, wait_for

WORKERS, ASIDE = 3, 4


def test_another_keeper_goes_on_and_does_nothing_twice(
    fresh_database, database_url: str, tmp_path: Path, rounds: int
) -> None:
    desk, jobs = Desk(fresh_database), list[str]()
    # All of this machine, whose end shows at once, but one: that one is missed by its silence, and so are those that follow.
    running = {worker.pid: worker for worker in (start_worker(database_url) for _ in range(WORKERS))}
    try:
        wait_for(lambda: holder(desk) is not None, "a keeper")
        for number in range(rounds):
            log = tmp_path / f"held {number}"
            held = desk.ask("climb", steps=1, log=str(log))
            log.with_suffix(".hold").touch()
            wait_for(lambda job=held: kept(desk, job), "a job in hand whose step is kept")
            before = holder(desk)
            assert before is not None
            killed = running.pop(int(str(before.process).split("/")[-2]))
            killed.kill()
            with desk.database.session() as session:  # in nobody's queue, until a keeper finds them
                aside = [
                    JobRepository(session, DEFAULT_WORKSPACE)
                    .create(kind="climb", body={"steps": 1, "log": str(tmp_path / f"aside {number} {i}")})
                    .id
                    for i in range(ASIDE)
                ]
            killed.wait()
            log.with_suffix(".hold").unlink()
            jobs += [held, *aside]
            for job in jobs:
                assert desk.wait(job).status == "succeeded"
            after = holder(desk)
            assert after is not None
            assert after.holder != before.holder
            assert int(str(after.process).split("/")[-2]) in running
            follower = start_worker(database_url)
            running[follower.pid] = follower
        done_once(desk, jobs, rounds)
    finally:
        for worker in running.values():
            worker.kill()
            worker.wait()
        desk.queue.close()


def holder(desk: Desk) -> Elected | None:
    """Return who does what is done for all."""
    with desk.database.session() as session:
        return session.get(Elected, "queue")


def kept(desk: Desk, job: str) -> bool:
    """Say whether a step of a job is written down."""
    with desk.database.session() as session:
        return session.get(JobState, job) is not None


def done_once(desk: Desk, jobs: list[str], rounds: int) -> None:
    """Hold that each job has been begun once, but for those that a killed worker had in hand, and has one end and one result."""
    rows = [desk.get(job) for job in jobs]
    for row in rows:
        lines = Path(row.body["log"]).read_text().splitlines()
        assert lines == ["0"]  # the one that a killed worker had in hand had been kept: it is not done again
        ends = [payload for _, kind, payload in desk.events(row.id) if kind == "status" and payload["status"] in FINAL]
        assert ends == [{"status": "succeeded"}]
    assert sum(row.attempts - 1 for row in rows) <= rounds  # one slot for each killed worker
    with desk.database.session() as session:
        assert session.scalar(select(func.count()).select_from(Result)) == len(jobs)
        assert session.scalar(select(func.count()).select_from(Job)) == len(jobs)
