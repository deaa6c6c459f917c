from __future__ import annotations

import pickle
import socket

import pytest

from storage.jobs import compute
from storage.jobs.compute import HEADER, ComputeJob, Crashed, Done, Message, Progress, Refusal, Refused, Reporter

JOB = ComputeJob(id="job_1", kind="k", body={"gain": 2}, workspace_id="ws_default", database_url="sqlite:///x.db")


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(compute, "time", clock)
    return clock


@pytest.fixture
def ends():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        yield ours, theirs


def frames(end: socket.socket) -> list[object]:
    data = b""
    while True:
        try:
            piece = end.recv(1 << 16)
        except BlockingIOError:
            break
        data += piece
    told = []
    while data:
        (length,) = HEADER.unpack_from(data)
        told.append(pickle.loads(data[HEADER.size : HEADER.size + length]))
        data = data[HEADER.size + length :]
    return told


def test_progress_is_told_ten_times_a_second_at_most(clock, ends):
    ours, theirs = ends
    reporter = Reporter(theirs)
    for step in range(100):
        reporter.progress(step / 100)
        clock.now += 0.025
    told = frames(ours)
    assert [frame.fraction for frame in told] == [step / 100 for step in range(0, 100, 4)]


def test_progress_stays_between_nothing_and_all(clock, ends):
    ours, theirs = ends
    reporter = Reporter(theirs)
    for fraction in (-0.1, 0.5, 1.7):
        reporter.progress(fraction, "step")
        clock.now += 1
    assert frames(ours) == [Progress(0.0, "step"), Progress(0.5, "step"), Progress(1.0, "step")]


def test_a_burst_of_messages_passes_a_flood_does_not(clock, ends):
    ours, theirs = ends
    reporter = Reporter(theirs)
    for number in range(100):
        reporter.message(str(number))
    assert frames(ours) == [Message(str(number)) for number in range(20)]
    clock.now += 0.35
    for number in range(100):
        reporter.message(str(number))
    assert frames(ours) == [Message("0"), Message("1"), Message("2")]


@pytest.mark.parametrize(
    ("run", "last"),
    [
        (lambda job, _reporter: {"twice": 2 * job.body["gain"]}, Done({"twice": 4})),
        (lambda _job, reporter: reporter.message("hello") or {}, Done({})),
    ],
)
def test_a_child_tells_its_result(ends, run, last):
    ours, theirs = ends
    compute.send(ours, JOB)
    compute.compute_one(run, theirs)
    assert frames(ours)[-1] == last


def test_a_child_tells_why_not(ends):
    ours, theirs = ends

    def refuse(_job, _reporter):
        raise Refusal(type="t", title="Refused", detail="d", pointer="/gain")

    compute.send(ours, JOB)
    compute.compute_one(refuse, theirs)
    assert frames(ours) == [Refused({"type": "t", "title": "Refused", "detail": "d", "pointer": "/gain"})]


@pytest.mark.parametrize("run", [lambda _job, _reporter: 1 / 0, lambda _job, _reporter: {"f": lambda: None}])
def test_a_child_tells_of_its_errors_also_of_a_result_that_cannot_travel(ends, run):
    ours, theirs = ends
    compute.send(ours, JOB)
    compute.compute_one(run, theirs)
    (crashed,) = frames(ours)
    assert isinstance(crashed, Crashed)
    assert "Traceback" in crashed.traceback


def test_a_job_does_not_print_its_password():
    assert "x.db" not in repr(JOB)
