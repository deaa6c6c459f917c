"""Measurements over HTTP: the service's side of every agreement with an agent."""

from __future__ import annotations

import re
import threading
from datetime import timedelta
from typing import Any

import httpx
import pytest

from storage import open_database
from storage.models import AcquisitionAttempt, Agent
from storage.models.base import utc_now
from tests.integration.api.rigs import AGENT, CHANNELS, MEASUREMENT, RIG, deliver, samples


@pytest.fixture
def agent(client, request) -> str:
    """An agent with a rig of this test's own."""
    return _register(client, rig=request.node.name)


def _register(client: httpx.Client, **change: Any) -> str:
    reply = client.post("/v1/agents", json=AGENT | change)
    assert reply.status_code == 200, reply.text
    return str(reply.json()["id"])


def _ask(client: httpx.Client, rig: str, **change: Any) -> dict[str, Any]:
    reply = client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": rig} | change)
    assert reply.status_code == 202, reply.text
    return dict(reply.json())


def _claim(client: httpx.Client, agent: str, **query: Any) -> dict[str, Any]:
    reply = client.post(f"/v1/agents/{agent}/claim", params=query)
    assert reply.status_code == 200, reply.text
    return dict(reply.json())


def _where(claim: dict[str, Any]) -> str:
    return f"/v1/acquisitions/{claim['acquisition']}/attempts/{claim['attempt']}"


def _age(service, acquisition: str, *, seconds: float) -> None:
    """Let an attempt's lease, and its agent's last word, lie further back."""
    database = open_database(service.database_url)
    with database.session() as session:
        attempt = session.query(AcquisitionAttempt).filter_by(acquisition_id=acquisition).one()
        attempt.lease_until = utc_now() - timedelta(seconds=seconds)
        session.get_one(Agent, attempt.agent_id).seen_at = utc_now() - timedelta(seconds=seconds + 30)
    database.dispose()


def _heartbeat(client: httpx.Client, claim: dict[str, Any], agent: str, **values: Any) -> httpx.Response:
    return client.post(f"{_where(claim)}/heartbeat", json={"agent": agent, "status": "running", **values})


