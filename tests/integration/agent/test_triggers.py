"""A recording that waits for its trigger: found to the sample, told while it waits, given up in time."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np
import pytest

from agent import measuring
from rig_simulator.bench import Bench
from tests.integration.agent.lab import Lab

LEVEL: dict[str, Any] = {"channel": "position", "edge": "rising", "level": "0.3 cm"}
WAITING: dict[str, Any] = {"drive": None, "trigger": LEVEL, "pre_trigger": 0.45, "duration": 0.6}
RATE = 51200 / 31


def slow_sine(bench: Bench) -> None:
    """Let the position be a sine of 0.5 Hz and 2 V, which are 4 mm."""
    bench.sensors["cDAQ1Mod1/ai1"] = replace(bench.sensors["cDAQ1Mod1/ai1"], hum=2.0, mains=0.5)


def sine(k: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return 2 * np.sin(2 * np.pi * 0.5 / RATE * k)


def found_at_its_sample(lab: Lab, done: dict[str, Any]) -> None:
    """Make sure that a recording which waited for 3 mm is the right piece of the slow sine."""
    facts = done["attempts"][-1]["facts"]
    first, length = round(0.45 * RATE), round(0.6 * RATE)
    # asin(1.5 / 2) of 0.5 Hz is 0.27 s: 0.45 s of samples are not there yet, so it is the crossing one period later.
    volts = sine(np.arange(10_000))
    (crossings,) = np.nonzero((volts[1:] >= 1.5) & (volts[:-1] < 1.5))
    at = int(crossings[1]) + 1
    assert 2 * RATE < at < 2.3 * RATE
    assert facts["trigger"]["sample"] == facts["repeats"]["first"] == first
    assert facts["trigger"]["waited"] == pytest.approx(at / RATE)
    values = lab.samples(done["dataset"])
    assert values.shape == (first + length, 2)
    assert (facts["samples"], facts["complete"]) == (first + length, True)
    assert np.abs(values[:, 1] - sine(at - first + np.arange(first + length))).max() < 3e-6
    start = datetime.fromisoformat(lab.client.get(f"/v1/datasets/{done['dataset']}").json()["start_time"])
    trigger = datetime.fromisoformat(facts["trigger"]["time"])
    assert (trigger - start).total_seconds() == pytest.approx(first / RATE, abs=2e-6)


def test_the_recording_begins_before_its_trigger(lab) -> None:
    slow_sine(lab.bench)
    with lab.agent():
        done = lab.wait(lab.ask(**WAITING))
    assert done["status"] == "done", done
    found_at_its_sample(lab, done)
    assert not lab.bench.tasks


def test_a_long_wait_is_streamed(lab) -> None:
    """Beyond two million samples inputs are continuous, and end when the recording is whole."""
    slow_sine(lab.bench)
    with lab.agent(lab.settings(**{"daq.chunk": 2.0})):
        done = lab.wait(lab.ask(**WAITING | {"trigger": LEVEL | {"timeout": 3600}}))
        assert done["status"] == "done", done
        found_at_its_sample(lab, done)
        assert lab.wait(lab.ask())["status"] == "done"  # and the hardware is free


def test_without_a_trigger_the_attempt_says_what_was_seen(lab) -> None:
    slow_sine(lab.bench)
    with lab.agent():
        asked = lab.ask(**WAITING | {"trigger": LEVEL | {"level": 4.5, "timeout": 3}})
        failed = lab.wait(asked)
        error = failed["attempts"][0]["error"]
        assert (failed["status"], failed["dataset"]) == ("failed", None)
        assert error["type"] == "urn:servotune:problem:no_trigger"
        assert "position must rise to 4.5 mm within 3 s, it was between -4 and 4 mm" in error["detail"]
        lab.until(lambda: lab.runs() == [])
        assert lab.wait(lab.ask())["status"] == "done"


def test_while_it_waits_it_says_so_and_shows_what_comes(lab) -> None:
    lab.bench.speed = 1.0
    with lab.agent():
        asked = lab.ask(**WAITING | {"trigger": LEVEL | {"timeout": 600}})
        lab.until(
            lambda: lab.client.get(f"/v1/jobs/{lab.get(asked)['job']}").json()["message"] == "waits for the trigger"
        )
        with lab.client.stream("GET", f"/v1/acquisitions/{asked}/events", timeout=30) as stream:
            assert "event: preview" in stream.iter_lines()
        assert lab.get(asked)["status"] == "running"
        assert lab.get(asked)["dataset"] is None
        lab.client.post(f"/v1/acquisitions/{asked}/cancel").raise_for_status()
        assert lab.wait(asked)["status"] == "cancelled"
        lab.until(lambda: lab.runs() == [])


def test_what_has_passed_does_not_fill_the_memory(lab, monkeypatch) -> None:
    slow_sine(lab.bench)
    most, take = [], measuring.Waiting.take

    def watched(self: measuring.Waiting, block: np.ndarray[Any, Any]) -> bool:
        found = take(self, block)
        most.append(self._kept)
        return found

    monkeypatch.setattr(measuring.Waiting, "take", watched)
    with lab.agent():
        assert lab.wait(lab.ask(**WAITING | {"trigger": LEVEL | {"level": 4.5, "timeout": 120}}))["status"] == "failed"
    assert len(most) > 1000
    assert max(most) < 0.45 * RATE + 2 * round(0.1 * RATE)
