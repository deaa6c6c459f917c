"""Limits of controllers and the further commands, as a script sends them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

#: The integral part alone drives the output; beyond the limit it winds up unless something stops it.
LOOP: dict[str, Any] = {
    "name": "limited loop",
    "parameters": {"Kp": 2, "umax": 1.5},
    "blocks": {
        "r": {"kind": "input"},
        "e": {"kind": "sum", "signs": "+-"},
        "law": {"kind": "pi", "kp": "=Kp", "ki": 3, "limits": {"lower": -1, "upper": "=umax"}},
        "plant": {"kind": "transfer_function", "numerator": [1], "denominator": [1, 1.2, 0.3]},
    },
    "connections": [
        {"from": "r", "to": "e.in1"},
        {"from": "plant", "to": "e.in2"},
        {"from": "e", "to": "law"},
        {"from": "law", "to": "plant"},
    ],
    "outputs": {"y": "plant", "u": "law"},
}


def loop(**law: Any) -> dict[str, Any]:
    return {**LOOP, "blocks": {**LOOP["blocks"], "law": {**LOOP["blocks"]["law"], **law}}}


def simulated(client: Any, system: dict[str, Any], signal: dict[str, Any], **more: Any) -> dict[str, Any]:
    body = {"system": system, "input": {"port": "r", "signal": signal}, "duration": 8, **more}
    reply = client.post("/v1/simulations", json=body)
    assert reply.status_code == 200, reply.text
    return reply.json()["variants"][0]


def test_limits_are_kept_as_parameters_with_paths(client) -> None:
    document = client.post("/v1/systems", json=loop(anti_windup="clamping")).json()["document"]
    law = document["blocks"]["law"]
    assert (law["lower"], law["upper"], law["anti_windup"], law.get("limits")) == (-1, "=umax", "clamping", None)
    wide = simulated(client, loop(), {"kind": "step", "amplitude": 3}, variants=[{"law.lower": -2, "umax": 2.5}])
    assert max(wide["outputs"]["u"]) == 2.5


@pytest.mark.parametrize(
    "anti_windup", ["clamping", "back_calculation", {"kind": "back_calculation", "tracking_time": 0.5}]
)
def test_anti_windup_overshoots_less(client, anti_windup) -> None:
    pulse = {"kind": "pulse", "width": 4, "amplitude": 3}
    kept = simulated(client, loop(anti_windup=anti_windup), pulse)
    wound = simulated(client, loop(), pulse)
    for found in (kept, wound):
        assert max(found["outputs"]["u"]) == 1.5
        assert min(found["outputs"]["u"]) >= -1
    assert kept["metrics"]["y"]["iae"]["value"] < 0.8 * wound["metrics"]["y"]["iae"]["value"]


@pytest.mark.parametrize(
    "signal",
    [
        {"kind": "square", "period": {"value": 500, "unit": "ms"}, "amplitude": 0.1},
        {"kind": "noise", "band": [{"value": 0.1, "unit": "Hz"}, 20], "rms": 0.1, "seed": 7},
        {"kind": "piecewise_linear", "time": [0, 1, 1, 2], "values": [0, 1, 0, 0.5]},
    ],
)
def test_further_commands_come_in_by_their_units(client, signal) -> None:
    found = simulated(client, loop(), signal)
    assert found["verdict"] == "ok"
    assert np.ptp(found["outputs"]["y"]) > 0


def test_a_filter_that_is_not_given_is_told(client) -> None:
    law = {"kind": "pid", "kp": 2, "kd": 0.1}
    system = {**LOOP, "blocks": {**LOOP["blocks"], "law": law}}
    body = {"system": system, "from": "r", "to": "y", "frequencies": [0, 1]}
    warnings = client.post("/v1/frequency-responses", json=body).json()["warnings"]
    assert {
        "pointer": "/system/blocks/law/filter_frequency",
        "detail": "filter_frequency of law is taken to be 100 rad/s, since it is not given: a derivative needs a filter",
    } in warnings


def test_an_impulse_that_goes_straight_to_an_output_is_refused(client) -> None:
    linear = {**LOOP, "blocks": {**LOOP["blocks"], "law": {"kind": "p", "kp": 2}}}
    body = {"system": linear, "input": {"port": "r", "signal": {"kind": "impulse"}}}
    refused = client.post("/v1/simulations", json=body)
    assert refused.status_code == 422
    assert "an impulse at r must not go straight to u" in refused.json()["detail"]
    assert client.post("/v1/simulations", json=body | {"outputs": ["y"]}).status_code == 200
