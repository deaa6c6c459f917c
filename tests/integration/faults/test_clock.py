"""The clock of one machine jumps by an hour, forwards and back: nothing runs twice, is lost, or is taken for dead."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import pytest
from sqlalchemy import select, update

from api.services.operation.app_context import Installation
from api.services.schedules import ticking
from storage import Database
from storage.clock import WALL, utc_now
from storage.models import AcquisitionAttempt, Worker
from storage.repositories import WorkerRepository
from tests.integration.api.conftest import serving
from tests.integration.api.rigs import AGENT, MEASUREMENT
from tests.integration.api.test_schedules import NIGHTLY, NOON
from tests.integration.faults.conftest import FULL
from tests.support.desk import COMPUTE, Desk, wait_for

HOUR = timedelta(hours=1)
JUMPS = {"forwards": HOUR, "back": -HOUR}


def jumps(*always: str) -> pytest.MarkDecorator:
    """Let a clock jump in these directions, and in the others where everything goes wrong."""
    return pytest.mark.parametrize(
        "jump", [JUMPS[name] for name in (JUMPS if FULL else always)], ids=JUMPS if FULL else always
    )


#: A worker whose clock, and that of the job engine in it, is an hour ahead or behind when it is told so on its standard input.
WORK = """
import sys, threading, time
from datetime import timedelta
from storage.clock import WALL
from storage.jobs.worker import Worker
real = time.time
time.time = lambda: real() + WALL.ahead.total_seconds()
def listen():
    for line in sys.stdin:
        WALL.ahead = timedelta(seconds=float(line))
