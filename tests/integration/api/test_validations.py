"""Validations over HTTP: what a reply tells beside the verdict, as a job, after an identification, and on bad input."""

from __future__ import annotations

import copy
from typing import Any

import httpx
import numpy as np
import pytest

from api.schemas.replies import ValidationReply
from tests.integration.api.conftest import finished, serving
from tests.integration.api.documents import LAG, RAW, lag_recording, upload

SAMPLES = 3000


@pytest.fixture(scope="module")
def client(sqlite_service):
    with sqlite_service.client() as own:
        yield own


@pytest.fixture(scope="module")
def recording(client) -> str:
    """The lag of k = 3, tau = 0.05 s, offset 2 mm, 1 mm of noise."""
    return str(upload(client, RAW, lag_recording(samples=SAMPLES)).json()["id"])


def made(client: httpx.Client, columns: dict[str, np.ndarray], **channels: Any) -> str:
    """Upload channels in V and mm, or as ``channels`` has them."""
    described = [{"name": name, "unit": {"u": "V"}.get(name, "mm")} | channels.get(name, {}) for name in columns]
    document = {"name": "made", "format": "raw", "sample_rate": 1000, "channels": described}
    data = np.column_stack(list(columns.values())).astype("<f8").tobytes()
    reply = upload(client, document, data, segment=len(data))
    assert reply.status_code == 200, reply.text
    return str(reply.json()["id"])


def asked(dataset: str, **more: Any) -> dict[str, Any]:
    return {"system": LAG, "dataset": dataset, "inputs": {"u": "u"}, "outputs": {"y": "y"}} | more


TRUE = {"parameters": {"k": 3, "tau": 0.05}, "offsets": "estimate"}


def answered(client: httpx.Client, body: dict[str, Any]) -> dict[str, Any]:
    reply = client.post("/v1/validations", json=body)
    assert reply.status_code == 200, reply.text
    ValidationReply.model_validate(reply.json())
    found: dict[str, Any] = reply.json()
    return found


def test_every_measure_has_a_name_a_definition_and_company(client, recording) -> None:
    found = answered(client, asked(recording, **TRUE))
    y = found["outputs"]["y"]
    assert set(found["definitions"]) == {"fit_percent", "relative_error_percent", "vaf_percent", "nrmse_percent"}
    assert found["basis"] == "simulation"
    assert {name: m["verdict"] for name, m in y["measures"].items()} == dict.fromkeys(found["definitions"], "ok")
    assert set(y["baselines"]) == {"mean", "input", "static_gain"}
    # 1 mm of white noise beside about 1.7 m rms: 0.06 %, below the 1 % of the best
    assert (found["verdict"], found["grade"], found["diagnosis"]) == ("pass", "best", None)
    residuals = y["residuals"]
    assert residuals["white"]
    assert residuals["independent"]
    assert len(residuals["lags"]) == len(residuals["cross_correlation"][0]) == 51
    assert residuals["lags"][0] == -0.025
    assert residuals["autocorrelation_bound"] == pytest.approx(2.576 / np.sqrt(SAMPLES))
    response = y["frequency_domain"]
    assert response["input"] == "u"
    assert len(response["frequency"]) == len(response["bounds"]["magnitude_lower"]) == response["lines"]
    assert response["relative_error_percent"] < 5
    # the last sample repeated looks excellent, and says nothing
    assert y["one_step_prediction"]["last_sample"]["fit_percent"] > 90


