"""/v1/processings: new recordings from old ones, at once and by a worker, and what is refused without a trace."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest

from api.schemas.replies import DatasetReply
from api.services.recordings import processing
from tests.integration.api.conftest import Service, finished
from tests.integration.api.documents import RAW, upload

RATE = 1000.0
TIME = np.arange(4000) / RATE
U = np.sin(2 * np.pi * 5 * TIME) + 0.2 * np.sin(2 * np.pi * 200 * TIME)
Y = 1000 * (0.5 + 2 * TIME)  # mm


@pytest.fixture(scope="module")
def client(sqlite_service: Service) -> Iterator[httpx.Client]:
    with sqlite_service.client() as client:
        yield client


@pytest.fixture(scope="module")
def source(client: httpx.Client) -> str:
    return recorded(client, U, Y)


def recorded(client: httpx.Client, *columns: np.ndarray, **fields: Any) -> str:
    samples = np.column_stack(columns)
    channels = fields.get("channels", RAW["channels"])
    samples = (samples - np.array([channel.get("offset", 0.0) for channel in channels])) / np.array(
        [channel.get("scale", 1.0) for channel in channels]
    )
    reply = upload(client, RAW | fields, samples.astype("<f8").tobytes(), segment=32_000)
    assert reply.status_code == 200, reply.text
    return str(reply.json()["id"])


def processed(client: httpx.Client, sources: list[str], steps: list[Any], **fields: Any) -> httpx.Response:
    return client.post("/v1/processings", json={"name": "made", "sources": sources, "steps": steps} | fields)


def made(client: httpx.Client, sources: list[str], steps: list[Any], **fields: Any) -> dict[str, Any]:
    reply = processed(client, sources, steps, **fields)
    assert reply.status_code == 201, reply.text
    DatasetReply.model_validate_json(reply.content)
    return dict(reply.json())


def channel(client: httpx.Client, dataset: str, name: str) -> dict[str, Any]:
    reply = client.get(f"/v1/datasets/{dataset}/channels/{name}")
    assert reply.status_code == 200, reply.text
    return dict(reply.json())


def test_a_processed_recording_is_a_new_one_that_remembers_its_steps(client, source) -> None:
    steps = [
        {"kind": "cut", "start": 0.5, "end": {"value": 2500, "unit": "ms"}},
        {"kind": "filter", "band": "low_pass", "frequency": {"value": 50, "unit": "Hz"}, "channels": ["u"]},
        {"kind": "differentiate", "channel": "y", "name": "v"},
        {"kind": "detrend", "trend": "linear", "channels": ["y"]},
    ]
    new = made(client, [source], steps)
    assert new["status"] == "ready"
    assert new["sample_count"] == 2001
    assert new["start_time"].startswith("2026-01-01T07:00:00.5")
    assert new["document"] == {"name": "made", "sources": [source], "steps": steps}
    assert new["channels"] == [
        {"name": "u", "unit": "V", "quantity": "voltage"},
        {"name": "y", "unit": "mm", "quantity": "displacement", "sensor": {"model": "LVDT", "serial": "7"}},
        {"name": "v", "unit": "mm/s"},
    ]
    velocity = channel(client, new["id"], "v")
    assert velocity["values"] == pytest.approx(np.full(2001, 2000.0))
    assert channel(client, new["id"], "y")["values"] == pytest.approx(np.zeros(2001), abs=1e-9)
    smooth = np.array(channel(client, new["id"], "u")["values"])
    # 5 Hz passes a fourth-order low pass of 50 Hz, 200 Hz does not: (200/50)^8 twice
    assert smooth[500:1500] == pytest.approx(np.sin(2 * np.pi * 5 * TIME[1000:2000]), abs=1e-4)
    assert channel(client, source, "u")["values"] == pytest.approx(U)  # the source is what it was


def test_every_database_keeps_processed_recordings(service) -> None:
    with service.client() as client:
        first = recorded(client, U, Y)
        new = made(client, [first], [{"kind": "decimate", "factor": 4}])
        assert (new["sample_rate"], new["sample_count"], new["size"]) == (250.0, 1000, 16_000)
        assert len(channel(client, new["id"], "u")["values"]) == 1000
        assert client.delete(f"/v1/datasets/{first}", headers={"If-Match": "*"}).status_code == 409
        assert client.delete(f"/v1/datasets/{new['id']}", headers={"If-Match": "*"}).status_code == 204
        assert client.delete(f"/v1/datasets/{first}", headers={"If-Match": "*"}).status_code == 204


def test_calibration_is_applied_on_reading_and_may_be_added_to(client) -> None:
    channels = [{"name": "u", "unit": "V", "scale": 10, "offset": -1}, {"name": "y", "unit": "mm", "scale": 2}]
    raw = recorded(client, U, Y, channels=channels)
    new = made(client, [raw], [{"kind": "calibrate", "channel": "u", "scale": 35.15065188, "unit": "N"}])
    assert channel(client, new["id"], "u")["unit"] == "N"
    assert channel(client, new["id"], "u")["values"] == pytest.approx(35.15065188 * U, abs=1e-9)
    assert channel(client, new["id"], "y")["values"] == pytest.approx(Y)


def test_experiments_are_merged_and_steps_never_smear_over_their_joint(client, source) -> None:
    other = recorded(client, U[:1000] + 5, Y[:1000])
    both = made(client, [source, other], [])
    assert both["sample_count"] == 5000
    told = client.get(f"/v1/datasets/{both['id']}").json()["processing"]
    assert (told["sources"], told["combine"], told["experiments"]) == ([source, other], "append", [4000, 1000])
    assert set(told["versions"]) >= {"servotune", "numpy", "scipy"}
    assert client.get(f"/v1/datasets/{source}").json()["processing"] is None
    # processed again, each experiment still has a mean of its own
    level = made(client, [both["id"]], [{"kind": "detrend", "channels": ["u"]}])
    values = np.array(channel(client, level["id"], "u")["values"])
    assert values[:4000].mean() == pytest.approx(0, abs=1e-12)
    assert values[4000:].mean() == pytest.approx(0, abs=1e-12)


def test_channels_of_several_recordings_are_put_side_by_side(client, source) -> None:
    force = recorded(client, U, channels=[{"name": "force", "unit": "N"}])
    both = made(client, [source, force], [], combine="side_by_side")
    assert [entry["name"] for entry in both["channels"]] == ["u", "y", "force"]
    short = recorded(client, U[:100], channels=[{"name": "other", "unit": "N"}])
    reply = processed(client, [source, short], [], combine="side_by_side")
    assert reply.status_code == 422
    assert reply.json()["errors"] == [
        {"pointer": "/sources/1", "detail": "samples must be as many as those of the first (4000), got 100"}
    ]


def test_a_source_outlives_what_was_made_from_it(client) -> None:
    first = recorded(client, U, Y)
    new = made(client, [first], [{"kind": "detrend"}])
    refused = client.delete(f"/v1/datasets/{first}", headers={"If-Match": "*"})
    assert refused.status_code == 409
    assert new["id"] in refused.json()["detail"]
    for identifier in (new["id"], first):
        assert client.delete(f"/v1/datasets/{identifier}", headers={"If-Match": "*"}).status_code == 204


def test_a_long_recording_is_processed_by_a_worker(client, sqlite_worker, source, monkeypatch) -> None:
    steps = [{"kind": "decimate", "factor": 10}, {"kind": "integrate", "channel": "u", "name": "area"}]
    at_once = made(client, [source], steps)
    monkeypatch.setattr(processing, "_AT_ONCE", 0)
    reply = processed(client, [source], steps, queue={"time_limit": 600})
    assert reply.status_code == 202, reply.text
    assert reply.json()["job"]["time_limit"] == 600.0
    assert reply.headers["Location"] == f"/v1/jobs/{reply.json()['job']['id']}"
    assert finished(client, reply.json()["job"])["status"] == "succeeded"
    new = client.get(f"/v1/datasets/{reply.json()['id']}").json()
    assert (new["status"], new["sample_rate"], new["sample_count"]) == ("ready", 100.0, 400)
    assert new["channels"] == at_once["channels"]
    assert channel(client, new["id"], "area")["values"] == channel(client, at_once["id"], "area")["values"]
    failing = processed(client, [source], [{"kind": "filter", "band": "low_pass", "frequency": 1e5}])
    job = finished(client, failing.json()["job"])
    assert job["status"] == "failed"
    assert job["error"]["errors"][0]["pointer"] == "/steps/0/frequency"
    assert client.get(f"/v1/datasets/{failing.json()['id']}").json()["status"] == "failed"


@pytest.mark.parametrize(
    ("steps", "pointer", "rule"),
    [
        ([{"kind": "filter", "band": "low_pass", "frequency": {"value": 600, "unit": "Hz"}}], "/steps/0/frequency",
         "frequency must be < 3141.59 rad/s (half the sample rate), got 3769.91"),
        ([{"kind": "filter", "band": "low_pass", "frequency": {"value": 1e-12, "unit": "Hz"}}], "/steps/0/frequency",
         "frequency must be >= 0.00101 rad/s, below which float64 does not resolve the filter at 1000 samples/s (decimate first, or take a lower order), got 6.28319e-12"),
        ([{"kind": "integrate", "channel": "u", "high_pass": 1e-12}], "/steps/0/high_pass",
         "high_pass must be >= 0.00101 rad/s, below which float64 does not resolve the filter at 1000 samples/s (decimate first, or take a lower order), got 1e-12"),
        ([{"kind": "filter", "band": "low_pass", "frequency": {"value": 50, "unit": "mm"}}], "/steps/0/frequency",
         "frequency must be in rad/s, got 'mm'"),
        ([{"kind": "cut"}, {"kind": "integrate", "channel": "w"}], "/steps/1/channel",
         "channel must be one of the recording's (u, y), got 'w'"),
        ([{"kind": "cut", "start": 9}], "/steps/0/start", "start ... end must hold at least one of the samples"),
        ([{"kind": "calibrate", "channel": "u", "scale": 0}], "/steps/0/scale", "scale must be finite and not 0, got 0"),
        ([{"kind": "calibrate", "channel": "u", "scale": 1, "unit": "furlongs/x"}], "/steps/0/unit", "unit must be known"),
        ([{"kind": "resample", "rate": 999.77}], "/steps/0/rate", "rate must be a/b of the recording's 1000 samples/s"),
        ([{"kind": "polish"}], "/steps/0/kind", "kind must be one of"),
        ([{"kind": "cut", "end": 0.01}, {"kind": "filter", "band": "low_pass", "frequency": 50}], "/steps/1",
         "the recording must be > 12 samples for this filter, got 11"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_leaves_nothing_behind(client, source, steps, pointer, rule) -> None:
    before = client.get("/v1/datasets").json()["items"]
    reply = processed(client, [source], steps)
    assert reply.status_code == 422, reply.text
    (fault,) = reply.json()["errors"]
    assert fault["pointer"] == pointer
    assert rule in fault["detail"]
    assert client.get("/v1/datasets").json()["items"] == before


def test_sources_must_exist_be_ready_and_alike(client, source) -> None:
    unknown = processed(client, [source, "ds_none"], [])
    assert unknown.json()["errors"][0] == {
        "pointer": "/sources/1", "detail": "source must be a dataset that exists, got 'ds_none'"
    }  # fmt: skip
    open_one = client.post("/v1/datasets", json=RAW).json()["id"]
    assert processed(client, [open_one], []).status_code == 409
    slow = recorded(client, U, Y, sample_rate=500)
    assert "rate must be that of the first (1000 samples/s), got 500" in processed(client, [source, slow], []).text
    volts = recorded(client, U, Y, channels=[{"name": "u", "unit": "V"}, {"name": "y", "unit": "V"}])
    assert "unit of y must be that of the first (mm), got V" in processed(client, [source, volts], []).text
