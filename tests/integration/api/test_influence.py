"""/v1/influence: exact elasticities, coefficients of eq. (4), and what is refused."""

from __future__ import annotations

import math

import pytest

from api.schemas.replies import InfluenceReply
from tests.integration.api.documents import PNEUMATIC

BODY = {
    "system": PNEUMATIC,
    "input": "reference",
    "output": "position",
    "open_at": "error",
    "parameters": ["kp", "controller.ki", "controller.kd", "m"],
    "metrics": ["rise_time", "gain_margin", "bandwidth", "critical_frequency"],
}


def influence(client, **fields):
    return client.post("/v1/influence", json=BODY | fields)


def test_elasticities_are_those_of_the_reference(client) -> None:
    reply = influence(client)
    assert reply.status_code == 200, reply.text
    body = reply.json()
    InfluenceReply.model_validate(body)
    row = body["elasticities"]["rise_time"]
    # 40-digit reference of the pneumatic loop: -0.2384, -0.0985, 0.0120
    assert round(row["kp"]["value"], 4) == -0.2384
    assert round(row["controller.ki"]["value"], 4) == -0.0985
    assert round(row["controller.kd"]["value"], 4) == 0.0120
    assert set(body["elasticities"]) == set(BODY["metrics"])
    assert body["strongest"]["by_metric"]["rise_time"] in BODY["parameters"]
    assert body["strongest"]["by_parameter"]["kp"] in BODY["metrics"]


def test_coefficients_are_eq_4_of_their_own_numbers(client) -> None:
    body = influence(client, change=0.4).json()
    cell = body["coefficients"]["rise_time"]["kp"]
    assert cell["change"] == 0.4
    assert cell["initial"] == body["base"]["rise_time"]["value"]
    # C = ((PCD_i - PCD_f) / PCD_i) / ((PCF_i - PCF_f) / PCF_i), signed
    expected = ((cell["initial"] - cell["final"]) / cell["initial"]) / -0.4
    assert cell["value"] == pytest.approx(expected, rel=1e-12)


def test_a_small_change_gives_the_elasticity(client) -> None:
    body = influence(client, change=1e-6).json()
    for metric, row in body["coefficients"].items():
        for parameter, cell in row.items():
            elasticity = body["elasticities"][metric][parameter]["value"]
            assert cell["value"] == pytest.approx(elasticity, abs=1e-4), (metric, parameter)