def test_a_measurement_goes_from_the_request_to_a_dataset_with_its_provenance(client, agent, request) -> None:
    rig = request.node.name
    asked = client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": rig})
    assert asked.headers["Location"] == f"/v1/jobs/{asked.json()['job']}"
    assert asked.json()["status"] == "queued"
    assert asked.json()["warnings"] == [
        {"pointer": "/channels/1", "level": "warning", "detail": "calibration of position was due on 2021-01-01"}
    ]
    claim = _claim(client, agent)
    # 5 Hz are 10 pi rad/s; an agent is told SI and nothing else.
    assert claim["request"]["drive"]["signal"]["frequency"] == pytest.approx(31.41592653589793, rel=1e-15)
    assert claim["request"]["pre_trigger"] == 0.1
    here = f"/v1/acquisitions/{claim['acquisition']}"
    assert client.get(here).json()["status"] == "claimed"

    preview = {"start": 0.0, "step": 0.01, "channels": {"position": [[0.0, 1.0], [0.5, 2.0]]}}
    assert _heartbeat(client, claim, agent, progress=0.5, message="recording", preview=preview).status_code == 200
    job = client.get(f"/v1/jobs/{claim['job']}").json()
    assert (job["kind"], job["status"], job["progress"], job["message"]) == ("acquisition", "running", 0.5, "recording")

    assert _heartbeat(client, claim, agent, status="uploading").status_code == 200
    early = client.post(f"{_where(claim)}/finish", json={"agent": agent})
    assert early.status_code == 409
    data = samples()
    facts = {"actual_rate": 1024.0, "samples": 600}
    assert deliver(client, claim, agent, data, facts=facts).json()["status"] == "done"
    # The agent did not hear the answer, and says it again.
    again = client.post(f"{_where(claim)}/finish", json={"agent": agent, "facts": facts}).json()
    assert (again["status"], again["late"]) == ("done", False)
    done = client.get(here).json()
    assert (done["status"], done["attempts"][0]["facts"]) == ("done", facts)
    (listed,) = client.get("/v1/acquisitions", params={"rig": rig}).json()["items"]
    assert listed["dataset"] == done["dataset"] is not None
    dataset = client.get(f"/v1/datasets/{done['dataset']}").json()
    assert (dataset["sample_rate"], dataset["sample_count"], dataset["status"]) == (1024, 600, "ready")
    assert client.get(f"/v1/datasets/{done['dataset']}/original").content == data
    origin = dataset["document"]["origin"] if "origin" not in dataset else dataset["origin"]
    assert origin["rig"]["inputs"][1]["calibration"]["certificate"] == "C-17"
    assert origin["requested"]["sample_rate"] == 1000
    result = client.get(f"/v1/jobs/{claim['job']}/result").json()
    assert (result["dataset"], result["facts"]) == (done["dataset"], facts)

    with client.stream("GET", f"{here}/events") as stream:
        told = [line.removeprefix("event: ") for line in stream.iter_lines() if line.startswith("event: ")]
    assert told == ["status", "status", "progress", "preview", "status"]


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"rig": "nowhere"}, "/rig"),
        ({"channels": ["position", "speed"]}, "/channels/1"),
        ({"channels": ["position", "position"]}, "/channels/1"),
        ({"duration": 0}, "/duration"),
        ({"duration": 0.001, "pre_trigger": 0}, "/duration"),
        ({"duration": 30, "averages": 3}, "/duration"),
        ({"pre_trigger": -1}, "/pre_trigger"),
        ({"drive": {"output": "pump", "signal": {"kind": "step"}}}, "/drive/output"),
        ({"drive": {"output": "valve", "signal": {"kind": "step", "amplitude": 5.1}}}, "/drive/signal"),
        (
            {"drive": {"output": "valve", "signal": {"kind": "stepped_sine", "amplitude": 1, "frequencies": [0], "dwell": 1}}},
            "/drive/signal/frequencies/0",
        ),
        ({"then": [{"kind": "average"}]}, "/then/0/kind"),
        ({"then": [{"kind": "validation", "body": {"dataset": "ds_1"}}]}, "/then/0/body"),
        ({"channels": None}, "/channels"),
        ({"template": "tpl_none"}, "/template"),
    ],
)  # fmt: skip
def test_what_a_rig_cannot_do_is_refused_at_its_place(client, change, pointer) -> None:
    _register(client, rig="refusing")
    reply = client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": "refusing"} | change)
    assert (reply.status_code, reply.json()["errors"][0]["pointer"][: len(pointer)]) == (422, pointer), reply.text


LEVEL: dict[str, Any] = {"channel": "position", "edge": "rising", "level": 2}
WINDOW: dict[str, Any] = {"channel": "position", "window": [1, 3], "when": "leaves"}


@pytest.mark.parametrize(
    ("trigger", "told"),
    [
        (LEVEL, {"when": "enters", "low": 2.0, "high": None, "hysteresis": 0.0, "timeout": 60.0}),
        (
            {**LEVEL, "edge": "falling", "level": "0.2 cm", "hysteresis": "100 um", "timeout": "2 min"},
            {"when": "enters", "low": None, "high": 2.0, "hysteresis": 0.1, "timeout": 120.0},
        ),
        (
            {**WINDOW, "window": [{"value": 0.1, "unit": "cm"}, 3], "hysteresis": 0.5},
            {"when": "leaves", "low": 1.0, "high": 3.0, "hysteresis": 0.5, "timeout": 60.0},
        ),
    ],
)
def test_a_trigger_is_told_in_the_unit_of_its_channel(client, agent, request, trigger, told) -> None:
    _ask(client, request.node.name, drive=None, trigger=trigger)
    assert _claim(client, agent)["request"]["trigger"] == {"channel": "position", "unit": "mm", **told}


