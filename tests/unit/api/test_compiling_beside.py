"""What searches run on is compiled by a process beside the worker: jobs that begin meanwhile do not compile it too."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from api.processes import worker


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    yield
    worker._compiling.clear()


class Listened:
    """A reporter that ends the waiting after some looks."""

    def __init__(self, looks: int) -> None:
        self.looks, self.told = looks, []

    def progress(self, fraction: float, message: str) -> None:
        self.told.append(message)

    def ending(self) -> bool:
        self.looks -= 1
        return self.looks < 0


@pytest.fixture
def beside(monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[bytes]]:
    """A process that a worker takes for the one that compiles: it ends when its input does."""
    command = [sys.executable, "-S", "-c", "import sys; sys.stdin.read()"]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        monkeypatch.setattr(worker.ahead, "compiled_before", lambda: False)
        monkeypatch.setattr(worker, "_LOOK_INTERVAL", 0.0)
        monkeypatch.setattr(worker.logs, "configure", lambda *_, **__: None)
        monkeypatch.setattr(worker.subprocess, "Popen", lambda _: process)
        yield process


def test_a_search_waits_and_says_so_until_it_is_cancelled(beside) -> None:
    later = worker.prepare()
    assert later is not None
    assert later.process == beside.pid
    reporter = Listened(looks=3)
    worker.await_compiled(reporter)
    assert len(reporter.told) == 3
    assert "compiled" in reporter.told[0]


def test_it_begins_once_all_is_compiled(beside, monkeypatch: pytest.MonkeyPatch) -> None:
    worker.prepare()
    answers = iter([False, False, True])
    monkeypatch.setattr(worker.ahead, "compiled_before", lambda: next(answers))
    reporter = Listened(looks=100)
    worker.await_compiled(reporter)
    assert len(reporter.told) == 2


def test_where_that_process_has_died_a_job_compiles_by_itself(beside) -> None:
    worker.prepare()
    beside.kill()
    os.waitpid(beside.pid, 0)  # as the process does that forks the jobs
    reporter = Listened(looks=100)
    worker.await_compiled(reporter)
    assert not reporter.told


def test_a_process_of_another_user_that_took_over_the_number_does_not_compile(beside, monkeypatch) -> None:
    def refused(_process: int, _signal: int) -> None:
        raise PermissionError

    worker.prepare()
    monkeypatch.setattr(worker.os, "kill", refused)
    reporter = Listened(looks=100)
    worker.await_compiled(reporter)
    assert not reporter.told


def test_where_all_is_compiled_nobody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker.ahead, "compiled_before", lambda: True)
    monkeypatch.setattr(worker, "_load_compiled", lambda: None)
    monkeypatch.setattr(worker.logs, "configure", lambda *_, **__: None)
    assert worker.prepare() is None
    reporter = Listened(looks=100)
    worker.await_compiled(reporter)
    assert not reporter.told
