"""Whether a process has ended is told by what the system knows of it: processes made and ended here."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from storage.jobs.liveness import Pulse
from storage.models import Worker
from storage.processes import alive, this_process
from storage.repositories import WorkerRepository

TELL = "from storage.processes import this_process; print(this_process(), flush=True); input()"


@dataclass
class Other:
    """Another process, and the name that it tells of itself."""

    process: subprocess.Popen[str]
    name: str


@pytest.fixture
def other() -> Iterator[Other]:
    process = subprocess.Popen([sys.executable, "-c", TELL], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    yield Other(process, process.stdout.readline().strip())
    process.kill()
    process.communicate()


def test_a_process_lives_until_it_is_killed_and_before_anybody_has_asked_how_it_ended(other: Other) -> None:
    assert alive(other.name) is True
    assert other.name != this_process()
    assert alive(this_process()) is True
    other.process.kill()
    with open(f"/proc/{other.process.pid}/stat") as stat:  # noqa: PTH123 - read again and again, as it is now
        while ") Z " not in stat.read():  # nobody has waited for it: its number is still taken
            stat.seek(0)
    assert alive(other.name) is False
    other.process.wait()
    assert alive(other.name) is False


def test_a_number_that_another_process_has_now_is_not_the_same_process() -> None:
    name = this_process()
    assert name is not None
    start = name.rsplit("/", 1)[1]
    assert alive(name.removesuffix(start) + str(int(start) - 1)) is False


@pytest.mark.parametrize("name", [None, "another-boot/pid:[4026531836]/1/7"])
def test_of_processes_elsewhere_nothing_is_known(name: str | None) -> None:
    assert alive(name) is None


def test_a_worker_of_this_machine_is_missed_without_waiting_for_its_heartbeats(database, other: Other) -> None:
    holder = {"replaces": None, "host": "lab", "pid": 1, "slots": 1}
    pulse = Pulse(8.0, clock=lambda: 0.0)
    with database.session() as session:
        workers = WorkerRepository(session)
        workers.claim("here", token="a", process=other.name, **holder)
        workers.claim("elsewhere", token="b", process=None, **holder)
        assert pulse.dead(workers.heartbeats()) == []
        other.process.kill()
        other.process.wait()
        assert [worker.id for worker in pulse.dead(workers.heartbeats())] == ["here"]
        assert session.get_one(Worker, "here").process == other.name
