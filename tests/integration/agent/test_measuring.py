"""From a request to verified samples, through the unmodified nidaqmx package."""

from __future__ import annotations

import json
import threading
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from agent.settings import CalibrationSettings, StageSettings
from agent.waking import WakingEvent


def test_a_driven_measurement_arrives_whole(lab) -> None:
    with lab.agent():
        done = lab.wait(lab.ask())
    attempt = done["attempts"][0]
    assert (done["status"], attempt["error"]) == ("done", None)
    facts = attempt["facts"]
    # A delta-sigma module has 51200/n samples/s: of 1000 it makes 51200/51... only up to n = 31, so 51200/31.
    assert facts["actual_rate"] == pytest.approx(51200 / 31)
    wait, length = round(0.1 * 51200 / 31), round(51200 / 31)
    assert (facts["samples"], facts["complete"]) == (wait + length, True)
    assert facts["repeats"] == {"first": wait, "length": length, "count": 1, "fading": [0, 1]}
    assert (facts["drive"]["soft_start"], facts["drive"]["soft_stop"]) == (0.0, 0.02)

    values = lab.samples(done["dataset"])
    t = np.arange(length) / facts["actual_rate"]
    # The drive is computed at the rate that the hardware has: 5 Hz stay 5 Hz.
    driven = values[wait:, 0]
    soft = slice(0, int(0.97 * length))
    assert np.abs(driven - 2 * np.sin(2 * np.pi * 5 * t))[soft].max() < 2e-6  # the converter's step is 1.2e-6 V
    assert np.all(np.abs(values[:wait, 0]) < 2e-6)
    assert abs(values[-1, 0]) < 2e-6
    # The lag 2/(0.05 s + 1), settled: |G(j 10 pi)| = 2/sqrt(1 + (0.05 10 pi)^2) = 1.0741, of 2 V, and 0.5 V for a mm.
    late = values[wait + length // 2 : wait + int(0.97 * length), 1]
    assert (late.max() - late.min()) / 2 == pytest.approx(2 * 2 / np.hypot(1, 0.05 * 10 * np.pi) * 0.5, rel=2e-3)

    dataset = lab.client.get(f"/v1/datasets/{done['dataset']}").json()
    assert dataset["channels"][1]["scale"] == 2.0  # mm for a V
    assert dataset["channels"][1]["sensor"]["certificate"] == "C-17"
    assert lab.runs() == []  # nothing is left on the disk of the lab PC
    assert lab.level() == 0.0
    assert not lab.bench.tasks


def test_a_chain_is_in_the_scale_of_its_channel_with_its_certificates(lab) -> None:
    settings = lab.settings()
    (loopback, position) = settings.inputs
    known = CalibrationSettings(certificate="C-18", calibrated_on="2026-03-02", uncertainty_percent=4.0)
    amplifier = StageSettings(model="amplifier", serial="7", gain=4.0, calibration=known)
    sensor = replace(position.calibration, uncertainty_percent=3.0)
    inputs = (loopback, replace(position, calibration=sensor, chain=(amplifier,)))
    with lab.agent(replace(settings, inputs=inputs)):
        done = lab.wait(lab.ask())
    channel = lab.client.get(f"/v1/datasets/{done['dataset']}").json()["channels"][1]
    assert channel["scale"] == 0.5  # 0.5 V for a mm, times 4
    assert channel["sensor"]["uncertainty_percent"] == pytest.approx(5.0)
    assert channel["sensor"]["chain"] == [
        {"model": "amplifier", "serial": "7", "gain": 4.0, "calibrated_on": "2026-03-02", "certificate": "C-18"}
    ]


def test_repetitions_follow_each_other_without_a_gap_and_are_averaged(lab) -> None:
    signal = {"kind": "multisine", "amplitude": 0.5, "fundamental": 2 * np.pi * 10, "harmonics": [1, 3]}
    with lab.agent():
        asked = lab.ask(
            duration=0.1,
            averages=5,
            sample_rate=51200,
            drive={"output": "valve", "signal": signal},
            then=[{"kind": "average"}],
        )
        lab.wait(asked)
        lab.until(lambda: lab.attempt(asked)["then"][0]["status"] == "done", what=lambda: lab.attempt(asked))
    attempt = lab.attempt(asked)
    first, length, count = (attempt["facts"]["repeats"][key] for key in ("first", "length", "count"))
    assert (first, length, count) == (5120, 5120, 5)
    values = lab.samples(attempt["dataset"])
    repeats = values[first:].reshape(count, length, 2)
    # One period of the fundamental is exactly one repetition: the drive is the same, sample for sample.
    assert np.abs(repeats[1, :, 0] - repeats[2, :, 0]).max() < 3e-6
    mean = lab.samples(attempt["then"][0]["result"]["dataset"])
    assert attempt["facts"]["repeats"]["fading"] == [
        0,
        1,
    ]  # the soft stop is in the last one, which is not like the others
    assert np.abs(mean - repeats[:4].mean(axis=0)).max() < 1e-15
    assert np.abs(mean[:, 0] - repeats[2, :, 0]).max() < 3e-6


def test_a_preview_comes_while_it_runs(service, lab) -> None:
    lab.bench.speed = 1.0
    seen = []
    with lab.agent():
        asked = lab.ask(duration=2.5)
        with lab.client.stream("GET", f"/v1/acquisitions/{asked}/events", timeout=30) as stream:
            kind = ""
            for line in stream.iter_lines():
                kind = line.removeprefix("event: ") if line.startswith("event: ") else kind
                if line.startswith("data: ") and kind == "preview":
                    seen.append(line)
                    break
        assert lab.get(asked)["status"] == "running"
        lab.client.post(f"/v1/acquisitions/{asked}/cancel")
        lab.wait(asked, "cancelled")
    preview = json.loads(seen[0].removeprefix("data: "))
    assert set(preview["channels"]) == {"loopback", "position"}
    assert all(low <= high for low, high in preview["channels"]["position"])


def test_a_person_has_to_agree(lab) -> None:
    lab.answers = [False, True]
    with lab.agent():
        refused = lab.wait(lab.ask(confirm=True))
        assert refused["attempts"][0]["error"]["type"] == "urn:servotune:problem:not_confirmed"
        assert lab.wait(lab.ask(confirm=True))["status"] == "done"


def test_a_question_ends_when_the_measurement_is_cancelled(lab) -> None:
    asked, ended = threading.Event(), threading.Event()

    def person(_: str, ends: Sequence[WakingEvent]) -> bool:
        with ends[0].waking(ended.set):
            asked.set()
            return not ended.wait(60.0)

    lab.person = person
    with lab.agent():
        waiting = lab.ask(confirm=True)
        assert asked.wait(60.0)
        assert lab.client.post(f"/v1/acquisitions/{waiting}/cancel").json()["status"] == "cancelled"
        lab.until(lambda: lab.get(waiting)["attempts"][0]["error"] is not None)
        told = lab.get(waiting)["attempts"][0]["error"]
    assert ended.is_set()
    assert told["type"] == "urn:servotune:problem:cancelled"
    assert told["detail"].startswith("the measurement was cancelled")


@pytest.mark.parametrize(
    ("signal", "rate", "says"),
    [
        # The service refuses what is more than 1 % beyond: this reaches 4.02 V.
        (
            {"kind": "multisine", "amplitude": 1.6986, "fundamental": 6, "harmonics": [1, 2, 3]},
            1000,
            "must stay within 4 V",
        ),
        # 4 V at 200 Hz change by up to 4 * 2 pi 200 = 5027 V/s; 5000 are allowed.
        ({"kind": "sine", "amplitude": 4, "frequency": 2 * np.pi * 200}, 51200, "must change by at most 5000 V/s"),
    ],
)
def test_no_job_exceeds_the_limits_of_an_output(lab, signal, rate, says) -> None:
    with lab.agent():
        asked = lab.ask(sample_rate=rate, duration=2, drive={"output": "valve", "signal": signal})
        failed = lab.wait(asked)
    assert says in failed["attempts"][0]["error"]["detail"]
    assert failed["dataset"] is None
    assert lab.level() == 0.0


def test_a_long_run_is_streamed_both_ways(lab) -> None:
    """Beyond two million samples inputs are continuous, and the drive is written while it is played."""
    with lab.agent(lab.settings(**{"daq.chunk": 2.0, "spool.segment": 10.0})):
        asked = lab.ask(sample_rate=51200, duration=20, channels=["loopback", "position"])
        done = lab.wait(asked)
    assert done["status"] == "done", done
    values = lab.samples(done["dataset"])
    assert values.shape == (round(20.1 * 51200), 2)
    k = np.arange(5120, 5120 + 19 * 51200)
    assert np.abs(values[k, 0] - 2 * np.sin(2 * np.pi * 5 * (k - 5120) / 51200)).max() < 2e-6


NOISE = {"kind": "noise", "band": ["0.5 Hz", "100 Hz"], "rms": 0.4, "seed": 3}


def test_a_drive_that_is_told_as_its_points_may_be_long(lab) -> None:
    # at some 30 bytes a point, facts that repeat them are a document that the service does not take
    with lab.agent():
        done = lab.wait(lab.ask(duration=60, drive={"output": "valve", "signal": NOISE}))
    assert done["status"] == "done", done
    told = done["attempts"][0]["facts"]["drive"]["signal"]
    assert told["values"] == told["time"]
    assert told["values"]["points"] > 60_000
    assert done["document"]["drive"]["signal"]["kind"] == "noise"
    assert lab.samples(done["dataset"])[:, 0].std() == pytest.approx(0.4, rel=0.02)
