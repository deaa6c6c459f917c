"""Each of the job engine's private calls does what it is used for, with the version that is locked."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import pytest
from dbos import DBOS, DBOSClient
from sqlalchemy import event, text

from storage import Database
from storage.jobs import private_calls
from storage.jobs.engine import SERIALIZER
from tests.support.desk import wait_for
from tests.support.patience import PATIENCE

QUEUE, NAME, DEAD = "private calls", "private_calls_test", "an executor that died"


@dataclass
class Gate:
    """What the workflow of these tests waits for, and says."""

    begun: threading.Event = field(default_factory=threading.Event)
    opened: threading.Event = field(default_factory=threading.Event)
    asked: int = 0
    free: int = 0

    def slots(self) -> int:
        self.asked += 1
        return self.free


GATE: list[Gate] = []


@DBOS.workflow(name="waits_at_the_gate")
def waits_at_the_gate() -> None:
    GATE[-1].begun.set()
    GATE[-1].opened.wait(60)


@pytest.fixture
def gate() -> Iterator[Gate]:
    GATE.append(Gate())
    yield GATE[-1]
    GATE.pop().opened.set()


@pytest.fixture
def engine(fresh_database: Database, gate: Gate) -> Iterator[DBOS]:
    client = DBOSClient(system_database_engine=fresh_database.engine, serializer=SERIALIZER)
    client.register_queue(QUEUE, worker_concurrency=0, partition_concurrency=100, polling_interval_sec=0.05)
    client.destroy()
    made = DBOS(
        config={
            "name": NAME, "system_database_engine": fresh_database.engine, "executor_id": "one", "application_version": "1",
            "serializer": SERIALIZER, "log_level": "WARNING", "run_migrations": False,
        }
    )  # fmt: skip
    DBOS.listen_queues([QUEUE])
    DBOS.launch()
    private_calls.limit_claims(made, QUEUE, gate.slots)
    yield made
    gate.opened.set()
    DBOS.destroy()


def enqueue(database: Database) -> str:
    client = DBOSClient(system_database_engine=database.engine, serializer=SERIALIZER)
    handle = client.enqueue({"workflow_name": "waits_at_the_gate", "queue_name": QUEUE, "queue_partition_key": "a"})
    client.destroy()
    return handle.workflow_id


def looked(gate: Gate, times: int) -> Callable[[], bool]:
    before = gate.asked
    return lambda: gate.asked >= before + times


def test_tables_that_are_behind_are_told(fresh_database: Database) -> None:
    assert private_calls.tables_are_current(fresh_database.engine)
    dbos = "" if fresh_database.engine.dialect.name == "sqlite" else "dbos."
    with fresh_database.engine.begin() as connection:
        connection.execute(text(f"UPDATE {dbos}dbos_migrations SET version = 1"))
    assert not private_calls.tables_are_current(fresh_database.engine)


def test_a_process_takes_what_it_has_room_for(engine: DBOS, gate: Gate, fresh_database: Database) -> None:
    enqueue(fresh_database)
    wait_for(looked(gate, 5), "five looks at the queue")
    assert not gate.begun.is_set()
    gate.free = 1
    assert gate.begun.wait(PATIENCE)


def test_a_process_looks_when_it_is_told_to(engine: DBOS, gate: Gate, fresh_database: Database) -> None:
    asleep, woken = threading.Event(), threading.Event()

    def wait() -> None:
        asleep.set()
        woken.wait(60)

    private_calls.limit_claims(engine, QUEUE, gate.slots, wait=wait)
    gate.free = 1
    assert asleep.wait(PATIENCE)
    before = gate.asked
    enqueue(fresh_database)
    assert not gate.begun.wait(0.5)
    assert gate.asked <= before + 1
    woken.set()
    assert gate.begun.wait(PATIENCE)


def test_workflows_that_run_are_counted_until_their_end_is_written(
    engine: DBOS, gate: Gate, fresh_database: Database
) -> None:
    assert private_calls.running_workflows(engine, QUEUE) == 0
    gate.free = 1
    enqueue(fresh_database)
    assert gate.begun.wait(PATIENCE)
    assert private_calls.running_workflows(engine, QUEUE) == 1
    gate.opened.set()
    wait_for(lambda: private_calls.running_workflows(engine, QUEUE) == 0, "the end of the workflow")


def test_what_a_dead_executor_has_left_is_done(engine: DBOS, gate: Gate, fresh_database: Database) -> None:
    identifier = enqueue(fresh_database)
    dbos = "" if fresh_database.engine.dialect.name == "sqlite" else "dbos."
    with fresh_database.engine.begin() as connection:  # as one leaves it that is killed
        connection.execute(
            text(
                f"UPDATE {dbos}workflow_status SET status = 'PENDING', executor_id = :dead, application_version = '1' "
                "WHERE workflow_uuid = :id"
            ),
            {"dead": DEAD, "id": identifier},
        )
    gate.free = 1
    wait_for(looked(gate, 5), "five looks at the queue")
    assert not gate.begun.is_set()
    private_calls.recover([DEAD])
    assert gate.begun.wait(PATIENCE)


def test_a_process_at_rest_asks_once_for_what_does_not_change(
    engine: DBOS, gate: Gate, fresh_database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    # However long the looks below take.
    monkeypatch.setattr(private_calls, "_SELDOM", 3600.0)
    elected = threading.Event()
    private_calls.rest(engine, elected.is_set)
    with engine._sys_db.background_job_lock("a job") as acquired:
        assert not acquired
    elected.set()
    with engine._sys_db.background_job_lock("a job") as acquired:
        assert acquired
    elected.clear()

    queues = engine._sys_db.list_queues(application_name=NAME)
    assert [queue.name for queue in queues] == [QUEUE]
    assert engine._sys_db.list_schedules(application_name=NAME) == []
    asked: list[str] = []
    event.listen(fresh_database.engine, "before_cursor_execute", lambda *given: asked.append(given[2]))
    wait_for(looked(gate, 80), "four seconds of looks, each of which asks for the queue")
    assert engine._sys_db.list_queues(application_name=NAME) is queues
    assert sum("workflow_schedules" in statement for statement in asked) <= 1  # one may have been on its way
    assert [statement for statement in asked if "advisory" in statement] == []
    gate.free = 1
    enqueue(fresh_database)
    assert gate.begun.wait(PATIENCE)
    gate.opened.set()
    wait_for(lambda: private_calls.running_workflows(engine, QUEUE) == 0, "the end of the workflow")