@pytest.mark.parametrize(
    ("change", "pointer", "says"),
    [
        ({"drive": MEASUREMENT["drive"]}, "/trigger", "must be left out beside a drive, got one for position: the drive of valve"),
        ({"averages": 3}, "/averages", "averages must be 1 with a trigger, got 3"),
        ({"channels": ["loopback"]}, "/trigger/channel", "must be one that is measured (loopback), got 'position'"),
        ({"pre_trigger": 4001}, "/pre_trigger", "must hold at most 8e+06 samples of all channels with a trigger, got 8.002e+06"),
        ({"trigger": LEVEL | {"level": "2 kg"}}, "/trigger/level", "level must be in mm, got 'kg'"),
        ({"trigger": LEVEL | {"level": 101}}, "/trigger/level", "must be within -100 ... 100 mm, which is what the range of position lets through, got 101"),
        ({"trigger": WINDOW | {"window": [-200, 300]}}, "/trigger/window", "must begin or end within -100 ... 100 mm"),
        ({"trigger": LEVEL | {"hysteresis": -0.5}}, "/trigger/hysteresis", "hysteresis must be >= 0 mm, got -0.5"),
        ({"trigger": LEVEL | {"level": -99, "hysteresis": 50}}, "/trigger/hysteresis", "hysteresis must be <= 1 mm, by which the range of position lets it come back from the level, got 50"),
        ({"trigger": LEVEL | {"timeout": 0}}, "/trigger/timeout", "timeout must be > 0 and <= 3600 s, got 0"),
        ({"trigger": LEVEL | {"timeout": "61 min"}}, "/trigger/timeout", "timeout must be > 0 and <= 3600 s, got 3660"),
        ({"trigger": LEVEL | {"edge": "up"}}, "/trigger/edge", "'rising' or 'falling'"),
        ({"trigger": WINDOW | {"window": [3, 3]}}, "/trigger/window", "must be [low, high] with low < high, got [3, 3] mm"),
        ({"trigger": WINDOW | {"hysteresis": 1}}, "/trigger/hysteresis", "must be < half of the window that is left, 1 mm, got 1"),
    ],
)  # fmt: skip
def test_a_trigger_that_makes_no_sense_is_refused(client, change, pointer, says) -> None:
    _register(client, rig="refusing")
    asked = MEASUREMENT | {"rig": "refusing", "drive": None, "trigger": LEVEL} | change
    reply = client.post("/v1/acquisitions", json=asked)
    assert reply.status_code == 422, reply.text
    (wrong,) = reply.json()["errors"]
    assert (wrong["pointer"], says in wrong["detail"]) == (pointer, True), wrong


def test_a_signal_that_no_agent_knows_is_told_as_its_points(client, agent, request) -> None:
    profile = {"kind": "s_curve", "distance": 0.9, "max_velocity": 10, "max_acceleration": 100, "max_jerk": 5000}
    _ask(client, request.node.name, drive={"output": "valve", "signal": profile})
    told = _claim(client, agent)["request"]["drive"]["signal"]
    assert told["kind"] == "sampled"
    assert told["values"][-1] == pytest.approx(0.9, rel=1e-12)  # it arrives at its distance
    assert len(told["time"]) >= 501


def test_what_the_agent_has_seen_is_a_warning_whatever_else_it_says(client, agent, request) -> None:
    _ask(client, request.node.name)
    claim = _claim(client, agent)
    seen = [
        {"channel": "loopback", "level": "warning", "detail": "loopback reached its range"},
        {"channel": "loopback", "level": "information", "detail": "a smaller range would do"},
        {"channel": "other", "level": "warning", "detail": "no channel of this measurement"},
        {"channel": ["loopback"], "level": {}, "detail": None},
        "no document",
    ]
    assert deliver(client, claim, agent, samples(), facts={"warnings": seen}).json()["status"] == "done"
    (due, *told) = client.get(f"/v1/acquisitions/{claim['acquisition']}").json()["warnings"]
    assert due["pointer"] == "/channels/1"
    assert told == [
        {"pointer": "/channels/0", **{key: entry[key] for key in ("level", "detail")}} for entry in seen[:2]
    ]
    _ask(client, request.node.name)
    again = _claim(client, agent)
    assert deliver(client, again, agent, samples(), facts={"warnings": 7}).status_code == 200
    assert len(client.get(f"/v1/acquisitions/{again['acquisition']}").json()["warnings"]) == 1


def test_one_attempt_at_a_time_is_on_a_rig(client, agent, request) -> None:
    first, second = (_ask(client, request.node.name) for _ in range(2))
    claim = _claim(client, agent)
    assert claim["acquisition"] == first["id"]
    assert client.post(f"/v1/agents/{agent}/claim").status_code == 204
    # While samples travel the rig is free.
    assert _heartbeat(client, claim, agent, status="uploading").status_code == 200
    assert _claim(client, agent)["acquisition"] == second["id"]
    assert _heartbeat(client, claim, agent, status="running").status_code == 409


