"""Optimisations, identifications and their jobs: accepted, followed, cancelled, resumed; and what is refused."""

from __future__ import annotations

import copy
import json
import time

import pytest

from api.schemas.replies import JobReply, ValidationReply
from tests.integration.api.conftest import finished
from tests.integration.api.documents import LAG, PNEUMATIC, RAW, lag_recording, upload
from tests.support.patience import PATIENCE

OPTIMIZATION = {
    "system": PNEUMATIC,
    "variables": [{"parameter": "kp"}],
    "experiments": [{"name": "step", "input": {"port": "reference", "signal": {"kind": "step"}}}],
    "goals": [
        {"metric": "response_time", "experiment": "step", "output": "position", "sense": "minimize"},
        {"metric": "sensitivity_peak", "open_at": "error", "upper": 2.5},
    ],
    "scenarios": [{}, {"m": {"value": 0.35, "unit": "daN*s**2/cm"}}],
    "method": {"kind": "gradient", "starts": 2, "seed": 1, "max_evaluations": 200},
}


@pytest.fixture(scope="module")
def recording(client) -> str:
    return upload(client, RAW, lag_recording()).json()["id"]


@pytest.fixture
def identification(recording):
    return {
        "system": LAG,
        "dataset": recording,
        "inputs": {"u": "u"},
        "outputs": {"y": "y"},
        "parameters": ["k", {"parameter": "tau", "start": {"value": 100, "unit": "ms"}}],
        "offsets": "estimate",
    }


def events(client, identifier, *, after=None):
    """Return (id, event, data) of a job's stream."""
    headers = {"Last-Event-ID": str(after)} if after is not None else {}
    found, current = [], {}
    with client.stream("GET", f"/v1/jobs/{identifier}/events", headers=headers) as stream:
        assert stream.status_code == 200
        assert stream.headers["Content-Type"].startswith("text/event-stream")
        for line in stream.iter_lines():
            if line == "" and "id" in current:
                found.append((int(current["id"]), current["event"], json.loads(current["data"])))
                current = {}
            elif ":" in line and not line.startswith(":"):
                key, _, value = line.partition(":")
                current[key] = value.strip()
    return found


def test_an_identification_finds_what_made_the_recording(client, worker, identification) -> None:
    accepted = client.post("/v1/identifications", json=identification)
    assert accepted.status_code == 202, accepted.text
    job = accepted.json()
    JobReply.model_validate(job)
    assert accepted.headers["Location"] == f"/v1/jobs/{job['id']}"
    assert (job["kind"], job["status"]) == ("identification", "queued")
    seen = events(client, job["id"])
    done = client.get(f"/v1/jobs/{job['id']}").json()
    assert (done["status"], done["progress"]) == ("succeeded", 1.0)
    assert done["result"] == f"/v1/jobs/{job['id']}/result"
    result = client.get(done["result"]).json()
    # the recording was made with k = 3, tau = 0.05 s, offset 2 mm and 1 mm of noise
    for name, truth in (("k", 3.0), ("tau", 0.05)):
        estimate = result["parameters"][name]
        assert estimate["value"] == pytest.approx(truth, rel=2e-3)
        assert estimate["lower95"] < estimate["value"] < estimate["upper95"]
    assert result["offsets"]["y"] == pytest.approx(0.002, abs=2e-4)
    assert result["fit"]["validation"]["y"]["fit_percent"] > 99
    assert set(result["fit"]["baselines"]) == {"mean", "input", "static_gain"}
    assert result["status"] == "converged"

    # the events of a finished job can be read again, and from any place
    numbers = [number for number, _, _ in seen]
    assert numbers == list(range(1, len(numbers) + 1))
    assert {kind for _, kind, _ in seen} <= {"status", "progress", "message"}
    assert seen[0][1:] == ("status", {"status": "queued"})
    assert seen[-1][1:] == ("status", {"status": "succeeded"})
    assert events(client, job["id"], after=numbers[-2]) == seen[-1:]
    assert events(client, job["id"], after=numbers[-1]) == []


