"""Repetitions of a drive: held against the limits of its output before they wait for their rig, and whole periods or a warning."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest

import servotune
from tests.integration.api.rigs import AGENT, MEASUREMENT, RIG, deliver

SOFT = {"soft_start": 0.05, "soft_stop": 0.05}


def ask(client, rig: str, signal: dict[str, Any], *, limits: dict[str, Any] | None = None, **change: Any):
    """Register a rig whose output has 5 V and 1000 V/s unless told otherwise, and ask for a drive."""
    document = RIG | {"outputs": [RIG["outputs"][0] | (limits or {})]}
    registered = client.post("/v1/agents", json=AGENT | {"rig": rig, "document": document})
    assert registered.status_code == 200, registered.text
    body = MEASUREMENT | {"rig": rig, "drive": {"output": "valve", "signal": signal}} | change
    return registered.json()["id"], client.post("/v1/acquisitions", json=body)


SINE = {"kind": "sine", "amplitude": 2, "frequency": "100 Hz"}
MULTI = {"kind": "multisine", "amplitude": 1, "fundamental": "10 Hz", "harmonics": [1, 2, 3, 4]}
SQUARE = {"kind": "square", "amplitude": 1, "period": 0.1}


@pytest.mark.parametrize(
    "case",
    [
        # ten samples of a period, from a zero on: the largest step is A sin 36°
        (SINE, SOFT, {}, "change by at most 1000 V/s, the limit of valve, got 1176 at 1000 samples/s"),
        (SINE | {"amplitude": 1.7}, SOFT, {}, None),  # 999 V/s
        ({"kind": "step", "amplitude": 2}, {}, {}, "got 2000 at"),  # from 0 in one sample
        ({"kind": "step", "amplitude": 2}, SOFT, {}, None),
        ({"kind": "step", "amplitude": 2, "start": 0.2}, SOFT, {}, "got 2000 at"),  # where nothing softens it
        ({"kind": "step", "amplitude": 2}, {"soft_start": 0.05}, {}, "got 2000 at"),  # home in one sample
        ({"kind": "step", "amplitude": 2}, {"safe": 1.5}, {"sample_rate": 900}, None),  # 0.5 V at 900/s, and back
        (
            SINE | {"frequency": "5 Hz"},
            {},
            {"duration": 0.25, "averages": 2},
            "got 1999 at",
        ),  # the joint: from 2 V to 0
        (SINE | {"frequency": "5 Hz"}, {}, {"duration": 0.4, "averages": 2}, None),
        (SQUARE, SOFT, {"duration": 30}, "got 2000 at"),
        (SQUARE | {"period": "0.5 ms"}, SOFT, {}, "below half the sample rate, 500 Hz, got 2000 Hz"),
        # 1 V sin 36° in 1 ms: 588 V/s
        (
            {"kind": "stepped_sine", "amplitude": 1, "frequencies": ["10 Hz", "100 Hz"], "dwell": 0.2},
            SOFT | {"slew": 500},
            {},
            "got 587.8 at",
        ),
        ({"kind": "stepped_sine", "amplitude": 1, "frequencies": ["10 Hz", "100 Hz"], "dwell": 0.2}, SOFT, {}, None),
        (MULTI, SOFT | {"amplitude": 2}, {}, "stay within 2 V, the limit of valve"),
        (MULTI, SOFT | {"amplitude": 4}, {}, None),
        (SINE | {"frequency": "5 Hz"}, SOFT, {"duration": 59, "sample_rate": 1e5}, None),  # a part of the samples
        (SINE, SOFT, {"duration": 59, "sample_rate": 1e5}, "got 125"),  # 2 pi 100 Hz 2 V = 1257 V/s
    ],
)
def test_a_drive_is_held_against_its_output_before_it_waits(client, request, case) -> None:
    signal, limits, change, says = case
    _, reply = ask(client, request.node.name[:100], signal, limits=limits, **change)
    assert reply.status_code == (202 if says is None else 422), reply.text
    if says is not None:
        (wrong,) = reply.json()["errors"]
        assert (wrong["pointer"], says in wrong["detail"]) == ("/drive/signal", True), wrong


def joints_of(document: dict[str, Any]) -> list[str]:
    return [warning["detail"] for warning in document["warnings"] if warning["pointer"] == "/duration"]


@pytest.mark.parametrize(
    "case",
    [
        (SINE | {"frequency": "5 Hz"}, 0.5, 3, "0.5 s are 2.5 of 0.2 s, at 1000 samples/s"),
        (SINE | {"frequency": "5 Hz"}, 0.5, 1, None),
        (SINE | {"frequency": "5 Hz"}, 0.6, 3, None),
        (SINE | {"frequency": "7 Hz"}, 1, 3, None),
        # 3 Hz: 1/3 s is 333.3 samples; the phase is off by 2 pi 3 / 3000 = 0.006, that of 4 harmonics by 0.025
        ({"kind": "multisine", "amplitude": 0.5, "fundamental": "3 Hz", "harmonics": [1]}, 1 / 3, 2, None),
        ({"kind": "multisine", "amplitude": 0.5, "fundamental": "3 Hz", "harmonics": [1, 4]}, 1 / 3, 2, "0.333 s are"),
        (SQUARE | {"amplitude": 0.4}, 0.25, 2, "0.25 s are 2.5 of 0.1 s"),
        ({"kind": "step", "amplitude": 0.5}, 0.25, 2, None),  # it does not repeat by itself
    ],
)
def test_repetitions_that_hold_no_whole_periods_have_a_warning(client, request, case) -> None:
    signal, duration, averages, says = case
    limits = SOFT | {"slew": 1e6}
    name = request.node.name[:100]
    _, reply = ask(client, name, signal, limits=limits, duration=duration, averages=averages)
    assert reply.status_code == 202, reply.text
    told = joints_of(reply.json())
    assert [says in sentence for sentence in told] == ([] if says is None else [True]), told


def test_the_rate_that_there_was_decides_whether_periods_were_whole(client, request) -> None:
    """7 Hz for 1 s are whole at 1000 samples/s; 51200/31 make 1652 samples of it, 0.23 ms more: 0.0103 rad."""
    signal = SINE | {"frequency": "7 Hz", "amplitude": 1}
    agent, asked = ask(client, request.node.name, signal, limits=SOFT, duration=1, averages=4)
    assert joints_of(asked.json()) == []
    claim = client.post(f"/v1/agents/{agent}/claim").json()
    rate = 51200 / 31
    repeats = {"first": 0, "length": 1652, "count": 4}
    data = np.zeros((4 * 1652, 2)).tobytes()
    deliver(client, claim, agent, data, facts={"repeats": repeats, "actual_rate": rate}).raise_for_status()
    (told,) = joints_of(client.get(f"/v1/acquisitions/{claim['acquisition']}").json())
    assert "1.00023438 s are 7.00164 of 0.142857 s, at 1651.612903 samples/s" in told


def test_the_mean_of_repetitions_begins_with_the_first_one_in_it(sqlite_service, sqlite_worker) -> None:
    """Four repetitions of 0.5 s behind 0.1 s of silence; the first one fades in, and the last one out."""
    rate, length, first = 1024, 512, 102
    values = np.zeros((first + 4 * length, 2))
    for i in range(4):
        values[first + i * length : first + (i + 1) * length] = i
    with sqlite_service.client() as client:
        agent, asked = ask(client, "mean", SINE | {"frequency": "4 Hz"}, averages=4, then=[{"kind": "average"}])
        assert asked.status_code == 202, asked.text
        claim = client.post(f"/v1/agents/{agent}/claim").json()
        repeats = {"first": first, "length": length, "count": 4, "fading": [1, 1]}
        deliver(client, claim, agent, values.tobytes(), facts={"repeats": repeats}).raise_for_status()
        with servotune.connect(sqlite_service.url, key=sqlite_service.keys["run"]) as library:
            found = library.acquisitions.wait(claim["acquisition"], timeout=120)
        (step,) = found["attempts"][-1]["then"]
        mean = client.get(f"/v1/datasets/{step['result']['dataset']}").json()
        whole = client.get(f"/v1/datasets/{found['dataset']}").json()
        data = client.get(f"/v1/datasets/{mean['id']}/original").content
        assert np.array_equal(np.frombuffer(data, "<f8"), np.full(2 * length, 1.5))  # of repetitions 1 and 2
        begun = datetime.fromisoformat(mean["start_time"]) - datetime.fromisoformat(whole["start_time"])
        assert begun == pytest.approx(timedelta(seconds=(first + length) / rate), abs=timedelta(microseconds=2))