def test_a_waiting_agent_gets_what_is_asked_for_meanwhile(client, agent, request) -> None:
    asking = threading.Timer(0.3, lambda: _ask(client, request.node.name))
    asking.start()
    assert _claim(client, agent, wait=20)["attempt"] == 1
    asking.join()


def test_two_agents_of_one_rig_take_turns(client, service, agent, request) -> None:
    rig = request.node.name
    other = AGENT | {"rig": rig, "instance": "fedcba9876543210", "name": "lab PC 2"}
    refused = client.post("/v1/agents", json=other)
    assert refused.status_code == 409
    assert "'lab PC 1' has it" in refused.json()["detail"]
    assert _register(client, rig=rig) == agent  # the same one may come again at any time
    _ask(client, rig)
    claim = _claim(client, agent)
    _age(service, claim["acquisition"], seconds=1)
    second = client.post("/v1/agents", json=other).json()["id"]
    assert client.post(f"/v1/agents/{agent}/claim").status_code == 409  # told to register again
    _ask(client, rig)
    assert _claim(client, second)["acquisition"] != claim["acquisition"]


def test_an_attempt_without_a_word_is_lost_and_never_repeated_by_itself(client, service, agent, request) -> None:
    rig = request.node.name
    _ask(client, rig)
    claim = _claim(client, agent)
    here = f"/v1/acquisitions/{claim['acquisition']}"
    _age(service, claim["acquisition"], seconds=1)
    late = _heartbeat(client, claim, agent)
    assert (late.status_code, late.json()["type"]) == (409, "urn:servotune:problem:lease-lost")
    assert client.post(f"/v1/agents/{agent}/claim").status_code == 204
    lost = client.get(here).json()
    assert lost["status"] == "lost"
    assert client.get(f"/v1/jobs/{claim['job']}").json()["error"]["type"] == "urn:servotune:problem:lost"

    # Its samples are kept under its number, and start nothing.
    data = samples()
    assert deliver(client, claim, agent, data).json() == {
        "status": "lost", "late": True, "dataset": client.get(here).json()["dataset"],
    }  # fmt: skip
    kept = client.get(here).json()["attempts"][0]
    assert (kept["status"], kept["late"]) == ("lost", True)
    assert client.get(f"/v1/datasets/{kept['dataset']}/original").content == data

    again = client.post(f"{here}/retry")
    assert (again.status_code, again.json()["status"], again.json()["attempt"]) == (202, "queued", 2)
    assert client.post(f"{here}/retry").status_code == 409
    assert again.json()["job"] != claim["job"]
    second = _claim(client, agent)
    assert (second["acquisition"], second["attempt"]) == (claim["acquisition"], 2)
    assert deliver(client, second, agent, data).json()["status"] == "done"
    done = client.get(here).json()
    assert [attempt["status"] for attempt in done["attempts"]] == ["lost", "done"]
    assert len({attempt["dataset"] for attempt in done["attempts"]}) == 2


def test_a_measurement_waits_for_a_rig_that_cannot_be_brought_to_rest_and_says_so(client, request) -> None:
    name = request.node.name
    found = {"result": "fails", "what": "hardware", "told": "the device is gone", "remedy": "plug it in"}
    _register(client, rig=name, document=RIG | {"findings": [found]})
    (told,) = (warning for warning in _ask(client, name)["warnings"] if warning["pointer"] == "/rig")
    assert told["detail"] == f"{name} measures nothing before this is mended: the device is gone - plug it in"
    _register(client, rig=name, document=RIG | {"findings": [found | {"result": "ok", "remedy": ""}]})
    assert not [warning for warning in _ask(client, name)["warnings"] if warning["pointer"] == "/rig"]


def test_inputs_without_a_clock_are_not_measured_alone(client, request) -> None:
    name = request.node.name
    edges = {"name": "edges", "channel": "Dev1/ctr0", "kind": "counter"}
    _register(client, rig=name, document=RIG | {"inputs": [*RIG["inputs"], edges]})
    asked = MEASUREMENT | {"rig": name, "drive": None}
    refused = client.post("/v1/acquisitions", json=asked | {"channels": ["edges"]})
    assert refused.status_code == 422, refused.text
    (wrong,) = refused.json()["errors"]
    assert (wrong["pointer"], "must have an analog input" in wrong["detail"]) == ("/channels", True), wrong
    _ask(client, name, drive=None, channels=["edges", "loopback"])