def test_a_validation_judges_the_model_against_its_limit(client, recording) -> None:
    body = {"system": LAG, "dataset": recording, "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    good = {"parameters": {"k": 3, "tau": {"value": 50, "unit": "ms"}}, "offsets": {"y": {"value": 2, "unit": "mm"}}}
    reply = client.post("/v1/validations", json=body | good)
    assert reply.status_code == 200, reply.text
    ValidationReply.model_validate(reply.json())
    found = reply.json()["outputs"]["y"]
    assert reply.json()["verdict"] == "pass"
    assert found["fit_percent"] > 99.5
    assert found["relative_error_percent"] < 0.5
    assert len(found["curves"]["time"]) == 4000
    assert found["baselines"]["input"]["fit_percent"] < found["fit_percent"]
    assert client.post("/v1/validations", json=body).json()["verdict"] == "fail"  # k = 1, tau = 0.2 s
    strict = client.post("/v1/validations", json=body | good | {"limit_percent": 1e-3}).json()
    assert strict["verdict"] == "fail"
    part = client.post("/v1/validations", json=body | good | {"window": [1, 2]}).json()["outputs"]["y"]
    assert (part["curves"]["time"][0], part["curves"]["time"][-1]) == (1.0, 2.0)
    assert 1.0 <= part["worst_interval"][0] < part["worst_interval"][1] <= 2.0


def test_a_sampled_command_may_be_a_recorded_channel(client, recording) -> None:
    signal = {"kind": "sampled", "dataset": recording, "channel": "u"}
    body = {"system": LAG, "input": {"port": "u", "signal": signal}, "duration": 3, "samples": 10}
    reply = client.post("/v1/simulations", json=body)
    assert reply.status_code == 200, reply.text
    wrong = copy.deepcopy(body)
    wrong["input"]["signal"]["channel"] = "ghost"
    refused = client.post("/v1/simulations", json=wrong)
    assert refused.json()["errors"][0]["pointer"] == "/input/signal/channel"


def test_an_optimization_improves_its_goal_and_proves_it(client, worker) -> None:
    stored = client.post("/v1/systems", json=PNEUMATIC).json()
    accepted = client.post("/v1/optimizations", json=OPTIMIZATION | {"system": stored["id"]})
    assert accepted.status_code == 202, accepted.text
    assert accepted.json()["system"] == {"id": stored["id"], "revision": 1}
    done = finished(client, accepted.json())
    assert done["status"] == "succeeded", done
    result = client.get(done["result"]).json()
    assert result["status"] in {"converged", "stalled", "budget"}
    assert result["system"] == {"id": stored["id"], "revision": 1}
    first, second = result["goals"]
    assert (first["metric"], first["experiment"], first["output"]) == ("response_time", "step", "position")
    assert first["after"]["value"] < first["before"]["value"]
    assert second["after"]["value"] <= 2.5 * (1 + 1e-6)
    assert all(goal["met"] for goal in result["goals"])
    assert result["certificate"]["valid"]
    assert result["certificate"]["worst_violation"] <= 1e-6
    assert {proof["goal"] for proof in result["certificate"]["goals"]} == {0, 1}
    assert 0.002 <= result["best"]["kp"] <= 0.025
    assert set(result["curves"]) == {"before", "after"}
    assert len(result["curves"]["after"]["step"]["outputs"]["position"]) == 1000
    assert result["history"]
    spent = [point["seconds"] for point in result["history"]]
    assert spent == sorted(spent)
    assert 0 < spent[-1] <= result["seconds"] <= done["seconds"]
    assert result["evaluations"] >= 1
    assert result["elasticities"]["response_time"]["kp"]["verdict"] == "ok"


def test_a_cancelled_job_stops_with_its_best_point(client, worker) -> None:
    long = OPTIMIZATION | {
        "variables": [{"parameter": name, "lower": 0.002, "upper": 0.02} for name in ("kp", "controller.ki", "controller.kd")],
        "method": {"kind": "gradient", "starts": 100, "seed": 1, "max_evaluations": 100_000},
    }  # fmt: skip
    job = client.post("/v1/optimizations", json=long).json()
    until = time.monotonic() + PATIENCE
    while "best after" not in str(client.get(f"/v1/jobs/{job['id']}").json()["message"]) and time.monotonic() < until:
        time.sleep(0.05)
    reply = client.post(f"/v1/jobs/{job['id']}/cancel")
    assert reply.status_code == 200
    assert finished(client, job)["status"] == "cancelled"
    assert events(client, job["id"])[-1][1:] == ("status", {"status": "cancelled"})
    # its best point until then follows, with its proof
    until = time.monotonic() + PATIENCE
    while (found := client.get(f"/v1/jobs/{job['id']}/result")).status_code == 409 and time.monotonic() < until:
        time.sleep(0.05)
    assert found.json()["status"] == "cancelled"
    # how many it has had by then depends on the machine
    assert 0 < found.json()["evaluations"] < long["method"]["max_evaluations"]
    assert set(found.json()["best"]) == {"kp", "controller.ki", "controller.kd"}
    assert "worst_violation" in found.json()["certificate"]
    assert client.get(f"/v1/jobs/{job['id']}").json()["result"] == f"/v1/jobs/{job['id']}/result"
    # cancelling again changes nothing
    assert client.post(f"/v1/jobs/{job['id']}/cancel").json()["status"] == "cancelled"
    # the worker is free for the next job
    next_job = client.post("/v1/optimizations", json=OPTIMIZATION).json()
    assert finished(client, next_job)["status"] == "succeeded"


def test_the_same_key_makes_one_job(client) -> None:
    headers = {"Idempotency-Key": "one-job"}
    first = client.post("/v1/optimizations", json=OPTIMIZATION, headers=headers)
    second = client.post("/v1/optimizations", json=OPTIMIZATION, headers=headers)
    assert second.status_code == 202
    assert second.json()["id"] == first.json()["id"]
    assert second.headers["Location"] == first.headers["Location"]
    client.post(f"/v1/jobs/{first.json()['id']}/cancel")


def test_jobs_are_listed_by_kind_and_status(client) -> None:
    job = client.post("/v1/optimizations", json=OPTIMIZATION).json()
    client.post(f"/v1/jobs/{job['id']}/cancel")
    cancelled = client.get("/v1/jobs", params={"status": "cancelled", "kind": "optimization"}).json()["items"]
    assert job["id"] in [row["id"] for row in cancelled]
    assert client.get("/v1/jobs", params={"kind": "nothing"}).json()["items"] == []
    assert client.get("/v1/jobs", params={"status": "asleep"}).status_code == 422


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/v1/jobs/job_nothing"),
        ("GET", "/v1/jobs/job_nothing/result"),
        ("GET", "/v1/jobs/job_nothing/events"),
        ("POST", "/v1/jobs/job_nothing/cancel"),
    ],
)
def test_a_job_that_is_not_there_is_a_404(client, method, path) -> None:
    reply = client.request(method, path)
    assert reply.status_code == 404
    assert reply.headers["Content-Type"] == "application/problem+json"


