"""The processes that compute, without a database."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from storage.jobs.children import Child, ChildDied, Zygote
from storage.jobs.compute import ComputeJob, Done, Frame, Message
from tests.support.desk import COMPUTE, exists, wait_for, wait_until_gone
from tests.support.patience import PATIENCE


def job(kind: str, **body) -> ComputeJob:
    return ComputeJob(id="job_1", kind=kind, body=body, workspace_id="ws_default", database_url="")


def next_frame(child: Child) -> Frame:
    give_up_at = time.monotonic() + PATIENCE
    while (frame := child.receive(0.1)) is None:
        assert time.monotonic() < give_up_at
    return frame


@pytest.fixture
def zygote() -> Iterator[Zygote]:
    zygote = Zygote(COMPUTE)
    zygote.warm_up()
    yield zygote
    zygote.close()


def test_children_start_within_milliseconds(zygote):
    child = zygote.start(job("square", values=[1], pause=0))
    while not isinstance(next_frame(child), Done):
        pass
    child.kill()
    times = []
    for _ in range(5):
        start = time.perf_counter()
        child = zygote.start(job("square", values=list(range(50_000)), pause=0))
        while not isinstance(frame := next_frame(child), Done):
            pass
        times.append(time.perf_counter() - start)
        child.kill()
        np.testing.assert_array_equal(frame.result["squares"]["values"], np.arange(50_000.0) ** 2)
    assert min(times) < 0.3


def test_what_is_left_for_later_is_done_when_the_process_beside_has_ended_and_keeps_no_job_waiting(
    tmp_path, monkeypatch
):
    ready = tmp_path / "ready"
    monkeypatch.setenv("LATER_READY", str(ready))
    zygote = Zygote("tests.support.later_ready:run")

    def done() -> int:
        child = zygote.start(job("any"))
        while not isinstance(frame := next_frame(child), Done):
            pass
        child.kill()
        return frame.result["done"]

    try:
        assert [done(), done()] == [0, 0]
        ready.touch()
        wait_for(lambda: done() == 1, "what was left for later")
    finally:
        ready.touch()
        zygote.close()


def test_killing_the_zygote_kills_its_children_and_the_next_job_gets_a_new_one(zygote):
    child = zygote.start(job("spin"))
    told = next_frame(child)
    assert isinstance(told, Message)
    process = int(told.text)
    parent = int(Path(f"/proc/{process}/stat").read_text().split()[3])
    os.kill(parent, signal.SIGKILL)
    with pytest.raises(ChildDied, match="lost the process that started it"):
        next_frame(child)
    child.kill()
    wait_until_gone(process)
    other = zygote.start(job("square", values=[2], pause=0))
    while not isinstance(frame := next_frame(other), Done):
        pass
    assert frame.result["count"] == 1
    other.kill()


def test_a_child_that_the_system_has_no_room_for_takes_no_other_one_with_it():
    zygote = Zygote("tests.support.no_room:run")
    running = zygote.start(job("spin"))
    told = next_frame(running)
    assert isinstance(told, Message)
    refused = zygote.start(job("spin"))
    with pytest.raises(ChildDied, match="could not be started"):
        next_frame(refused)
    refused.kill()
    assert running.receive(0.3) is None
    assert exists(int(told.text))
    later = zygote.start(job("square", values=[2], pause=0))
    while not isinstance(frame := next_frame(later), Done):
        pass
    assert frame.result["count"] == 1
    later.kill()
    running.kill()
    zygote.close()


def test_a_service_manager_that_signals_every_process_leaves_the_children_to_the_worker(zygote):
    child = zygote.start(job("spin"))
    told = next_frame(child)
    assert isinstance(told, Message)
    process = int(told.text)
    parent = int(Path(f"/proc/{process}/stat").read_text().split()[3])
    for one in (parent, process):
        os.kill(one, signal.SIGTERM)
        os.kill(one, signal.SIGINT)
    assert child.receive(0.3) is None
    child.kill()
    wait_until_gone(process)
    assert exists(parent)


def test_a_compute_function_that_cannot_be_imported_is_told():
    zygote = Zygote("tests.support.computing:no_such_function")
    child = zygote.start(job("spin"))
    with pytest.raises(ChildDied, match="lost the process"):
        next_frame(child)
    child.kill()
    zygote.close()


def test_closing_kills_what_still_runs(zygote):
    child = zygote.start(job("spin"))
    told = next_frame(child)
    assert isinstance(told, Message)
    zygote.close()
    wait_until_gone(int(told.text))
    child.kill()