def test_a_rig_whose_agent_is_gone_says_so_and_a_measurement_that_waits_for_it(client, service, agent, request) -> None:
    name = request.node.name
    rig = f"/v1/rigs/{client.get(f'/v1/agents/{agent}').json()['rig_id']}"
    first = _ask(client, name)
    assert client.get(rig).json()["present"] is True
    assert not [warning for warning in first["warnings"] if warning["pointer"] == "/rig"]
    claim = _claim(client, agent)
    _age(service, claim["acquisition"], seconds=60)
    assert client.get(rig).json()["present"] is False
    assert {entry["name"]: entry["present"] for entry in client.get("/v1/rigs").json()["items"]}[name] is False
    asked = _ask(client, name)
    (told,) = (warning for warning in asked["warnings"] if warning["pointer"] == "/rig")
    assert told["level"] == "warning"
    assert re.fullmatch(
        rf"the agent of {re.escape(name)} must be heard of every 30 s, it was not for 9\d s: the measurement waits until it is back",
        told["detail"],
    )
    assert client.post(f"/v1/agents/{agent}/claim").status_code == 200  # it is back
    begun = client.get(f"/v1/acquisitions/{asked['id']}").json()
    assert not [warning for warning in begun["warnings"] if warning["pointer"] == "/rig"]


def test_a_cancelled_attempt_is_taken_from_its_agent(client, agent, request) -> None:
    waiting = _ask(client, request.node.name)
    assert client.post(f"/v1/acquisitions/{waiting['id']}/cancel").json()["status"] == "cancelled"
    _ask(client, request.node.name)
    claim = _claim(client, agent)
    # Either way: the measurement, or its job.
    assert client.post(f"/v1/jobs/{claim['job']}/cancel").json()["status"] == "cancelled"
    told = _heartbeat(client, claim, agent)
    assert (told.status_code, told.json()["type"]) == (409, "urn:servotune:problem:cancelled")
    assert "was cancelled" in told.json()["detail"]
    assert client.post(f"/v1/agents/{agent}/claim").status_code == 204


def test_a_failure_is_told_in_the_agents_words(client, agent, request) -> None:
    _ask(client, request.node.name)
    claim = _claim(client, agent)
    error = {"code": "overrun", "detail": "the PC could not keep up"}
    assert client.post(f"{_where(claim)}/finish", json={"agent": agent, "error": error}).json()["status"] == "failed"
    told = client.get(f"/v1/jobs/{claim['job']}").json()["error"]
    assert told == {"type": "urn:servotune:problem:overrun", "title": "Overrun", "detail": "the PC could not keep up"}


def test_only_a_key_for_acquisition_is_an_agents_key(service, agent) -> None:
    for scope in ("read", "write", "run"):
        with service.client(scope) as other:
            assert other.post("/v1/agents", json=AGENT).status_code == 403
            assert other.post(f"/v1/agents/{agent}/claim").status_code == 403
    with service.client("acquire") as own:
        assert own.post(f"/v1/agents/{agent}/claim").status_code == 204
        assert own.post("/v1/acquisitions", json=MEASUREMENT).status_code == 403  # an agent asks for nothing


def test_an_agent_of_another_rig_has_no_say(client, agent, request) -> None:
    _ask(client, request.node.name)
    claim = _claim(client, agent)
    stranger = _register(client, rig="another rig")
    assert _heartbeat(client, claim, stranger).status_code == 409
    opening = {"agent": stranger, "start_time": claim["time"], "sample_rate": 1, "channels": CHANNELS}
    assert client.post(f"{_where(claim)}/dataset", json=opening).status_code == 409


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"inputs": [RIG["inputs"][0], RIG["inputs"][0]]}, "/document/inputs/1/name"),
        ({"inputs": [RIG["inputs"][0] | {"unit": "parsnip"}]}, "/document/inputs/0/unit"),
        ({"inputs": [RIG["inputs"][0] | {"unit": "degC"}]}, "/document/inputs/0/unit"),
        ({"inputs": [RIG["inputs"][0] | {"sensitivity": 0}]}, "/document/inputs/0/sensitivity"),
        ({"inputs": [RIG["inputs"][0] | {"kind": "acceleration", "unit": "mm"}]}, "/document/inputs/0/unit"),
        ({"inputs": [RIG["inputs"][0] | {"kind": "force", "unit": "kg"}]}, "/document/inputs/0/unit"),
        ({"outputs": [RIG["outputs"][0] | {"safe": 6}]}, "/document/outputs/0/safe"),
    ],
)
def test_a_rig_that_makes_no_sense_is_refused(client, change, pointer) -> None:
    reply = client.post("/v1/agents", json=AGENT | {"rig": "wrong", "document": RIG | change})
    assert (reply.status_code, reply.json()["errors"][0]["pointer"]) == (422, pointer)


