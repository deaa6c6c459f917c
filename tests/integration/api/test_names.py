"""Names as engineers write them, J, R_a, Kp: from the document through every answer to the files that go out."""

from __future__ import annotations

import io

import numpy as np
from scipy.io import loadmat

#: Kp/(J s + R_a): rests at Kp/R_a after a step, with the time constant J/R_a.
AXIS = {
    "name": "axis",
    "parameters": {"Kp": 6, "J": {"value": 0.5, "unit": "kg*m**2"}, "R_a": 2.0, "w0": 100, "T": "=1/w0"},
    "blocks": {
        "U": {"kind": "input"},
        "Plant": {"kind": "transfer_function", "numerator": ["=Kp"], "denominator": ["=J", "=R_a"]},
        "Filter": {"kind": "transfer_function", "numerator": [1], "denominator": ["=T", 1]},
    },
    "connections": [{"from": "U", "to": "Plant"}, {"from": "Plant", "to": "Filter"}],
    "outputs": {"Speed": "Plant", "measured": "Filter.out"},
}
INPUT = {"port": "U", "signal": {"kind": "step"}}


def test_a_document_keeps_its_names(client) -> None:
    created = client.post("/v1/systems", json=AXIS)
    assert created.status_code == 201, created.text
    document = created.json()["document"]
    assert document["parameters"]["Kp"] == {"value": 6}
    assert document["parameters"]["T"] == {"value": "=1/w0"}
    assert [*document["blocks"], *document["outputs"]] == ["U", "Plant", "Filter", "Speed", "measured"]
    matrices = client.get(f"/v1/systems/{created.json()['id']}/state-space", params={"format": "mat"})
    found = loadmat(io.BytesIO(matrices.content))
    assert [cell[0] for cell in found["outputs"].ravel()] == ["Speed", "measured"]
    assert found["states"].ravel()[0][0] == "Plant.x1"


def test_a_variant_is_a_bare_number(client) -> None:
    """Kp/R_a = 3, 6 and 1.5 at rest; the reading 5 % below is at 3 J/R_a."""
    body = {
        "system": AXIS,
        "input": INPUT,
        "outputs": ["Speed"],
        "metrics": ["response_time", "steady_state_error"],
        "variants": [{}, {"Kp": 12}, {"R_a": 4, "w0": 50}],
    }
    variants = client.post("/v1/simulations", json=body).json()["variants"]
    assert [variant["parameters"] for variant in variants] == [{}, {"Kp": 12}, {"R_a": 4, "w0": 50}]
    found = [variant["metrics"]["Speed"]["response_time"]["value"] for variant in variants]
    np.testing.assert_allclose(found, np.log(20) * np.array([0.25, 0.25, 0.125]), rtol=1e-12)
    errors = [variant["metrics"]["Speed"]["steady_state_error"]["value"] for variant in variants]
    np.testing.assert_allclose(errors, [1 - 3.0, 1 - 6.0, 1 - 1.5], rtol=1e-12)


def test_elasticities_go_by_the_same_names(client) -> None:
    """t = ln 20 J/R_a: its elasticities are 1 and -1."""
    body = {
        "system": AXIS, "input": "U", "output": "Speed", "parameters": ["J", "R_a"], "metrics": ["response_time"]
    }  # fmt: skip
    found = client.post("/v1/influence", json=body).json()["elasticities"]["response_time"]
    np.testing.assert_allclose([found["J"]["value"], found["R_a"]["value"]], [1, -1], rtol=1e-12)


def test_names_that_differ_in_case_only_are_refused_with_both(client) -> None:
    wrong = AXIS | {"parameters": {**AXIS["parameters"], "kp": 1}}
    reply = client.post("/v1/systems", json=wrong)
    assert reply.status_code == 422
    assert reply.json()["errors"] == [
        {"pointer": "/parameters/kp", "detail": "names must differ in more than case, got 'Kp' and 'kp'"}
    ]


def test_case_counts(client) -> None:
    body = {"system": AXIS, "input": INPUT, "variants": [{"j": 1}]}
    reply = client.post("/v1/simulations", json=body)
    assert reply.status_code == 422
    assert "'j'" in reply.json()["detail"]


def test_an_unknown_parameter_is_told_with_near_ones(client) -> None:
    body = {"system": AXIS, "input": INPUT, "variants": [{"kp": 1}]}
    told = client.post("/v1/simulations", json=body).json()
    assert told["errors"] == [
        {"pointer": "/variants/0/kp", "detail": "parameter must be one of the system's (near: Kp), got 'kp'"}
    ]
