"""Nonlinear systems over HTTP: the same calls, shapes and verdicts as linear ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from api.schemas.replies import FrequencyReply, InfluenceReply, SimulationReply

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
    # 2 t up to t = 1/2, then 3 - 2 e^(1/2 - t): 10 and 90 % of the way to the last value, of the error e^-1/2 of which 2 are left
    last = 3 - 2 * math.exp(-0.5)
    assert fast["metrics"]["y"]["rise_time"] == {
        "value": pytest.approx(0.5 + math.log(2 / (3 - 0.9 * last)) - 0.05 * last, abs=1e-9), "unit": "s",
        "verdict": "not_settled", "settled_from": "last_sample", "doubt": None,
    }  # fmt: skip
    error = fast["metrics"]["y"]["steady_state_error"]
    assert error["value"] == pytest.approx(2 * math.exp(-0.5), abs=1e-9)
    assert error["doubt"] == pytest.approx(2 * math.exp(-0.5), abs=1e-9)


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


def test_influence_of_the_command_comes_from_differences_and_says_so(client) -> None:
    """t_r = (A - 1) + ln(10/A) - A/10 of the saturated integrator: dt_r/dA = 9/10 - 1/A."""
    reply = client.post(
        "/v1/influence",
        json={"system": SATURATED, "input": STEP["port"], "signal": STEP["signal"], "output": "y",
              "parameters": ["signals.r.amplitude", "s.upper"], "metrics": ["rise_time"]},
    )  # fmt: skip
    assert reply.status_code == 200, reply.text
    InfluenceReply.model_validate(reply.json())
    row = reply.json()["elasticities"]["rise_time"]
    cell = row["signals.r.amplitude"]
    assert cell["value"] == pytest.approx((0.9 - 1 / 3) * 3 / (1.7 - math.log(0.3)), rel=1e-6)
    assert (cell["method"], cell["one_sided"], cell["verdict"]) == ("differences", False, "ok")
    assert 0 <= cell["error"] < 1e-5
    assert (row["s.upper"]["method"], row["s.upper"]["error"]) == ("exact", None)


WRONG_NUMBERS = {"signals.ghost.amplitude": "port", "signals.r.beauty": "amplitude", "signals.r": "amplitude"}


@pytest.mark.parametrize("path", WRONG_NUMBERS)
def test_a_number_that_the_command_does_not_have_is_refused_at_its_place(client, path) -> None:
    reply = client.post(
        "/v1/influence",
        json={"system": SATURATED, "input": "r", "output": "y", "parameters": [path], "metrics": ["rise_time"]},
    )
    assert reply.status_code == 422, reply.text
    (fault,) = reply.json()["errors"]
    assert fault["pointer"] == "/parameters/0"
    assert WRONG_NUMBERS[path] in fault["detail"]


def test_energy_in_a_band_of_a_simulation(client) -> None:
    """x' = r - x with r = a jump of 1 between the limits: e^-t for the velocity, whose energy up to w is atan(w)/pi."""
    system = SATURATED | {"outputs": {"u": "s"}}
    step = {"port": "r", "signal": {"kind": "step", "amplitude": 1}}
    body = {"system": system, "input": step, "metrics": ["band_energy"], "band": [0, 2.0]}
    reply = client.post("/v1/simulations", json=body)
    assert reply.status_code == 200, reply.text
    energy = reply.json()["variants"][0]["metrics"]["u"]["band_energy"]
    assert energy["verdict"] == "ok", energy
    assert energy["value"] == pytest.approx(math.atan(2.0) / math.pi, rel=1e-6)
    reply = client.post("/v1/simulations", json=body | {"band": [2.0, 1.0]})
    assert (reply.status_code, reply.json()["errors"][0]["pointer"]) == (422, "/band")


def test_a_frequency_response_about_an_operating_point(client) -> None:
    """x = r while |r| < 1, where the slope is 1; beyond, u stays at 1 and x runs on: nothing rests."""
    body = {"system": SATURATED, "from": "r", "to": "y", "frequencies": [1.0]}
    reply = client.post("/v1/frequency-responses", json=body | {"operating_point": {"r": 0.5}})
    assert reply.status_code == 200, reply.text
    FrequencyReply.model_validate(reply.json())
    (variant,) = reply.json()["variants"]
    assert variant["operating_point"] == {
        "inputs": {"r": 0.5}, "outputs": {"y": pytest.approx(0.5), "u": pytest.approx(0.0, abs=1e-12)}, "rests": True,
    }  # fmt: skip
    assert any("inputs r = 0.5" in warning["detail"] for warning in reply.json()["warnings"])
    reply = client.post("/v1/frequency-responses", json=body | {"operating_point": {"ghost": 0.5}})
    assert (reply.status_code, reply.json()["errors"][0]["pointer"]) == (422, "/operating_point/ghost")


def test_a_limit_cycle_is_told_beside_its_prediction(client) -> None:
    """10/(s (s+1) (s+2)) behind a saturation: -180° at sqrt 2, N(A) = 0.6."""
    system = {
        "blocks": {
            "r": {"kind": "input"}, "e": {"kind": "sum", "signs": "+-"}, "s": {"kind": "saturation"},
            "g": {"kind": "transfer_function", "numerator": [10], "denominator": [1, 3, 2, 0]},
        },
        "connections": [
            {"from": "r", "to": "e.in1"}, {"from": "g", "to": "e.in2"}, {"from": "e", "to": "s"}, {"from": "s", "to": "g"},
        ],
        "outputs": {"y": "g"},
    }  # fmt: skip
    step = {"port": "r", "signal": {"kind": "step", "amplitude": 0.1}}
    reply = client.post("/v1/simulations", json={"system": system, "input": step, "duration": 80})
    assert reply.status_code == 200, reply.text
    SimulationReply.model_validate(reply.json())
    cycle = reply.json()["variants"][0]["limit_cycle"]
    (prediction,) = cycle["predictions"]
    assert prediction["block"] == "s"
    assert prediction["stable"] is True
    assert prediction["frequency"] == pytest.approx(math.sqrt(2), rel=1e-8)
    assert cycle["frequency"] == pytest.approx(math.sqrt(2), rel=0.02)
    assert cycle["outputs"]["y"] == pytest.approx(prediction["outputs"]["y"], rel=0.03)
    assert any("limit cycle" in warning["detail"] for warning in reply.json()["warnings"])
    reply = client.post("/v1/frequency-responses", json={"system": system, "open_at": "s"})
    FrequencyReply.model_validate(reply.json())
    assert reply.json()["variants"][0]["limit_cycles"] == [prediction]


def test_an_ill_posed_loop_through_a_law_is_refused_with_its_place(client) -> None:
    broken = {
        "blocks": {"r": {"kind": "input"}, "e": {"kind": "sum", "signs": "++"}, "s": {"kind": "saturation"}},
        "connections": [{"from": "r", "to": "e.in1"}, {"from": "s", "to": "e.in2"}, {"from": "e", "to": "s"}],
        "outputs": {"y": "s"},
    }
    reply = client.post("/v1/simulations", json={"system": broken, "input": {"port": "r", "signal": {"kind": "step"}}})
    assert reply.status_code == 422
    assert "s.out" in reply.text
