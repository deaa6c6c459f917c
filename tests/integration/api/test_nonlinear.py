"""Nonlinear systems over HTTP: the same calls, shapes and verdicts as linear ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from api.schemas.replies import FrequencyReply, SimulationReply

SATURATED = {
    "name": "integrator behind a saturation",
    "blocks": {
        "r": {"kind": "input"},
        "e": {"kind": "sum", "signs": "+-"},
        "s": {"kind": "saturation", "lower": -1, "upper": 1},
        "x": {"kind": "integrator"},
    },
    "connections": [
        {"from": "r", "to": "e.in1"},
        {"from": "x", "to": "e.in2"},
        {"from": "e", "to": "s"},
        {"from": "s", "to": "x"},
    ],
    "outputs": {"y": "x", "u": "s"},
}
STEP = {"port": "r", "signal": {"kind": "step", "amplitude": 3}}


def test_a_simulation_has_curves_metrics_and_its_error(client) -> None:
    """x' = sat(3 - x): t up to 2, then 3 - e^-(t-2)."""
    reply = client.post("/v1/simulations", json={"system": SATURATED, "input": STEP})
    assert reply.status_code == 200, reply.text
    SimulationReply.model_validate(reply.json())
    (variant,) = reply.json()["variants"]
    assert variant["verdict"] == "ok"
    assert 0 <= variant["error_estimate"] < 1e-9
    t, y = np.array(variant["time"]), np.array(variant["outputs"]["y"])
    np.testing.assert_allclose(y, np.where(t < 2, t, 3 - np.exp(2 - t)), atol=1e-10)
    assert max(variant["outputs"]["u"]) <= 1.0
    rise = variant["metrics"]["y"]["rise_time"]
    assert rise == {"value": pytest.approx(1.7 - math.log(0.3), abs=1e-9), "unit": "s", "verdict": "ok"}


def test_variants_and_a_duration(client) -> None:
    reply = client.post(
        "/v1/simulations",
        json={"system": SATURATED, "input": STEP, "variants": [{"s.upper": 0.5}, {"s.upper": 2}], "duration": 1},
    )
    slow, fast = reply.json()["variants"]
    assert slow["outputs"]["y"][-1] == pytest.approx(0.5, abs=1e-12)
    assert fast["metrics"]["y"]["rise_time"] == {
        "value": None, "unit": "s", "verdict": "too_short",
        "advice": "the simulation ends before the output has settled: give it a longer duration",
    }  # fmt: skip


def test_a_frequency_response_is_linearised_and_says_so(client) -> None:
    reply = client.post(
        "/v1/frequency-responses", json={"system": SATURATED, "from": "r", "to": "y", "frequencies": [1.0]}
    )
    assert reply.status_code == 200, reply.text
    FrequencyReply.model_validate(reply.json())
    assert reply.json()["variants"][0]["magnitude"] == [pytest.approx(1 / math.sqrt(2), rel=1e-12)]
    assert any("linearised" in warning["detail"] for warning in reply.json()["warnings"])


def test_influence_passes_through_the_limit(client) -> None:
    """t_r = 0.9 + ... : rise from 0.3 at 0.3/u to 2.7 at 3 - u e^-(t - t_1), t_1 = (3 - u)/u."""
    reply = client.post(
        "/v1/influence",
        json={"system": SATURATED, "input": STEP["port"], "signal": STEP["signal"], "output": "y",
              "parameters": ["s.upper"], "metrics": ["rise_time"]},
    )  # fmt: skip
    assert reply.status_code == 200, reply.text
    body = reply.json()
    value = 1.7 - math.log(0.3)
    # d/du [(3 - u)/u + ln(u/0.3) - 0.3/u] at u = 1: -3 + 1 + 0.3
    assert body["elasticities"]["rise_time"]["s.upper"]["value"] == pytest.approx(-1.7 / value, rel=1e-8)


def test_an_ill_posed_loop_through_a_law_is_refused_with_its_place(client) -> None:
    broken = {
        "blocks": {"r": {"kind": "input"}, "e": {"kind": "sum", "signs": "++"}, "s": {"kind": "saturation"}},
        "connections": [{"from": "r", "to": "e.in1"}, {"from": "s", "to": "e.in2"}, {"from": "e", "to": "s"}],
        "outputs": {"y": "s"},
    }
    reply = client.post("/v1/simulations", json={"system": broken, "input": {"port": "r", "signal": {"kind": "step"}}})
    assert reply.status_code == 422
    assert "s.out" in reply.text
