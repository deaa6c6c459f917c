"""What a worker says of a search is what the page of a job reads: one sentence, two languages."""

from __future__ import annotations

import pickle
import re
import socket
from pathlib import Path

import pytest

from api.processes.worker import _Watch
from storage.jobs.compute import HEADER, Listening, Message, Reporter

EVENTS = Path(__file__).parents[3] / "web/src/features/jobs/events.ts"


def expression() -> re.Pattern[str]:
    """Return the regular expression that the page reads the sentence with, out of its source."""
    (found,) = re.findall(r"^const BEST = /(.+)/;$", EVENTS.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return re.compile(found)


@pytest.mark.parametrize(
    ("evaluation", "objective", "violation"),
    [(1, 0.6287354, 0.0), (30_000, -1.25e-9, 1.5e-3), (12, 4.0e12, 7.0)],
)
def test_the_page_reads_what_the_worker_says(evaluation: int, objective: float, violation: float) -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        watch = _Watch(Reporter(theirs))
        assert isinstance(pickle.loads(ours.recv(1 << 16)[HEADER.size :]), Listening)
        watch.best(evaluation, objective, violation, {"law.kp": 4.0, "motor.mass": 2000.0})
        told = pickle.loads(ours.recv(1 << 16)[HEADER.size :])
    assert isinstance(told, Message)
    found = expression().search(told.text)
    assert found is not None
    assert int(found[1]) == evaluation
    assert float(found[2].rstrip(",")) == pytest.approx(objective, rel=1e-5)
    assert float(found[3]) == pytest.approx(violation, rel=1e-2)
