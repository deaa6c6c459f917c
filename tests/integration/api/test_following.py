"""What follows a recording by itself, through the client library, with a worker that computes it."""

from __future__ import annotations

from typing import Any

import httpx
import pytest

import servotune
from servotune.errors import JobFailedError
from tests.integration.api.documents import LAG, RAW, lag_recording
from tests.integration.api.rigs import AGENT, RIG, deliver

CHANNELS: dict[str, Any] = {"inputs": {"u": "u"}, "outputs": {"y": "y"}}
OWN = RIG | {"inputs": [{"name": name, "channel": f"Dev1/ai{i}"} for i, name in enumerate("uy")]}


def measured(service, monkeypatch, client: servotune.Client, then: list[dict[str, Any]]) -> str:
    """Let a rig deliver the recording of a lag with k = 3, tau = 0.05 s and an offset of 2 mm."""
    monkeypatch.setattr("tests.integration.api.rigs.CHANNELS", RAW["channels"])
    with service.client("acquire") as own:
        agent = own.post("/v1/agents", json=AGENT | {"rig": "lag", "document": OWN}).json()["id"]
        asked = client.acquisitions.start(
            "lag", rig="lag", channels=["u", "y"], sample_rate=1000, duration=4, then=then
        )
        assert client.acquisitions.job(asked["id"]).status == "queued"
        claim = own.post(f"/v1/agents/{agent}/claim").json()
        assert deliver(_exact(own), claim, agent, lag_recording()).json()["status"] == "done"
    return asked["id"]


def _exact(client: httpx.Client) -> httpx.Client:
    """Say the rate of the recording, where the helper of the other tests says that of its rig."""

    def hook(request: httpx.Request) -> None:
        if request.url.path.endswith("/dataset"):
            content = request.content.replace(b'"sample_rate":1024', b'"sample_rate":1000')
            request.stream = httpx.ByteStream(content)

    client.event_hooks = {"request": [hook], "response": []}
    return client


def test_a_recording_is_identified_and_validated_by_itself(sqlite_service, sqlite_worker, monkeypatch) -> None:
    then = [
        {
            "kind": "identification",
            "body": {"system": LAG, **CHANNELS, "parameters": ["k", "tau"], "offsets": "estimate"},
        },
        {"kind": "validation", "body": {"system": LAG, **CHANNELS, "limit_percent": 1.0, "diagnose": "never"}},
    ]
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["run"]) as client:
        identifier = measured(sqlite_service, monkeypatch, client, then)
        attempt = client.acquisitions.wait(identifier, timeout=120)["attempts"][-1]
        identification, validation = attempt["then"]
        assert (identification["status"], validation["status"]) == ("done", "done"), attempt
        assert identification["result"]["parameters"] == pytest.approx({"k": 3.0, "tau": 0.05}, rel=1e-3)
        assert validation["result"]["verdict"] == "pass"
        # White noise of 1 mm beside a response of about 2 m rms.
        assert validation["result"]["relative_error_percent"]["y"] < 0.1
        assert client.jobs.get(validation["job"]).status == "succeeded"


def test_a_failed_step_ends_the_chain_and_is_no_error_of_the_measurement(
    sqlite_service, sqlite_worker, monkeypatch
) -> None:
    then = [
        {"kind": "validation", "body": {"system": LAG, **CHANNELS, "limit_percent": 1.0, "diagnose": "never"}},
        {"kind": "identification", "body": {"system": LAG, **CHANNELS, "parameters": ["k"]}},
    ]
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["run"]) as client:
        identifier = measured(sqlite_service, monkeypatch, client, then)
        found = client.acquisitions.wait(identifier, timeout=120)
        assert found["status"] == "done"
        validation, identification = found["attempts"][-1]["then"]
        assert (validation["status"], validation["result"]["verdict"]) == ("failed", "fail")
        assert (identification["status"], identification["job"]) == ("skipped", None)
        assert "step 1 (validation) has failed" in identification["detail"]

        again = client.acquisitions.start("lag", rig="lag", channels=["u"], sample_rate=1000, duration=4)["id"]
        assert client.acquisitions.cancel(again)["status"] == "cancelled"
        with pytest.raises(JobFailedError, match="cancelled"):
            client.acquisitions.wait(again, timeout=5)
        assert client.acquisitions.retry(again)["attempt"] == 2
        assert again in [entry["id"] for entry in client.acquisitions.list(rig="lag", status="queued")]
        template = client.acquisitions.keep_template({"name": "any rig", "sample_rate": 500})
        assert template["id"] in [entry["id"] for entry in client.acquisitions.templates()]
        assert "lag" in [rig["name"] for rig in client.acquisitions.rigs()]
        assert [agent["rig"] for agent in client.acquisitions.agents()] == ["lag"]


def test_none_takes_what_a_template_has_away_and_nothing_said_leaves_it(service) -> None:
    drive = {"output": "valve", "signal": {"kind": "step", "amplitude": 1}}
    with service.client("acquire") as own, service.client() as admin:
        own.post("/v1/agents", json=AGENT | {"rig": "templated", "document": RIG}).raise_for_status()
        body = {
            "name": "t",
            "rig": "templated",
            "channels": ["position"],
            "sample_rate": 1000,
            "duration": 1,
            "drive": drive,
        }
        template = admin.post("/v1/acquisition-templates", json=body).json()["id"]
    with servotune.connect(service.url, key=service.keys["admin"]) as client:
        assert client.acquisitions.start(template=template).document["drive"] == drive
        assert client.acquisitions.start(template=template, drive=None).document.get("drive") is None


IDENTIFICATION = {"system": LAG, **CHANNELS, "parameters": ["k"]}


@pytest.mark.parametrize(
    ("kind", "change", "pointer", "says"),
    [
        ("identification", {"parameters": None}, "/parameters", "parameters must be a list, got None"),
        ("identification", {"parameters": ["k", "kk"]}, "/parameters/1", "'kk'"),
        ("identification", {"outputs": {"y": "z"}}, "/outputs/y", "one that is measured (u, y), got 'z'"),
        ("identification", {"inputs": {"force": "u"}}, "/inputs/force", "'force'"),
        ("identification", {"system": "sys_nowhere"}, "/system", "must be a stored system or a document"),
        ("identification", {"strats": 3}, "/strats", "strats must be left out: it is no field here"),
        ("validation", {"parameters": {"tau": {"value": 1, "unit": "kg"}}}, "/parameters/tau", "kg"),
        ("validation", {"limit_percent": 0}, "/limit_percent", "limit_percent must be > 0"),
    ],
)
def test_a_step_that_could_not_begin_is_refused_before_anything_is_recorded(
    service, kind, change, pointer, says
) -> None:
    usual = IDENTIFICATION if kind == "identification" else {"system": LAG, **CHANNELS}
    with service.client("acquire") as own, service.client() as admin:
        own.post("/v1/agents", json=AGENT | {"rig": "judged", "document": OWN}).raise_for_status()
        asked = {"name": "judged", "rig": "judged", "channels": ["u", "y"], "sample_rate": 1000, "duration": 4}
        fitting = admin.post("/v1/acquisitions", json=asked | {"then": [{"kind": kind, "body": usual}]})
        assert fitting.status_code == 202, fitting.text
        steps = [{"kind": kind, "body": usual}, {"kind": kind, "body": usual | change}]
        reply = admin.post("/v1/acquisitions", json=asked | {"then": steps})
    assert reply.status_code == 422, reply.text
    (wrong,) = reply.json()["errors"]
    assert (wrong["pointer"], says in wrong["detail"]) == (f"/then/1/body{pointer}", True), wrong