def test_two_inputs_are_compared_each_without_the_other(client) -> None:
    """y = u + 0.5 w, both noises: the model has 0.4 of w."""
    rng = np.random.default_rng(3)
    u, w = rng.normal(size=(2, 4096))
    dataset = made(client, {"u": u, "w": w, "y": 1000 * (u + 0.5 * w + 0.01 * rng.normal(size=4096))}, w={"unit": "V"})
    two = {
        "name": "two",
        "blocks": {"u": {"kind": "input"}, "w": {"kind": "input"}, "k": {"kind": "gain", "gain": 0.4},
                   "s": {"kind": "sum", "signs": "++"}},
        "connections": [{"from": "u", "to": "s.in1"}, {"from": "w", "to": "k"}, {"from": "k", "to": "s.in2"}],
        "outputs": {"y": "s"},
    }  # fmt: skip
    y = answered(client, asked(dataset, system=two, inputs={"u": "u", "w": "w"}, offsets="none"))["outputs"]["y"]
    assert y["frequency_domain"] is None
    assert set(y["frequency_by_input"]) == {"u", "w"}
    # 0.4 for 0.5 is 1.94 dB too little, and of u nothing is
    assert y["frequency_by_input"]["w"]["median_deviation"] == pytest.approx(1.94, abs=0.1)
    assert y["frequency_by_input"]["u"]["median_deviation"] < 0.1


def test_adjusted_parameters_stand_beside_theoretical_ones(client, recording) -> None:
    table = answered(client, asked(recording, **TRUE))["adjustment"]
    rows = {row["parameter"]: row for row in table["parameters"]}
    assert (rows["k"]["theoretical"], rows["k"]["adjusted"], rows["k"]["change_percent"]) == (1, 3, pytest.approx(200))
    assert (rows["tau"]["theoretical"], rows["tau"]["unit"]) == (0.2, "s")
    fits = table["outputs"]["y"]
    assert fits["theoretical"]["fit_percent"] < 40
    assert fits["adjusted"]["fit_percent"] > 99
    assert answered(client, asked(recording))["adjustment"] is None


def test_a_failed_model_is_told_what_would_have_to_move(client, recording) -> None:
    # the gain is right, the lag four times too slow
    found = answered(client, asked(recording, parameters={"k": 3}, offsets="estimate"))
    assert (found["verdict"], found["grade"]) == ("fail", "fail")
    diagnosis = found["diagnosis"]
    first = diagnosis["parameters"][0]
    assert first["parameter"] == "tau"
    assert 0.02 < first["suggested"] < 0.15
    # the straight line promises something; the simulation says what is true
    present = found["outputs"]["y"]["relative_error_percent"]
    assert first["checked_percent"] < 0.6 * present
    assert diagnosis["together"]["checked_percent"] < present
    assert "tau" in found["advice"]
    assert answered(client, asked(recording, diagnose="never"))["diagnosis"] is None
    always = answered(client, asked(recording, diagnose="always", movable=["tau"], **TRUE))
    assert [step["parameter"] for step in always["diagnosis"]["parameters"]] == ["tau"]


def test_the_steps_of_a_nonlinear_model_are_tried_as_well(client) -> None:
    """A limit that is too low; the measurement is the input clipped by hand."""
    u = 2 * np.sin(2 * np.pi * 8 * np.arange(200) / 1000)
    dataset = made(client, {"u": u, "y": 1000 * np.clip(u, -1.5, 1.5)})
    limited = {
        "name": "limited",
        "parameters": {"limit": {"value": 1.2, "lower": 0.1, "upper": 10}},
        "blocks": {"u": {"kind": "input"}, "valve": {"kind": "saturation", "upper": "=limit", "lower": "=-limit"}},
        "connections": [{"from": "u", "to": "valve"}],
        "outputs": {"y": "valve"},
    }
    found = answered(client, asked(dataset, system=limited, limit_percent=1, offsets="none"))
    assert found["verdict"] == "fail"
    step = found["diagnosis"]["parameters"][0]
    assert (step["parameter"], found["diagnosis"]["note"]) == ("limit", "")
    assert step["checked_percent"] < 0.3 * found["outputs"]["y"]["relative_error_percent"]
    assert step["suggested"] == pytest.approx(1.5, abs=0.1)
    assert found["diagnosis"]["together"]["checked_percent"] is not None


