"""Sweeps that are shown and not recorded: over the whole way, from the hardware to the stream of events."""

from __future__ import annotations

import json

import httpx
import numpy as np
import pytest

from tests.integration.agent.lab import Lab
from tests.integration.agent.test_triggers import LEVEL, slow_sine

LIVE = {"drive": None, "record": False, "pre_trigger": 0.1, "duration": 0.4}


def previews(lab: Lab, asked: str, enough) -> list[dict]:
    """Follow a measurement until what it shows is enough."""
    found: list[dict] = []
    with lab.client.stream("GET", f"/v1/acquisitions/{asked}/events", timeout=120) as reply:
        kind = ""
        for line in reply.iter_lines():
            word, _, rest = line.partition(": ")
            if word == "event":
                kind = rest
            elif word == "data" and kind == "preview":
                found.append(json.loads(rest))
                if enough(found):
                    return found
    raise AssertionError(found)


@pytest.mark.parametrize("trigger", [None, LEVEL])
def test_sweeps_are_shown_and_nothing_is_kept(lab, trigger) -> None:
    slow_sine(lab.bench)
    lab.bench.speed = 1.0
    with lab.agent():
        asked = lab.ask(**LIVE, trigger=trigger)
        shown = previews(lab, asked, lambda found: found[-1]["sweep"] >= 2)
        # What a page that comes later is told is the newest only: an hour of previews would be a recording.
        assert len(previews(lab, asked, lambda _: True)) == 1
        for entry in shown:
            assert entry["start"] == pytest.approx(-0.1, abs=1e-3)
            position = np.array(entry["channels"]["position"])
            assert len(position) <= 200
            time = entry["start"] + entry["step"] * np.arange(len(position))
            if (
                trigger is not None
            ):  # 4 mm of 0.5 Hz reach 3 mm: the lowest of a stretch is a little below, its highest above
                before, after = time < -entry["step"], time > entry["step"]
                assert np.all(position[before, 1] < 3.0)
                assert np.all(position[after & (time < 0.4), 0] > 3.0)
        assert lab.get(asked)["dataset"] is None
        assert lab.client.post(f"/v1/acquisitions/{asked}/cancel").status_code == 200
        lab.until(lambda: not lab.bench.tasks and lab.runs() == [])
        over = lab.get(asked)
        assert (over["status"], over["dataset"]) == ("cancelled", None)
        lab.bench.speed = 0.0
        assert lab.wait(lab.ask())["status"] == "done"  # the hardware is free


def test_ten_minutes_are_the_end(lab) -> None:
    """The rig is as fast as it is read: its ten minutes take seconds."""
    with lab.agent(lab.settings(**{"daq.chunk": 20.0})):
        done = lab.wait(lab.ask(**LIVE | {"duration": 20}))
        assert (done["status"], done["dataset"]) == ("done", None)
        facts = done["attempts"][0]["facts"]
        assert facts["sweeps"] == 30
        assert set(facts["channels"]) == {"loopback", "position"}
        lab.until(lambda: lab.runs() == [])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"averages": 2}, "averages must be left out where nothing is recorded"),
        ({"then": [{"kind": "identification", "body": {}}]}, "then must be left out where nothing is recorded"),
        (
            {"duration": 2000},
            "must hold at most 2e+06 samples of all channels where nothing is recorded, got 4.0002e+06",
        ),
        (
            {"drive": {"output": "valve", "signal": {"kind": "step", "amplitude": 1}}},
            "drive must be left out where nothing",
        ),
    ],
)
def test_what_only_a_recording_has_is_refused(lab, change, says) -> None:
    with lab.agent():
        lab.registered()
        body = {"name": "live", "rig": lab.rig, "channels": ["loopback", "position"], "sample_rate": 1000, **LIVE}
        reply: httpx.Response = lab.client.post("/v1/acquisitions", json=body | change)
    assert reply.status_code == 422
    assert says in reply.json()["detail"], reply.json()
