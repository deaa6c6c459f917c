"""Schedules over HTTP, and the tick with a clock of the test's own."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from sqlalchemy import insert

from api.services.jobs.computing import Computing
from api.services.operation.app_context import Installation
from api.services.schedules import ticking
from api.settings import Settings
from api.telemetry.tracing import Traces, traces_of
from storage import open_database
from storage.audit import entries
from storage.jobs.queue import JobQueue
from storage.models import DEFAULT_WORKSPACE, Schedule
from storage.repositories import AlertRepository, JobRepository, ScheduleRepository, SystemRepository
from tests.integration.api.documents import LAG, OPTIMIZATION
from tests.support.collecting import collector, spans_of

JOB = {"kind": "optimization", "body": OPTIMIZATION | {"system": LAG}}
NIGHTLY = {"name": "nightly", "cron": "30 2 * * *", "time_zone": "Europe/Berlin", "job": JOB}
NOON = datetime(2031, 5, 6, 12, 0, tzinfo=UTC)  # far enough away for the service's own tick not to meddle
MINUTE = timedelta(minutes=1)


def test_a_schedule_is_made_changed_paused_run_and_deleted(client) -> None:
    created = client.post("/v1/schedules", json=NIGHTLY)
    assert created.status_code == 201, created.text
    body = created.json()
    where = created.headers["Location"]
    assert body["document"] == NIGHTLY | {"overlap": "skip", "missed": "one", "paused": False, "newest": None}
    assert body["next_at"] == body["next_runs"][0]
    assert len(body["next_runs"]) == 5
    assert {datetime.fromisoformat(instant).strftime("%M") for instant in body["next_runs"]} == {"30"}
    assert client.get(where).headers["ETag"] == created.headers["ETag"] == '"1"'

    assert client.put(where, json=NIGHTLY).status_code == 428
    changed = client.put(where, json=NIGHTLY | {"cron": "0 3 * * *"}, headers={"If-Match": '"1"'})
    assert (changed.status_code, changed.json()["cron"], changed.headers["ETag"]) == (200, "0 3 * * *", '"2"')
    assert client.put(where, json=NIGHTLY, headers={"If-Match": '"1"'}).status_code == 412

    paused = client.post(f"{where}/pause").json()
    assert (paused["paused"], paused["next_at"], paused["next_runs"], paused["revision"]) == (True, None, [], 3)
    assert client.post(f"{where}/pause").json()["revision"] == 3

    # Paused or not, it runs when it is told to.
    triggered = client.post(f"{where}/trigger", headers={"Idempotency-Key": "now"})
    assert triggered.status_code == 202
    assert client.post(f"{where}/trigger", headers={"Idempotency-Key": "now"}).json() == triggered.json()
    job = client.get(triggered.headers["Location"]).json()
    assert (job["id"], job["schedule"], job["kind"]) == (triggered.json()["job"], body["id"], "optimization")
    listed = client.get("/v1/jobs", params={"schedule": body["id"]}).json()["items"]
    assert [item["id"] for item in listed] == [job["id"]]
    assert [run["outcome"] for run in client.get(f"{where}/runs").json()["items"]] == ["started"]
    skipped = client.post(f"{where}/trigger")
    assert skipped.status_code == 409
    assert job["id"] in skipped.json()["detail"]
    client.post(f"/v1/jobs/{job['id']}/cancel")

    assert client.post(f"{where}/resume").json()["next_runs"]
    found = client.get("/v1/audit", params={"target": body["id"]}).json()["items"]
    assert [entry["action"].removeprefix("schedule.") for entry in reversed(found)] == [
        "create", "update", "pause", "resume",
    ]  # fmt: skip
    assert client.delete(where).status_code == 428
    assert client.delete(where, headers={"If-Match": "*"}).status_code == 204
    assert client.get(where).status_code == 404
    assert client.get(f"/v1/jobs/{job['id']}").json()["schedule"] == body["id"]


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"cron": "99 * * * *"}, "/cron"),
        ({"time_zone": "Nowhere"}, "/time_zone"),
        ({"overlap": "both"}, "/overlap"),
        ({"missed": "some"}, "/missed"),
        ({"job": {"kind": "simulation", "body": {}}}, "/job/kind"),
        ({"job": {"kind": "optimization", "body": {}}}, "/job/body/system"),
        ({"job": {"kind": "optimization", "body": OPTIMIZATION | {"system": "sys_none"}}}, "/job/body/system"),
        (
            {
                "job": {
                    "kind": "optimization",
                    "body": OPTIMIZATION | {"system": LAG, "variables": [{"parameter": "x"}]},
                }
            },
            "/job/body/variables/0",
        ),
        ({"start": "now"}, "/start"),
    ],
)
def test_a_wrong_schedule_is_refused_at_its_place(client, change, pointer) -> None:
    reply = client.post("/v1/schedules", json=NIGHTLY | change)
    assert reply.status_code == 422
    assert reply.json()["errors"][0]["pointer"].startswith(pointer), reply.text


class Desk:
    """An installation without a server: schedules as they are made, ticks when the test says so."""

    def __init__(self, url: str, traces: Traces | None = None) -> None:
        self.database = open_database(url)
        self.service = Installation(
            settings=Settings(database_url=url),
            database=self.database,
            queue=JobQueue(self.database),
            computing=Computing(Settings()),
            traces=traces or Traces(),
        )

    def close(self) -> None:
        self.service.queue.close()
        self.database.dispose()

    def schedule(self, **values: Any) -> str:
        given = {
            "name": "s", "cron": "* * * * *", "time_zone": "UTC", "kind": "optimization", "body": JOB["body"],
            "overlap": "skip", "missed": "one", "paused": False, "next_at": NOON,
        }  # fmt: skip
        with self.database.session() as session:
            return ScheduleRepository(session, DEFAULT_WORKSPACE).create(**given | values).id

    def tick(self, after: timedelta) -> int:
        return ticking.tick(self.service, now=NOON + after)

    def runs(self, schedule: str) -> list[tuple[str, str]]:
        with self.database.session() as session:
            found = ScheduleRepository(session, DEFAULT_WORKSPACE).runs(schedule).items
            return [(run.due_at.strftime("%H:%M"), run.outcome) for run in reversed(found)]

    def jobs(self, schedule: str) -> dict[str, str]:
        with self.database.session() as session:
            found = JobRepository(session, DEFAULT_WORKSPACE).page(schedule=schedule).items
            return {job.id: job.status for job in reversed(found)}

    def end(self, job: str) -> None:
        with self.database.session() as session:
            JobRepository(session, DEFAULT_WORKSPACE).cancel(job)


@pytest.fixture
def desk(database) -> Iterator[Desk]:
    own = Desk(database.url)
    yield own
    own.close()


def test_what_is_due_is_started_once(desk) -> None:
    schedule = desk.schedule()
    assert desk.tick(-timedelta(seconds=1)) == 0
    assert desk.tick(timedelta(seconds=0)) == 1
    assert desk.tick(timedelta(seconds=1)) == 0
    assert list(desk.jobs(schedule).values()) == ["queued"]
    assert desk.runs(schedule) == [("12:00", "started")]
    with desk.database.session() as session:
        assert ScheduleRepository(session, DEFAULT_WORKSPACE).get(schedule).next_at == NOON + MINUTE
        (written,) = entries(session, DEFAULT_WORKSPACE, action="job.create").items
        assert written.principal == schedule
        (job,) = JobRepository(session, DEFAULT_WORKSPACE).page(schedule=schedule).items
        # The occasion has an id as a request has one, and leads from the job to the entry and to the lines of the log.
        assert written.request_id == job.request_id
        assert job.request_id.startswith("tick_")


def test_a_job_of_a_schedule_belongs_to_a_trace_where_somebody_collects_traces(database) -> None:
    with collector() as (endpoint, received):
        traces = traces_of(Settings(otlp_endpoint=endpoint), "servotune")
        desk = Desk(database.url, traces=traces)
        try:
            schedule = desk.schedule()
            assert desk.tick(timedelta(seconds=0)) == 1
            with desk.database.session() as session:
                (job,) = JobRepository(session, DEFAULT_WORKSPACE).page(schedule=schedule).items
        finally:
            traces.close()
            desk.close()
    _, trace, span, _ = job.traceparent.split("-")
    assert spans_of(received, trace)[span].name == "schedule optimization"


def test_a_job_that_has_not_ended_is_in_the_way_as_the_policy_says(desk) -> None:
    skipping, queueing, cancelling = (
        desk.schedule(overlap=overlap) for overlap in ("skip", "queue", "cancel_previous")
    )
    for minute in range(3):
        desk.tick(minute * MINUTE)
    assert desk.runs(skipping) == [("12:00", "started"), ("12:01", "skipped"), ("12:02", "skipped")]
    assert desk.runs(queueing) == [("12:00", "started"), ("12:01", "waiting"), ("12:02", "waiting")]
    assert desk.runs(cancelling) == [("12:00", "started"), ("12:01", "started"), ("12:02", "started")]
    assert list(desk.jobs(cancelling).values()) == ["cancelled", "cancelled", "queued"]
    # One after the other: the next one begins when the one before has ended.
    (first,) = desk.jobs(queueing)
    desk.tick(2 * MINUTE)
    assert desk.runs(queueing)[1] == ("12:01", "waiting")
    desk.end(first)
    desk.tick(2 * MINUTE)
    assert desk.runs(queueing) == [("12:00", "started"), ("12:01", "started"), ("12:02", "waiting")]
    assert list(desk.jobs(queueing).values()) == ["cancelled", "queued"]


def test_what_was_missed_is_made_up_for_as_the_policy_says(desk) -> None:
    none, one, every = (
        desk.schedule(missed=missed, cron="*/10 * * * *", overlap="cancel_previous")
        for missed in ("none", "one", "all")
    )
    desk.tick(35 * MINUTE)
    assert desk.runs(none) == [("12:00", "missed")]
    assert desk.runs(one) == [("12:00", "missed"), ("12:30", "started")]
    for _ in range(4):
        desk.tick(35 * MINUTE)
    assert desk.runs(every) == [(f"12:{minute:02}", "started") for minute in (0, 10, 20, 30)]
    assert desk.runs(none) == [("12:00", "missed")]


def test_a_clock_that_jumps_starts_nothing_twice(desk) -> None:
    """Forwards it is as if the service had been away; set back, what has run does not run again when its time comes again."""
    every, one = (
        desk.schedule(missed=missed, cron="*/10 * * * *", overlap="cancel_previous") for missed in ("all", "one")
    )
    desk.tick(0 * MINUTE)
    for _ in range(3):
        desk.tick(20 * MINUTE)
    assert desk.runs(every) == [("12:00", "started"), ("12:10", "started"), ("12:20", "started")]
    assert desk.runs(one) == [("12:00", "started"), ("12:10", "missed"), ("12:20", "started")]
    before = desk.runs(every), desk.runs(one)
    for minute in (-1440, 5, 10, 15, 20, 25):
        desk.tick(minute * MINUTE)
        assert (desk.runs(every), desk.runs(one)) == before
    desk.tick(30 * MINUTE)
    assert desk.runs(every)[3:] == desk.runs(one)[3:] == [("12:30", "started")]


def test_a_job_that_cannot_be_run_is_refused_and_the_next_one_tried(desk) -> None:
    with desk.database.session() as session:
        system = SystemRepository(session, DEFAULT_WORKSPACE).create(name="lag", document=LAG).id
    schedule = desk.schedule(body=OPTIMIZATION | {"system": system})
    desk.tick(0 * MINUTE)
    desk.end(next(iter(desk.jobs(schedule))))
    with desk.database.session() as session:
        SystemRepository(session, DEFAULT_WORKSPACE).delete(system, expected_revision=1)
    desk.tick(1 * MINUTE)
    assert desk.runs(schedule) == [("12:00", "started"), ("12:01", "refused")]
    with desk.database.session() as session:
        run = ScheduleRepository(session, DEFAULT_WORKSPACE).runs(schedule).items[0]
        assert system in run.detail
    desk.tick(1.5 * MINUTE)
    desk.tick(2 * MINUTE)
    with desk.database.session() as session:
        (alert,) = AlertRepository(session, DEFAULT_WORKSPACE).page().items  # the second refusal tells nothing new
        assert (alert.kind, alert.source, alert.data["schedule"]) == ("schedule", run.id, schedule)
        assert system in alert.detail
    # A body that this version cannot read stops nobody else.
    broken, sound = desk.schedule(body={"nonsense": 1}), desk.schedule()
    desk.tick(3 * MINUTE)
    assert desk.runs(broken)[0] == ("12:00", "missed")
    assert desk.runs(broken)[-1] == ("12:03", "refused")
    assert desk.runs(sound)[-1] == ("12:03", "started")


def test_two_schedulers_never_start_a_job_twice(desk) -> None:
    made = [desk.schedule(overlap="queue") for _ in range(12)]
    other = Desk(desk.database.url)
    start = threading.Barrier(4)

    def tick(own: Desk) -> None:
        start.wait()
        for second in range(3):
            own.tick(timedelta(seconds=second))

    threads = [threading.Thread(target=tick, args=(own,)) for own in (desk, other, desk, other)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    other.close()
    assert [desk.runs(schedule) for schedule in made] == [[("12:00", "started")]] * 12
    assert [len(desk.jobs(schedule)) for schedule in made] == [1] * 12


def test_ten_thousand_schedules_cost_no_thread_and_little_time(desk) -> None:
    row = {
        "workspace_id": DEFAULT_WORKSPACE, "name": "s", "cron": "* * * * *", "time_zone": "UTC", "kind": "optimization",
        "body": {}, "overlap": "skip", "missed": "one", "paused": False, "revision": 1, "next_at": NOON + MINUTE,
    }  # fmt: skip
    with desk.database.session() as session:
        session.execute(insert(Schedule), [row | {"id": f"sch_{number}"} for number in range(10_000)])
    threads = threading.active_count()
    desk.tick(timedelta(0))
    began = time.perf_counter()
    for _ in range(10):
        assert desk.tick(timedelta(0)) == 0
    assert (time.perf_counter() - began) / 10 < 0.1  # s; a tick comes once in a second
    assert threading.active_count() <= threads