def test_a_wrong_unit_is_recognised_by_its_factor(client) -> None:
    raw = np.frombuffer(lag_recording(offset=0.0)).reshape(-1, 2)
    dataset = made(client, {"u": raw[:, 0], "y": raw[:, 1]}, y={"unit": "m"})
    found = answered(client, asked(dataset, parameters={"k": 3, "tau": 0.05}))
    remedy = found["diagnosis"]["remedies"]["y"][0]
    assert remedy["kind"] == "gain"
    assert remedy["values"]["gain"] == pytest.approx(1000, rel=1e-3)
    assert "milli" in found["advice"]


def test_curves_are_thinned_out_on_demand(client, recording) -> None:
    curves = answered(client, asked(recording, points=100, **TRUE))["outputs"]["y"]["curves"]
    assert {len(curve) for curve in curves.values()} == {100}
    assert curves["time"][:2] == [0.0, 0.03]


def test_a_constant_channel_has_a_verdict_instead_of_a_fit(client) -> None:
    dataset = made(client, {"u": np.ones(200), "y": np.full(200, 3000.0)})
    found = answered(client, asked(dataset, parameters={"k": 3}))
    y = found["outputs"]["y"]
    assert y["fit_percent"] is None
    assert y["measures"]["fit_percent"]["verdict"] == "not_applicable"
    assert "constant" in y["measures"]["fit_percent"]["advice"]
    # k u = 3: the model is right, and nothing of its dynamics was seen
    assert found["verdict"] == "pass"
    assert any("shows nothing of the dynamics" in remark for remark in found["remarks"])
    silent = answered(client, asked(made(client, {"u": np.ones(200), "y": np.zeros(200)})))
    assert silent["verdict"] == "fail"
    assert silent["outputs"]["y"]["measures"]["relative_error_percent"]["verdict"] == "not_applicable"


def test_a_model_no_better_than_a_trivial_one_is_told_so(client) -> None:
    slow = np.sin(2 * np.pi * 0.2 * np.arange(5000) / 1000)
    dataset = made(client, {"u": slow, "y": 1000 * slow})
    found = answered(client, asked(dataset, parameters={"k": 1, "tau": 0.001}))
    assert found["verdict"] == "pass"
    assert any("does as well" in remark for remark in found["remarks"])


def test_a_worker_validates_too(client, sqlite_worker, recording) -> None:
    body = asked(recording, **TRUE) | {"queue": {"priority": "high"}}
    accepted = client.post("/v1/validations", json=body, headers={"Prefer": "respond-async"})
    assert accepted.status_code == 202, accepted.text
    assert accepted.headers["Preference-Applied"] == "respond-async"
    job = accepted.json()
    assert (job["kind"], accepted.headers["Location"]) == ("validation", f"/v1/jobs/{job['id']}")
    assert job["priority"] == "high"
    done = finished(client, job)
    assert done["status"] == "succeeded", done
    result = client.get(done["result"]).json()
    at_once = answered(client, asked(recording, **TRUE))
    assert result["outputs"] == at_once["outputs"]
    assert result["verdict"] == "pass"


def test_an_identification_hands_its_parameters_on(client, sqlite_worker, recording) -> None:
    body = asked(recording, parameters=["k", "tau"], offsets="estimate")
    done = finished(client, client.post("/v1/identifications", json=body).json())
    identified = client.get(done["result"]).json()
    found = answered(client, asked(recording, identification=done["id"]))
    assert found["identification"] == done["id"]
    rows = {row["parameter"]: row for row in found["adjustment"]["parameters"]}
    for name in ("k", "tau"):
        estimate = identified["parameters"][name]
        assert rows[name]["adjusted"] == estimate["value"]
        assert (rows[name]["lower95"], rows[name]["upper95"]) == (estimate["lower95"], estimate["upper95"])
        assert rows[name]["theory_within"] is False
    assert found["outputs"]["y"]["offset"] == identified["offsets"]["y"]
    assert found["grade"] == "best"
    # what is given here wins
    mixed = answered(client, asked(recording, identification=done["id"], parameters={"k": 2}))
    assert next(r for r in mixed["adjustment"]["parameters"] if r["parameter"] == "k")["adjusted"] == 2
    other = copy.deepcopy(LAG)
    other["parameters"] = {"gain": {"value": 1}}
    other["blocks"]["plant"] = {"kind": "transfer_function", "numerator": ["=gain"], "denominator": [0.2, 1]}
    refused = client.post("/v1/validations", json=asked(recording, identification=done["id"]) | {"system": other})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/identification"