WRONG = {
    "unknown input": ({"input": "ghost"}, "/input"),
    "unknown output": ({"output": "ghost"}, "/output"),
    "unknown from": ({"from": "ghost"}, "/from"),
    "unknown to": ({"to": "ghost"}, "/to"),
    "unknown loop": ({"open_at": "ghost"}, "/open_at"),
    "unknown parameter": ({"parameters": ["kp", "ghost"]}, "/parameters/1"),
    "bound parameter": ({"parameters": ["motor.mass"]}, "/parameters/0"),
    "no parameters": ({"parameters": []}, "/parameters"),
    "unknown metric": ({"metrics": ["beauty"]}, "/metrics/0"),
    "no metrics": ({"metrics": []}, "/metrics"),
    "no change": ({"change": 0}, "/change"),
    "change of -100 %": ({"change": -1}, "/change"),
    "wrong signal": ({"signal": {"kind": "step", "amplitude": "big"}}, "/signal/amplitude"),
    "wrong duration": ({"duration": -1}, "/duration"),
    "unknown field": ({"samples": 5}, "/samples"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_influence_study_is_refused_at_its_place(client, case) -> None:
    fields, pointer = WRONG[case]
    reply = influence(client, **fields)
    assert reply.status_code == 422, reply.text
    assert any(entry["pointer"].startswith(pointer) for entry in reply.json()["errors"]), reply.text


def test_a_prediction_stands_beside_the_exact_value_with_its_error(client) -> None:
    kp = influence(client).json()["coefficients"]["rise_time"]["kp"]
    reply = influence(client, predict=[{"kp": {"change": 0.1}}, {"kp": {"change": 0.1}, "controller.ki": 0.0025}])
    assert reply.status_code == 200, reply.text
    body = reply.json()
    InfluenceReply.model_validate(body)
    alone, together = body["predictions"]
    metric = alone["metrics"]["rise_time"]
    assert alone["changes"]["kp"]["final"] == pytest.approx(1.1 * alone["changes"]["kp"]["initial"], rel=1e-12)
    # the change of eq. (4) is 10 % as well
    assert metric["exact"]["value"] == pytest.approx(kp["final"], rel=1e-12)
    elasticity = body["elasticities"]["rise_time"]["kp"]["value"]
    assert metric["law"] == "power"
    assert metric["value"] == pytest.approx(kp["initial"] * 1.1**elasticity, rel=1e-9)
    assert metric["straight"] == pytest.approx(kp["initial"] * (1 + 0.1 * elasticity), rel=1e-9)
    assert metric["error"] == pytest.approx(metric["value"] - metric["exact"]["value"], rel=1e-9)
    assert set(together["changes"]) == {"kp", "controller.ki"}
    assert "predictions" not in influence(client).json()


WRONG_CHANGES = {
    "unknown parameter": ([{"ghost": 1.0}], "/predict/0/ghost"),
    "bound parameter": ([{"kp": 1.0}, {"motor.mass": 1.0}], "/predict/1/motor.mass"),
    "no change": ([{"kp": {"change": 0}}], "/predict/0/kp"),
    "no parameter": ([{}], "/predict/0"),
    "no set of changes": ([], "/predict"),
    "wrong unit": ([{"m": {"value": 1.0, "unit": "V"}}], "/predict/0/m"),
    "wrong kind": ([{"kp": "a lot"}], "/predict/0/kp"),
}


@pytest.mark.parametrize("case", WRONG_CHANGES)
def test_a_wrong_change_is_refused_at_its_place(client, case) -> None:
    changes, pointer = WRONG_CHANGES[case]
    reply = influence(client, predict=changes)
    assert reply.status_code == 422, reply.text
    assert any(entry["pointer"].startswith(pointer) for entry in reply.json()["errors"]), reply.text


GAIN, LAG = 3.0, 0.25
"""K/(T s + 1), closed, rises in T ln 9/(1 + K) and misses 1/(1 + K)."""
FIRST_ORDER = {
    "name": "first-order loop",
    "parameters": {"k": {"value": GAIN}, "lag": {"value": LAG}},
    "blocks": {
        "r": {"kind": "input"},
        "error": {"kind": "sum", "signs": "+-"},
        "law": {"kind": "gain", "gain": "=k"},
        "plant": {"kind": "transfer_function", "numerator": [1], "denominator": ["=lag", 1]},
    },
    "connections": [
        {"from": "r", "to": "error.in1"}, {"from": "plant", "to": "error.in2"},
        {"from": "error", "to": "law"}, {"from": "law", "to": "plant"},
    ],
    "outputs": {"y": "plant"},
}  # fmt: skip
FORMULAS = {
    "system": FIRST_ORDER, "input": "r", "output": "y", "parameters": ["k", "lag"], "change": 0.4,
    "metrics": ["rise_time", "steady_state_error", "bandwidth"], "from": "r", "to": "y",
    "predict": [{"k": {"change": 0.4}}, {"k": 1.5, "lag": 0.5}],
}  # fmt: skip


def of_the_loop(k: float, lag: float) -> dict[str, float]:
    # the bandwidth is where |T| has fallen by 3 dB exactly, not by sqrt(2)
    return {
        "rise_time": lag * math.log(9) / (1 + k),
        "steady_state_error": 1 / (1 + k),
        "bandwidth": (1 + k) / lag * math.sqrt(10**0.3 - 1),
    }


def test_elasticities_coefficients_and_predictions_are_the_formulas(client) -> None:
    body = client.post("/v1/influence", json=FORMULAS).json()
    share = GAIN / (1 + GAIN)  # d ln(1 + K) / d ln K
    elasticities = {
        "rise_time": {"k": -share, "lag": 1.0},
        "steady_state_error": {"k": -share, "lag": 0.0},
        "bandwidth": {"k": share, "lag": -1.0},
    }
    base = of_the_loop(GAIN, LAG)
    changed = {"k": of_the_loop(1.4 * GAIN, LAG), "lag": of_the_loop(GAIN, 1.4 * LAG)}
    for name, row in elasticities.items():
        assert body["base"][name]["value"] == pytest.approx(base[name], rel=1e-9)
        for parameter, expected in row.items():
            assert body["elasticities"][name][parameter]["value"] == pytest.approx(expected, abs=1e-9)
            # C = ((PCD_i - PCD_f) / PCD_i) / ((PCF_i - PCF_f) / PCF_i)
            finite = (1 - changed[parameter][name] / base[name]) / -0.4
            assert body["coefficients"][name][parameter]["value"] == pytest.approx(finite, abs=1e-8)
    for told, (k, lag) in zip(body["predictions"], [(1.4 * GAIN, LAG), (1.5, 0.5)], strict=True):
        truth = of_the_loop(k, lag)
        for name, row in elasticities.items():
            power = base[name] * (k / GAIN) ** row["k"] * (lag / LAG) ** row["lag"]
            found = told["metrics"][name]
            assert found["exact"]["value"] == pytest.approx(truth[name], rel=1e-9)
            assert found["value"] == pytest.approx(power, rel=1e-8)
            assert found["error"] == pytest.approx(power - truth[name], rel=1e-6, abs=1e-9 * truth[name])
