"""Numbers that metrics take, over HTTP: bands of settling and recovery, in the three places that measure them."""

from __future__ import annotations

import math

import pytest

from tests.integration.api.documents import LAG

LOOP = {
    "blocks": {
        "load": {"kind": "input", "role": "disturbance"},
        "c": {"kind": "pi", "kp": 2.0, "ki": 1.0},
        "minus": {"kind": "gain", "gain": -1.0},
        "torque": {"kind": "sum", "signs": "+-"},
        "inertia": {"kind": "integrator"},
    },
    "connections": [
        {"from": "inertia", "to": "minus"},
        {"from": "minus", "to": "c"},
        {"from": "c", "to": "torque.in1"},
        {"from": "load", "to": "torque.in2"},
        {"from": "torque", "to": "inertia"},
    ],
    "outputs": {"speed": "inertia"},
}
STEP = {"port": "load", "signal": {"kind": "step"}}


def test_a_simulation_takes_both_bands(client) -> None:
    body = {"system": LOOP, "input": STEP, "metrics": ["recovery_time"], "recovery_band": {"value": 5, "unit": "%"}}
    reply = client.post("/v1/simulations", json=body)
    assert reply.status_code == 200, reply.text
    found = reply.json()["variants"][0]["metrics"]["speed"]["recovery_time"]
    t = found["value"]  # y = -t e^-t
    assert t * math.exp(-t) == pytest.approx(0.05, rel=1e-9)
    assert t > 1
    settled = {"system": LAG, "input": {"port": "u", "signal": {"kind": "step"}}, "metrics": ["settling_time"]}
    times = [
        client.post("/v1/simulations", json=settled | bands).json()["variants"][0]["metrics"]["y"]["settling_time"][
            "value"
        ]
        for bands in ({}, {"settling_band": 0.1}, {"settling_band": {"value": 10, "unit": "%"}})
    ]
    assert times[1] == times[2]
    assert times[0] / times[1] == pytest.approx(math.log(50) / math.log(10), rel=1e-9)


def test_without_its_band_a_recovery_time_is_not_applicable_and_not_shown_by_itself(client) -> None:
    body = {"system": LOOP, "input": STEP}
    asked = client.post("/v1/simulations", json=body | {"metrics": ["recovery_time"]}).json()["variants"][0]
    found = asked["metrics"]["speed"]["recovery_time"]
    assert (found["value"], found["verdict"]) == (None, "not_applicable")
    assert "recovery_band" in found["advice"]
    by_default = client.post("/v1/simulations", json=body).json()["variants"][0]["metrics"]["speed"]
    assert "recovery_time" not in by_default
    given = client.post("/v1/simulations", json=body | {"recovery_band": 0.05}).json()["variants"][0]["metrics"][
        "speed"
    ]
    assert given["recovery_time"]["verdict"] == "ok"


def test_an_influence_study_takes_them(client) -> None:
    body = {
        "system": LOOP, "input": "load", "output": "speed", "parameters": ["c.kp", "c.ki"],
        "metrics": ["recovery_time", "spectral_abscissa"], "recovery_band": 0.05,
    }  # fmt: skip
    found = client.post("/v1/influence", json=body).json()
    assert found["base"]["recovery_time"]["verdict"] == "ok"
    assert found["elasticities"]["recovery_time"]["c.kp"]["value"] != 0


@pytest.mark.parametrize(
    ("fields", "pointer"),
    [
        ({"recovery_band": -1.0}, "/recovery_band"),
        ({"settling_band": 1.5}, "/settling_band"),
        ({"settling_band": {"value": 3, "unit": "mm"}}, "/settling_band"),
    ],
)
def test_a_band_out_of_range_is_refused_at_its_place(client, fields, pointer) -> None:
    reply = client.post("/v1/simulations", json={"system": LOOP, "input": STEP} | fields)
    assert reply.status_code == 422
    assert reply.json()["errors"][0]["pointer"] == pointer


def test_a_goal_takes_its_band_in_the_unit_of_the_output_and_is_refused_without(client) -> None:
    goal = {"metric": "recovery_time", "experiment": "load", "output": "speed", "upper": 4.0, "sense": "minimize"}
    body = {
        "system": LOOP, "variables": [{"parameter": "c.kp", "lower": 1, "upper": 5}],
        "experiments": [{"name": "load", "input": STEP}], "goals": [goal], "method": {"kind": "gradient", "starts": 1},
    }  # fmt: skip
    refused = client.post("/v1/optimizations", json=body)
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/goals/0/recovery_band"
    taken = client.post("/v1/optimizations", json=body | {"goals": [goal | {"recovery_band": 0.05}]})
    assert taken.status_code == 202, taken.text


def test_a_frequency_response_takes_the_density_of_a_noise(client) -> None:
    path = {"system": LAG, "from": "u", "to": "y"}
    norm = client.post("/v1/frequency-responses", json=path | {"metrics": ["h2_norm"]}).json()
    h2 = norm["variants"][0]["metrics"]["h2_norm"]
    assert h2["unit"].endswith("/s**0.5")
    for density in (4e-6, {"value": 4e-6, "unit": "V**2/Hz"}):
        reply = client.post("/v1/frequency-responses", json=path | {"noise_density": density})
        assert reply.status_code == 200, reply.text
        found = reply.json()["variants"][0]["metrics"]["noise_rms"]
        assert found["value"] == pytest.approx(math.sqrt(2e-6) * h2["value"], rel=1e-12)
    refused = client.post("/v1/frequency-responses", json=path | {"noise_density": 0})
    assert refused.json()["errors"][0]["pointer"] == "/noise_density"