POSITION: dict[str, Any] = {
    "name": "mass",
    "parameters": {},
    "blocks": {
        "u": {"kind": "input"},
        "body": {"kind": "mass_spring_damper", "mass": 1, "stiffness": 1000, "damping": 10},
    },
    "connections": [{"from": "u", "to": "body.force"}],
    "outputs": {"position": "body.position"},
}
UNSTABLE = copy.deepcopy(LAG) | {"parameters": {}}
UNSTABLE["blocks"]["plant"] = {"kind": "transfer_function", "numerator": [1], "denominator": [0.001, -1]}

WRONG = {
    "a window outside": ({"window": [100, 200]}, "/window/0", "must begin within the recording of 2.999 s, got 100"),
    "a window without two samples": ({"window": [1.0, 1.0001]}, "/window", "at least 2 samples"),
    "a system that diverges": ({"system": UNSTABLE}, "/system", "grows beyond any number"),
    "a channel of another quantity": (
        {"system": POSITION, "outputs": {"position": "u"}}, "/outputs/position", "in a unit of m, got kg*m**2/s**3/A",
    ),
    "a job that is not there": ({"identification": "job_none"}, "/identification", "must be a job that exists"),
    "a parameter that is not there": ({"movable": ["ghost"]}, "/movable/0", "one of the system's"),
    "too few points": ({"points": 1}, "/points", "must be >= 2"),
    "a word that is none": ({"diagnose": "sometimes"}, "/diagnose", "diagnose"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_bad_input_is_refused_with_its_place(client, recording, case) -> None:
    fields, pointer, words = WRONG[case]
    reply = client.post("/v1/validations", json=asked(recording) | fields)
    assert reply.status_code == 422, reply.text
    problem = reply.json()
    assert [error["pointer"] for error in problem["errors"]] == [pointer]
    assert words in problem["errors"][0]["detail"]


def test_a_deleted_dataset_is_no_dataset(client) -> None:
    dataset = made(client, {"u": np.ones(50), "y": np.ones(50)})
    assert client.delete(f"/v1/datasets/{dataset}", headers={"If-Match": "*"}).status_code == 204
    reply = client.post("/v1/validations", json=asked(dataset))
    assert reply.status_code == 422
    assert reply.json()["errors"] == [
        {"pointer": "/dataset", "detail": f"dataset must be one that exists, got {dataset!r}"}
    ]


def test_a_theory_that_diverges_has_no_fit_beside_the_adjusted_model(client, recording) -> None:
    model = copy.deepcopy(LAG)
    model["parameters"] = {"k": {"value": 3}, "damping": {"value": -1}}
    model["blocks"]["plant"] = {"kind": "transfer_function", "numerator": ["=k"], "denominator": [0.005, "=damping"]}
    found = answered(client, asked(recording, system=model, parameters={"damping": 1}, offsets="estimate"))
    assert found["adjustment"]["outputs"]["y"]["theoretical"] is None
    assert found["adjustment"]["outputs"]["y"]["adjusted"]["fit_percent"] is not None


def test_what_is_too_long_for_a_request_is_left_to_a_worker(sqlite_template, tmp_path) -> None:
    path = tmp_path / "small.db"
    path.write_bytes(sqlite_template.read_bytes())
    with serving(f"sqlite:///{path}", max_numbers=1000) as small, small.client() as client:
        dataset = upload(client, RAW, lag_recording(samples=2500)).json()["id"]
        refused = client.post("/v1/validations", json=asked(dataset))
        assert refused.status_code == 422
        assert refused.json()["errors"][0]["pointer"] == "/dataset"
        assert "at most 4000 samples x channels" in refused.json()["detail"]
        later = client.post("/v1/validations", json=asked(dataset), headers={"Prefer": "respond-async"})
        assert later.status_code == 202
        # what is wrong beside the recording is told at once
        wrong = client.post(
            "/v1/validations", json=asked(dataset, movable=["ghost"]), headers={"Prefer": "respond-async"}
        )
        assert wrong.status_code == 422
        short = upload(client, RAW, lag_recording(samples=500)).json()["id"]
        many = client.post("/v1/validations", json=asked(short))
        assert many.json()["errors"][0]["pointer"] == "/points"
        assert client.post("/v1/validations", json=asked(short, points=100)).status_code == 200


def test_a_model_does_not_run_across_the_joint_of_two_experiments(client) -> None:
    first = upload(client, RAW, lag_recording(samples=1000)).json()["id"]
    second = upload(client, RAW, lag_recording(samples=1500)).json()["id"]
    merged = client.post(
        "/v1/processings", json={"name": "both", "sources": [first, second], "combine": "append", "steps": []}
    )
    assert merged.status_code == 201, merged.text
    dataset = merged.json()["id"]
    refused = client.post("/v1/validations", json=asked(dataset, **TRUE))
    assert refused.json()["errors"][0]["pointer"] == "/window"
    assert "one of the 2 experiments, which are joined at 1 s" in refused.json()["detail"]
    # each begins at rest: from the joint on, the answer is that of the second recording alone
    behind = answered(client, asked(dataset, window=[1.0, 2.499], **TRUE))["outputs"]["y"]
    alone = answered(client, asked(second, **TRUE))["outputs"]["y"]
    assert behind["fit_percent"] == pytest.approx(alone["fit_percent"], abs=1e-9)
    assert behind["curves"]["time"][0] == 1.0


def test_a_held_input_is_found_out_and_told(client) -> None:
    """A lag of 3 and 8 ms at 1 kHz behind a D/A converter: its answer by its own recursion."""
    rng = np.random.default_rng(9)
    u = rng.normal(size=2000)
    u[0] = 0.0
    p, y = np.exp(-1 / 8), np.zeros(2000)
    for k in range(1, 2000):
        y[k] = p * y[k - 1] + 3000 * (1 - p) * u[k - 1]
    dataset = made(client, {"u": u, "y": y + rng.normal(size=2000)})
    body = asked(dataset, parameters={"k": 3, "tau": 0.008})
    found = answered(client, body)
    assert found["between_samples"]["chosen"] == "hold"
    fits = {way: one["y"]["fit_percent"] for way, one in found["between_samples"]["tried"].items()}
    assert set(fits) == {"hold", "linear", "band_limited"}
    assert fits["hold"] == found["outputs"]["y"]["fit_percent"] > 99.5
    assert max(fits["linear"], fits["band_limited"]) < 80
    said = answered(client, {**body, "inputs": {"u": {"channel": "u", "between_samples": "linear"}}})
    assert said["between_samples"] is None
    assert said["outputs"]["y"]["fit_percent"] == pytest.approx(fits["linear"])


def test_an_input_does_one_of_the_known_things_between_its_samples(client, recording) -> None:
    wrong = asked(recording) | {"inputs": {"u": {"channel": "u", "between_samples": "cubic"}}}
    reply = client.post("/v1/validations", json=wrong)
    assert reply.status_code == 422
    (error,) = reply.json()["errors"]
    assert error["pointer"] == "/inputs/u/between_samples"
    assert "'auto', 'hold', 'linear' or 'band_limited'" in error["detail"]
