"""Several paths in one request, their zeros, and the matrices and poles of a system that is not stored."""

from __future__ import annotations

import io
from typing import Any

import control
import numpy as np
import pytest
from scipy.io import loadmat

import servotune
from api.schemas.replies import FrequencyReply, StateSpaceReply
from tests.integration.api.documents import LAG, PNEUMATIC

LOOP: dict[str, Any] = {
    "blocks": {
        "r": {"kind": "input"},
        "load": {"kind": "input", "role": "disturbance"},
        "e": {"kind": "sum", "signs": "+-"},
        "c": {"kind": "pi", "kp": 2.0, "ki": 6.0},
        "s": {"kind": "sum", "signs": "++"},
        "p": {"kind": "transfer_function", "numerator": [1, 7], "denominator": [1, 2, 5]},
    },
    "connections": [
        {"from": a, "to": b}
        for a, b in (("r", "e.in1"), ("p", "e.in2"), ("e", "c"), ("c", "s.in1"), ("load", "s.in2"), ("s", "p"))
    ],
    "outputs": {"y": "p", "u": "c"},
}
S = control.tf("s")
C, P = 2 + 6 / S, (S + 7) / (S**2 + 2 * S + 5)
W = [0.3, 3.0, 30.0]


def roots(listed: list[dict[str, float]]) -> np.ndarray:
    return np.array([one["real"] + 1j * one["imag"] for one in listed])


def test_several_paths_come_each_with_its_curve_metrics_and_zeros(client) -> None:
    ends = [("r", "y"), ("load", "y"), ("r", "u")]
    body = {"system": LOOP, "paths": [{"from": a, "to": b} for a, b in ends], "frequencies": W}
    reply = client.post("/v1/frequency-responses", json=body)
    assert reply.status_code == 200, reply.text
    FrequencyReply.model_validate(reply.json())
    (found,) = reply.json()["variants"]
    assert [(one["from"], one["to"]) for one in found["paths"]] == ends
    loops = (C * P / (1 + C * P), P / (1 + C * P), C / (1 + C * P))
    zeros = ([-3, -7], [0, -7], [-1 + 2j, -1 - 2j, -3])
    for one, expected, at in zip(found["paths"], loops, zeros, strict=True):
        curve = np.array(one["real"]) + 1j * np.array(one["imag"])
        np.testing.assert_allclose(curve, expected(1j * np.array(W)), rtol=1e-10)
        np.testing.assert_allclose(np.sort_complex(roots(one["zeros"])), np.sort_complex(at), rtol=1e-9, atol=1e-9)
        assert "resonance_peak" in one["metrics"]
        assert "damping_ratio" not in one["metrics"]
    assert found["real"] == found["paths"][0]["real"]
    assert found["metrics"]["bandwidth"] == found["paths"][0]["metrics"]["bandwidth"]
    # the loop beside the paths
    opened = client.post("/v1/frequency-responses", json=body | {"open_at": "e"}).json()["variants"][0]
    np.testing.assert_allclose(opened["real"], (C * P)(1j * np.array(W)).real, rtol=1e-10)
    assert opened["paths"] == found["paths"]


def test_what_is_asked_of_all_paths_is_answered_for_each(client) -> None:
    body = {
        "system": LOOP, "paths": [{"from": "r", "to": "y"}, {"from": "load", "to": "y"}],
        "metrics": ["noise_rms", "damping_ratio"], "noise_density": 2.0,
    }  # fmt: skip
    (found,) = client.post("/v1/frequency-responses", json=body).json()["variants"]
    for one, expected in zip(found["paths"], (C * P / (1 + C * P), P / (1 + C * P)), strict=True):
        reference = float(control.norm(control.ss(control.minreal(expected, verbose=False)), 2))
        assert one["metrics"]["noise_rms"]["value"] == pytest.approx(reference, rel=1e-8)
    assert found["metrics"]["damping_ratio"]["verdict"] == "ok"