def test_a_template_is_asked_for_with_what_differs(client, agent, request) -> None:
    rig = request.node.name
    made = client.post("/v1/acquisition-templates", json=MEASUREMENT | {"rig": rig})
    assert made.status_code == 201, made.text
    where = made.headers["Location"]
    asked = client.post("/v1/acquisitions", json={"template": made.json()["id"], "duration": 0.2})
    assert asked.status_code == 202, asked.text
    assert asked.json()["document"] == MEASUREMENT | {"rig": rig, "duration": 0.2}
    open_ended = {"name": "any rig", "sample_rate": 500}
    assert client.put(where, json=open_ended, headers={"If-Match": '"1"'}).json()["revision"] == 2
    missing = client.post("/v1/acquisitions", json={"template": made.json()["id"], "rig": rig})
    assert missing.json()["errors"][0]["pointer"] == "/channels"
    wrong = client.post("/v1/acquisition-templates", json=MEASUREMENT | {"rig": rig, "channels": ["speed"]})
    assert wrong.status_code == 422
    assert client.delete(where, headers={"If-Match": "*"}).status_code == 204
    assert client.get(where).status_code == 404


TRIGGER = {"channel": "position", "edge": "rising", "level": 2}


def test_an_older_agent_is_not_asked_for_what_it_would_pass_over(client, request) -> None:
    """It says of itself what it understands; one that took the rig over in between fails what was asked of the newer one."""
    rig = request.node.name
    older = {key: value for key, value in RIG.items() if key != "understands"}
    old = _register(client, rig=rig, document=older)
    body = MEASUREMENT | {"rig": rig, "drive": None}
    for more, named in (({"trigger": TRIGGER}, "trigger"), ({"record": False}, "record")):
        refused = client.post("/v1/acquisitions", json=body | more)
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["pointer"] == f"/{named}"
        assert f"{named} must be known to the agent of {rig}, it is not: update the agent" in refused.json()["detail"]
    _register(client, rig=rig)
    asked = _ask(client, rig, drive=None, trigger=TRIGGER)
    _register(client, rig=rig, document=older)
    assert client.post(f"/v1/agents/{old}/claim").status_code == 204
    failed = client.get(f"/v1/acquisitions/{asked['id']}").json()
    assert failed["status"] == "failed"
    assert failed["attempts"][0]["error"]["type"] == "urn:servotune:problem:agent_too_old"
    assert "trigger must be known to the agent" in failed["attempts"][0]["error"]["detail"]
    _ask(client, rig)
    assert _claim(client, old)["request"]["trigger"] is None  # what it knows goes on


def test_null_takes_a_trigger_or_a_drive_of_a_template_away(client, request) -> None:
    rig = request.node.name
    _register(client, rig=rig)
    waiting = {key: value for key, value in MEASUREMENT.items() if key != "drive"} | {"rig": rig, "trigger": TRIGGER}
    for kept, taken in ((waiting, "trigger"), (MEASUREMENT | {"rig": rig}, "drive")):
        template = client.post("/v1/acquisition-templates", json=kept)
        assert template.status_code == 201, template.text
        asked = client.post("/v1/acquisitions", json={"template": template.json()["id"], taken: None})
        assert asked.status_code == 202, asked.text
        assert asked.json()["document"].get(taken) is None
        same = client.post("/v1/acquisitions", json={"template": template.json()["id"], "channels": None})
        assert same.json()["document"][taken] == kept[taken]