threading.Thread(target=listen, daemon=True).start()
Worker(sys.argv[1], compute=sys.argv[2], heartbeat=0.2).run(threading.Event())
"""


class Machine:
    """A worker on a machine whose clock can be set."""

    def __init__(self, url: str) -> None:
        self.process = subprocess.Popen([sys.executable, "-c", WORK, url, COMPUTE], stdin=subprocess.PIPE)

    def set_clock(self, ahead: timedelta) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{ahead.total_seconds()}\n".encode())
        self.process.stdin.flush()

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def running(sqlite_template: Path, tmp_path: Path) -> Iterator[tuple[httpx.Client, Installation]]:
    """A service whose clock a test may set, with a client; in the end the clock is right again."""
    path = tmp_path / "service.db"
    path.write_bytes(sqlite_template.read_bytes())
    # A heartbeat is missed after ten minutes: less than a jump, and more than any pause of the machine.
    with serving(f"sqlite:///{path}", worker_stale_seconds=600.0) as service, service.client() as client:
        assert service.app is not None
        try:
            yield client, service.app.state.installation
        finally:
            WALL.ahead = timedelta(0)


def heartbeats(database: Database) -> dict[int, object]:
    with database.session() as session:
        return {row.pid: row.seen_at for row in WorkerRepository(session).all()}


@jumps("back")
def test_jobs_go_on_where_they_are_and_nobody_dies(
    fresh_database: Database, database_url: str, tmp_path: Path, jump: timedelta
) -> None:
    desk = Desk(fresh_database)
    machines = {machine.process.pid: machine for machine in (Machine(database_url), Machine(database_url))}
    log, hold = tmp_path / "log", tmp_path / "log.hold"
    hold.touch()
    try:
        limit = {"time_limit": 600.0, "deadline": utc_now() + timedelta(hours=12)}
        job = desk.ask_in("ws_default", "climb", queue=limit, steps=3, log=str(log))
        wait_for(log.exists, "the first step")
        with fresh_database.session() as session:
            pid = session.get_one(Worker, desk.get(job).worker).pid
        machines[pid].set_clock(jump)
        other = next(number for number in machines if number != pid)
        # The other worker has looked for many more heartbeats than may be missing.
        for _ in range(12):
            before = heartbeats(fresh_database)
            wait_for(lambda b=before: heartbeats(fresh_database).get(other) not in {b.get(other), None}, "a heartbeat")
            wait_for(lambda b=before: heartbeats(fresh_database).get(pid) not in {b.get(pid), None}, "a heartbeat")
        queued = desk.ask("square", values=[2.0], pause=0.0)
        hold.unlink()
        ended = desk.wait(job)
        assert (ended.status, ended.attempts, ended.error) == ("succeeded", 1, None)
        assert log.read_text().split() == ["0", "1", "2"]
        assert desk.wait(queued).status == "succeeded"
        assert set(heartbeats(fresh_database)) == set(machines)
    finally:
        for machine in machines.values():
            machine.end()
        desk.queue.close()


@pytest.mark.parametrize("database_url", ["postgres"], indirect=True)  # the workers of SQLite have one clock
@jumps("forwards")
def test_a_job_of_a_killed_worker_goes_on_at_one_whose_clock_is_wrong(
    fresh_database: Database, database_url: str, tmp_path: Path, jump: timedelta
) -> None:
    """Its limit has not run out, although the machines disagree about the time: they ask the database."""
    desk = Desk(fresh_database)
    first, second = Machine(database_url), None
    log, hold = tmp_path / "log", tmp_path / "log.hold"
    hold.touch()
    try:
        job = desk.ask_in("ws_default", "climb", queue={"time_limit": 600.0}, steps=2, log=str(log))
        wait_for(log.exists, "the first step")
        second = Machine(database_url)
        second.set_clock(jump)
        first.end()
        hold.unlink()
        ended = desk.wait(job)
        assert (ended.status, ended.attempts, ended.error) == ("succeeded", 2, None)
    finally:
        first.end()
        if second is not None:
            second.end()
        desk.queue.close()


def lease_of(database: Database, acquisition: str) -> datetime | None:
    with database.session() as session:
        return session.scalars(
            select(AcquisitionAttempt.lease_until).where(AcquisitionAttempt.acquisition_id == acquisition)
        ).one()


@jumps("forwards", "back")
def test_a_lease_outlives_the_jump_and_ends_when_nobody_keeps_it(
    running: tuple[httpx.Client, Installation], jump: timedelta
) -> None:
    client, installation = running
    database = installation.database
    agent = client.post("/v1/agents", json=AGENT).json()["id"]
    assert client.post("/v1/acquisitions", json=MEASUREMENT).status_code == 202
    claim = client.post(f"/v1/agents/{agent}/claim").json()
    measurement = f"/v1/acquisitions/{claim['acquisition']}"
    before = lease_of(database, claim["acquisition"])
    assert before is not None
    WALL.ahead = jump
    # The service's next look gives it a whole lease by the new time, no less and no hour more.
    moved = lambda: (lease_of(database, claim["acquisition"]) or before) - before  # noqa: E731 - said once
    wait_for(lambda: abs(moved() - jump) < HOUR / 2, "a lease by the new time")
    beat = client.post(
        f"{measurement}/attempts/1/heartbeat", json={"agent": agent, "status": "running", "progress": 0.5}
    )
    assert beat.status_code == 200, beat.text
    assert client.get(measurement).json()["status"] == "running"
    with database.session() as session:
        session.execute(update(AcquisitionAttempt).values(lease_until=utc_now() - timedelta(seconds=1)))
    wait_for(lambda: client.get(measurement).json()["status"] == "lost", "the end of the lease")


@jumps("forwards", "back")
def test_an_instant_that_comes_round_again_is_run_once(
    running: tuple[httpx.Client, Installation], jump: timedelta
) -> None:
    """A clock is set, and the schedule is paused and resumed, which lets it count its instants anew."""
    client, installation = running
    where = client.post("/v1/schedules", json=NIGHTLY | {"overlap": "queue", "paused": True}).headers["Location"]
    for now in (NOON, NOON + jump, NOON, NOON + HOUR):
        WALL.ahead = now - datetime.now(UTC)
        client.post(f"{where}/pause")
        resumed = client.post(f"{where}/resume").json()
        instant = datetime.fromisoformat(resumed["next_at"])
        WALL.ahead = instant - datetime.now(UTC)
        ticking.tick(installation, now=instant)
    runs = client.get(f"{where}/runs").json()["items"]
    started = [run["due_at"] for run in runs if run["outcome"] in {"started", "waiting"}]
    assert len(started) == len(set(started)) >= 1, runs


@jumps("forwards", "back")
def test_a_worker_that_is_silent_since_the_jump_is_seen_to_be(
    running: tuple[httpx.Client, Installation], jump: timedelta
) -> None:
    client, installation = running
    with installation.database.session() as session:
        workers = WorkerRepository(session)
        workers.claim("lab-0", token="a", replaces=None, host="lab", pid=1, slots=1)
    assert client.get("/readyz").json()["checks"]["worker"] == "ok"
    WALL.ahead = jump
    assert client.get("/readyz").json()["checks"]["worker"] == "stale"
    with installation.database.session() as session:
        assert WorkerRepository(session).beat("lab-0", "a")
    assert client.get("/readyz").json()["checks"]["worker"] == "ok"