@pytest.mark.parametrize(
    ("path", "pointer"),
    [({"from": "ghost", "to": "y"}, "/paths/0/from"), ({"from": "r", "to": "ghost"}, "/paths/0/to")],
)
def test_a_path_that_is_not_there_is_refused_at_its_place(client, path, pointer) -> None:
    reply = client.post("/v1/frequency-responses", json={"system": LOOP, "paths": [path]})
    assert reply.status_code == 422
    assert reply.json()["errors"][0]["pointer"] == pointer


def test_zeros_without_end_are_null(client) -> None:
    comb = {
        "blocks": {"r": {"kind": "input"}, "late": {"kind": "delay", "time": 0.5}, "s": {"kind": "sum", "signs": "++"}},
        "connections": [{"from": "r", "to": "late"}, {"from": "late", "to": "s.in1"}, {"from": "r", "to": "s.in2"}],
        "outputs": {"y": "s"},
    }
    (found,) = client.post("/v1/frequency-responses", json={"system": comb, "from": "r", "to": "y"}).json()["variants"]
    assert found["zeros"] is None


def test_an_unsaved_system_has_the_matrices_and_poles_of_a_stored_one(client) -> None:
    stored = client.post("/v1/systems", json=PNEUMATIC).json()["id"]
    known = client.get(f"/v1/systems/{stored}/state-space").json()
    reply = client.post("/v1/state-space", json={"system": PNEUMATIC})
    assert reply.status_code == 200, reply.text
    found = reply.json()
    StateSpaceReply.model_validate(found)
    assert found["system"] is None
    assert found == known | {"system": None}
    assert client.post("/v1/state-space", json={"system": stored}).json() == known
    poles = np.linalg.eigvals(np.array(found["A"]))
    np.testing.assert_allclose(np.sort_complex(roots(found["poles"])), np.sort_complex(poles), rtol=1e-8)
    file = client.post("/v1/state-space", params={"format": "mat"}, json={"system": PNEUMATIC})
    np.testing.assert_array_equal(loadmat(io.BytesIO(file.content))["A"], np.array(found["A"]))


def test_its_parameters_and_openings_may_be_given(client) -> None:
    body = {"system": LOOP, "parameters": {"c.kp": 9.0}, "open_at": ["e"]}
    found = client.post("/v1/state-space", json=body).json()
    assert found["inputs"][-1] == "loop"
    model = control.ss(*(np.array(found[name]) for name in "ABCD"))
    np.testing.assert_allclose(-model(1j)[-1, -1], (9 + 6 / 1j) * P(1j), rtol=1e-12)
    np.testing.assert_allclose(np.sort_complex(roots(found["poles"])), [-1 - 2j, -1 + 2j, 0], atol=1e-12)
    for wrong, pointer in (({"open_at": "ghost"}, "/open_at"), ({"parameters": {"ghost": 1}}, "/parameters/ghost")):
        reply = client.post("/v1/state-space", json={"system": LOOP} | wrong)
        assert reply.status_code == 422
        assert reply.json()["errors"][0]["pointer"] == pointer


def test_the_poles_of_a_delayed_one_are_the_rightmost(client) -> None:
    blocks = {**LAG["blocks"], "line": {"kind": "delay", "time": 0.3}}
    delayed = LAG | {"blocks": blocks, "connections": [{"from": "u", "to": "line"}, {"from": "line", "to": "plant"}]}
    found = client.post("/v1/state-space", json={"system": delayed}).json()
    assert found["delays"] == [0.3]
    assert len(found["poles"]) == 1


def test_the_client_asks_for_both(service) -> None:
    with servotune.connect(service.url, key=service.keys["run"]) as client:
        assert client.systems.state_space(LOOP)["system"] is None
        found = client.frequency_response(LOOP, paths=[{"from": "r", "to": "u"}], noise_density=1.0)
        assert found["variants"][0]["paths"][0]["to"] == "u"
