"""Several places opened together, over HTTP: the inner loop of a cascade with the outer one open."""

from __future__ import annotations

import control
import numpy as np
import pytest

CASCADE = {
    "blocks": {
        "r": {"kind": "input"},
        "outer": {"kind": "sum", "signs": "+-"},
        "kv": {"kind": "p", "kp": 10.0},
        "inner": {"kind": "sum", "signs": "+-"},
        "speed": {"kind": "pi", "kp": 1.0, "ki": 2.0},
        "drive": {"kind": "transfer_function", "numerator": [20], "denominator": [1e-4, 0.052, 1]},
        "way": {"kind": "integrator"},
    },
    "connections": [
        {"from": a, "to": b}
        for a, b in (
            ("r", "outer.in1"), ("way", "outer.in2"), ("outer", "kv"), ("kv", "inner.in1"), ("drive", "inner.in2"),
            ("inner", "speed"), ("speed", "drive"), ("drive", "way"),
        )
    ],
    "outputs": {"position": "way"},
}  # fmt: skip
W = [0.5, 5.0, 50.0]
S = control.tf("s")
ALONE = (1 + 2 / S) * 20 / (1e-4 * S**2 + 0.052 * S + 1)


def test_a_frequency_response_opens_a_list_of_places(client) -> None:
    body = {"system": CASCADE, "open_at": ["inner", "outer"], "frequencies": W}
    reply = client.post("/v1/frequency-responses", json=body)
    assert reply.status_code == 200, reply.text
    found = reply.json()["variants"][0]
    np.testing.assert_allclose(
        np.array(found["real"]) + 1j * np.array(found["imag"]), ALONE(1j * np.array(W)), rtol=1e-10
    )
    _, phase, *_ = control.margin(ALONE)
    assert found["metrics"]["phase_margin"]["value"] == pytest.approx(np.radians(phase), rel=1e-6)
    one, listed = (
        client.post("/v1/frequency-responses", json=body | {"open_at": place}).json() for place in ("inner", ["inner"])
    )
    assert one == listed


def test_a_place_on_no_loop_is_told(client) -> None:
    found = client.post("/v1/frequency-responses", json={"system": CASCADE, "open_at": "r", "frequencies": W}).json()
    assert "no loop runs through r: its loop gain is 0 at all frequencies, so that margins say nothing" in str(found)
    assert str(found["variants"][0]["metrics"]["complementary_peak"]["value"]) == "0.0"


def test_influence_and_goals_take_a_list(client) -> None:
    body = {
        "system": CASCADE, "input": "r", "output": "position", "open_at": ["inner", "outer"],
        "parameters": ["speed.kp", "kv.kp"], "metrics": ["phase_margin"],
    }  # fmt: skip
    row = client.post("/v1/influence", json=body).json()["elasticities"]["phase_margin"]
    assert row["kv.kp"]["value"] == 0.0
    assert row["speed.kp"]["value"] != 0.0
    goal = {"metric": "phase_margin", "open_at": ["inner", "outer"], "sense": "maximize"}
    search = {
        "system": CASCADE, "variables": [{"parameter": "speed.kp", "lower": 0.1, "upper": 5}], "goals": [goal],
        "method": {"kind": "gradient", "starts": 1},
    }  # fmt: skip
    reply = client.post("/v1/optimizations", json=search)
    assert reply.status_code == 202, reply.text


@pytest.mark.parametrize("places", [["inner", "ghost"], ["inner", "inner.out"], []])
def test_places_that_cannot_be_opened_together_are_refused(client, places) -> None:
    reply = client.post("/v1/frequency-responses", json={"system": CASCADE, "open_at": places})
    assert reply.status_code == 422
    assert reply.json()["errors"][0]["pointer"] == "/open_at"