def test_what_is_shown_only_ends_without_a_dataset_and_keeps_its_newest_preview_alone(client, request) -> None:
    rig = request.node.name
    agent = _register(client, rig=rig)
    asked = _ask(client, rig, drive=None, record=False)
    claim = _claim(client, agent)
    assert claim["request"]["record"] is False
    for sweep in (1, 2, 3):
        preview = {"start": -0.1, "step": 0.01, "channels": {"position": [[0, sweep]]}, "sweep": sweep}
        assert _heartbeat(client, claim, agent, preview=preview).status_code == 200
    done = client.post(f"{_where(claim)}/finish", json={"agent": agent, "facts": {"sweeps": 3}})
    assert done.json() == {"status": "done", "dataset": None, "late": False}
    events = client.get(f"/v1/jobs/{asked['job']}/events").text
    assert events.count('"sweep"') == 1
    assert '"sweep":3' in events.replace(" ", "")


def test_a_stage_whose_calibration_is_over_is_told_and_one_without_gain_refused(client, request) -> None:
    rig = request.node.name
    stage = {"model": "amplifier", "gain": 10, "calibration": {"due": "2021-02-03"}}
    inputs = [RIG["inputs"][0] | {"chain": [stage]}, RIG["inputs"][1]]
    _register(client, rig=rig, document=RIG | {"inputs": inputs})
    told = [warning["detail"] for warning in _ask(client, rig)["warnings"]]
    assert told[0] == "calibration of amplifier behind loopback was due on 2021-02-03"
    inputs = [RIG["inputs"][0] | {"chain": [stage | {"gain": 0}]}, RIG["inputs"][1]]
    refused = client.post("/v1/agents", json=AGENT | {"rig": rig, "document": RIG | {"inputs": inputs}})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/document/inputs/0/chain/0/gain"


@pytest.mark.parametrize(
    ("signal", "says"),
    [
        ({"kind": "sine", "amplitude": 1, "frequency": "700 Hz"}, "below half the sample rate, 500 Hz, got 700 Hz"),
        (
            {"kind": "chirp", "amplitude": 1, "start_frequency": "1 Hz", "end_frequency": "500 Hz", "duration": 0.5},
            "below half the sample rate, 500 Hz, got 500 Hz",
        ),
        (
            {"kind": "multisine", "amplitude": 1, "fundamental": "100 Hz", "harmonics": [1, 6]},
            "below half the sample rate, 500 Hz, got 600 Hz",
        ),
        (
            {"kind": "stepped_sine", "amplitude": 1, "frequencies": ["1 Hz", "501 Hz"], "dwell": 0.1},
            "below half the sample rate, 500 Hz, got 501 Hz",
        ),
        ({"kind": "sine", "amplitude": "5 mm", "frequency": "7 Hz"}, "amplitude must be in V"),
        ({"kind": "step", "amplitude": "1 A"}, "amplitude must be in V"),
        ({"kind": "stepped_sine", "amplitude": "1 N", "frequencies": ["1 Hz"], "dwell": 0.1}, "amplitude must be in V"),
    ],
)
def test_what_an_output_cannot_play_is_refused(client, agent, request, signal, says) -> None:
    body = MEASUREMENT | {"rig": request.node.name, "drive": {"output": "valve", "signal": signal}}
    refused = client.post("/v1/acquisitions", json=body)
    assert refused.status_code == 422, refused.text
    assert says in refused.json()["detail"]
    assert refused.json()["errors"][0]["pointer"].startswith("/drive/signal")


def test_an_amplitude_has_the_unit_of_its_output(client, request) -> None:
    rig = request.node.name
    outputs = [RIG["outputs"][0], RIG["outputs"][0] | {"name": "coil", "kind": "current", "amplitude": 0.02}]
    _register(client, rig=rig, document=RIG | {"outputs": outputs})
    for output, amplitude in (("valve", "900 mV"), ("coil", "8 mA")):
        drive = {"output": output, "signal": {"kind": "step", "amplitude": amplitude}}
        asked = client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": rig, "drive": drive})
        assert asked.status_code == 202, asked.text
    wrong = {"output": "coil", "signal": {"kind": "step", "amplitude": "0.008 V"}}
    assert client.post("/v1/acquisitions", json=MEASUREMENT | {"rig": rig, "drive": wrong}).status_code == 422