@pytest.mark.parametrize("last", ["x", "-1", "1.5", "9" * 30])
def test_a_wrong_last_event_id_is_refused(client, last) -> None:
    job = client.post("/v1/optimizations", json=OPTIMIZATION).json()
    client.post(f"/v1/jobs/{job['id']}/cancel")
    reply = client.get(f"/v1/jobs/{job['id']}/events", headers={"Last-Event-ID": last})
    assert reply.status_code == 422


def goal(**fields):
    return {"goals": [OPTIMIZATION["goals"][0] | fields]}


def variable(**fields):
    return {"variables": [{"parameter": "kp"} | fields]}


WRONG = {
    "unknown system": ({"system": "sys_nothing"}, "/system"),
    "no variables": ({"variables": []}, "/variables"),
    "unknown variable": (variable(parameter="ghost"), "/variables/0/parameter"),
    "bound variable": (variable(parameter="motor.mass"), "/variables/0/parameter"),
    "variable without bounds": (variable(parameter="m"), "/variables/0"),
    "variable in a wrong unit": (variable(lower={"value": 1, "unit": "kg"}), "/variables/0/lower"),
    "bounds crossed": (variable(lower=0.02, upper=0.01), "/variables/0/upper"),
    "log scale through 0": (variable(lower=0, upper=1, scale="log"), "/variables/0/lower"),
    "variable twice": ({"variables": [{"parameter": "kp"}, {"parameter": "kp"}]}, "/variables/1"),
    "no goals": ({"goals": []}, "/goals"),
    "too many goals": ({"goals": OPTIMIZATION["goals"] * 51}, "/goals"),
    "unknown metric": (goal(metric="beauty"), "/goals/0/metric"),
    "unknown experiment": (goal(experiment="ghost"), "/goals/0/experiment"),
    "unknown output": (goal(output="ghost"), "/goals/0/output"),
    "goal without output": (goal(output=None), "/goals/0/output"),
    "bound in a wrong unit": (goal(upper={"value": 1, "unit": "m"}), "/goals/0/upper"),
    "goal without aim": (goal(sense=None), "/goals"),
    "weight 0": (goal(weight=0), "/goals/0/weight"),
    "unknown sense": (goal(sense="better"), "/goals/0/sense"),
    "unknown loop": ({"goals": [*OPTIMIZATION["goals"][:1], {"metric": "gain_margin", "open_at": "ghost", "lower": 2}]}, "/goals/1/open_at"),
    "unknown port": ({"experiments": [{"name": "step", "input": {"port": "ghost", "signal": {"kind": "step"}}}]}, "/experiments/0/input/port"),
    "unknown scenario parameter": ({"scenarios": [{"ghost": 1}]}, "/scenarios/0/ghost"),
    "scenario of a variable": ({"scenarios": [{"kp": 1}]}, "/scenarios/0/kp"),
    "no scenarios": ({"scenarios": []}, "/scenarios"),
    "unknown method": ({"method": {"kind": "prayer"}}, "/method/kind"),
    "unknown option": ({"method": {"kind": "gradient", "luck": 1}}, "/method/luck"),
    "option out of bounds": ({"method": {"kind": "gradient", "starts": 0}}, "/method/starts"),
    "no method": ({"method": None}, "/method"),
    "unknown field": ({"objective": "speed"}, "/objective"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_optimization_is_refused_at_its_place(client, case) -> None:
    fields, pointer = WRONG[case]
    reply = client.post("/v1/optimizations", json=OPTIMIZATION | fields)
    assert reply.status_code == 422, reply.text
    assert any(entry["pointer"].startswith(pointer) for entry in reply.json()["errors"]), reply.text


WRONG_IDENTIFICATIONS = {
    "unknown dataset": ({"dataset": "ds_nothing"}, "/dataset"),
    "unknown input": ({"inputs": {"ghost": "u"}}, "/inputs/ghost"),
    "unknown input channel": ({"inputs": {"u": "ghost"}}, "/inputs/u"),
    "unknown output": ({"outputs": {"ghost": "y"}}, "/outputs/ghost"),
    "unknown output channel": ({"outputs": {"y": "ghost"}}, "/outputs/y"),
    "no inputs": ({"inputs": {}}, "/inputs"),
    "no outputs": ({"outputs": {}}, "/outputs"),
    "no parameters": ({"parameters": []}, "/parameters"),
    "unknown parameter": ({"parameters": ["ghost"]}, "/parameters/0"),
    "start out of bounds": ({"parameters": [{"parameter": "k", "start": 100}]}, "/parameters/0/start"),
    "start in a wrong unit": ({"parameters": [{"parameter": "tau", "start": {"value": 1, "unit": "m"}}]}, "/parameters/0/start"),
    "split 0": ({"split": 0}, "/split"),
    "split above 1": ({"split": 1.5}, "/split"),
    "split beside experiments": ({"experiments": [{"dataset": "ds_x", "inputs": {"u": "u"}, "outputs": {"y": "y"}}], "dataset": None, "inputs": None, "outputs": None, "split": 0.9}, ""),
    "window backwards": ({"estimation": [2, 1]}, "/estimation"),
    "window beyond the recording": ({"estimation": [100, 200]}, "/estimation"),
    "window of one": ({"validation": [1]}, "/validation"),
    "window too short": ({"estimation": [1, 1.005]}, "/estimation"),
    "unknown offsets": ({"offsets": "guess"}, "/offsets"),
    "unknown field": ({"limit": 1}, "/limit"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG_IDENTIFICATIONS)
def test_a_wrong_identification_is_refused_at_its_place(client, identification, case) -> None:
    fields, pointer = WRONG_IDENTIFICATIONS[case]
    reply = client.post("/v1/identifications", json=identification | fields)
    assert reply.status_code == 422, reply.text
    assert any(entry["pointer"].startswith(pointer) for entry in reply.json()["errors"]), reply.text


WRONG_VALIDATIONS = {
    "unknown dataset": ({"dataset": "ds_nothing"}, "/dataset"),
    "unknown input": ({"inputs": {"ghost": "u"}}, "/inputs/ghost"),
    "unknown channel": ({"outputs": {"y": "ghost"}}, "/outputs/y"),
    "unknown parameter": ({"parameters": {"ghost": 1}}, "/parameters/ghost"),
    "parameter in a wrong unit": ({"parameters": {"tau": {"value": 1, "unit": "m"}}}, "/parameters/tau"),
    "offset of an unknown output": ({"offsets": {"ghost": 1}}, "/offsets/ghost"),
    "window backwards": ({"window": [2, 1]}, "/window"),
    "window in metres": ({"window": [{"value": 1, "unit": "m"}, 2]}, "/window/0"),
    "window beyond the recording": ({"window": [100, 200]}, "/window"),
    "limit 0": ({"limit_percent": 0}, "/limit_percent"),
    "unknown field": ({"split": 0.5}, "/split"),
}


@pytest.mark.parametrize("case", WRONG_VALIDATIONS)
def test_a_wrong_validation_is_refused_at_its_place(client, recording, case) -> None:
    fields, pointer = WRONG_VALIDATIONS[case]
    body = {"system": LAG, "dataset": recording, "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    reply = client.post("/v1/validations", json=body | fields)
    assert reply.status_code == 422, reply.text
    assert any(entry["pointer"].startswith(pointer) for entry in reply.json()["errors"]), reply.text


def test_an_unstable_model_has_no_validation(client, recording) -> None:
    unstable = copy.deepcopy(LAG)
    unstable["blocks"]["plant"] = {"kind": "transfer_function", "numerator": [1], "denominator": [0.001, -1]}
    unstable["parameters"] = {}
    body = {"system": unstable, "dataset": recording, "inputs": {"u": "u"}, "outputs": {"y": "y"}}
    reply = client.post("/v1/validations", json=body)
    assert reply.status_code == 422
    assert "unstable" in reply.json()["detail"]
