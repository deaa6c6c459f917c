"""/v1/systems/{id}/state-space: matrices that python-control and scipy read back as the same system."""

from __future__ import annotations

import io

import control
import numpy as np
import pytest
from scipy.io import loadmat

import servotune
from engine.interop.from_python_control import from_control
from engine.interop.system_document import system_document
from tests.integration.api.documents import LAG, PNEUMATIC

FREQUENCIES = np.logspace(-2, 3, 40)


@pytest.fixture(scope="module")
def stored(service) -> str:
    with service.client() as client:
        return client.post("/v1/systems", json=PNEUMATIC).json()["id"]


def response(client, system: str, **path: str) -> np.ndarray:
    """Return the service's own frequency response."""
    body = {"system": system, "frequencies": FREQUENCIES.tolist(), **path}
    found = client.post("/v1/frequency-responses", json=body).json()["variants"][0]
    return np.array(found["magnitude"]) * np.exp(1j * np.array(found["phase"]))


def test_the_matrices_are_the_system(client, stored) -> None:
    found = client.get(f"/v1/systems/{stored}/state-space").json()
    assert found["system"] == {"id": stored, "revision": 1}
    assert found["inputs"] == ["reference", "load"]
    assert found["outputs"] == ["position", "velocity", "acceleration", "control"]
    assert found["output_units"] == ["m", "m/s", "m/s**2", ""]
    assert len(found["states"]) == len(found["A"]) == 5
    assert found["delays"] == found["channels"] == []
    system = control.ss(*(np.array(found[name]) for name in "ABCD"))
    followed = response(client, stored, **{"from": "reference", "to": "position"})
    assert np.abs(system(1j * FREQUENCIES)[0, 0] / followed - 1).max() < 1e-12
    # A load moves the velocity nowhere at rest: what cancels there is small against the peak only.
    disturbed = response(client, stored, **{"from": "load", "to": "velocity"})
    assert np.abs(system(1j * FREQUENCIES)[1, 1] - disturbed).max() < 1e-12 * np.abs(disturbed).max()


def test_a_cut_loop_has_its_two_ends(client, stored) -> None:
    found = client.get(f"/v1/systems/{stored}/state-space", params={"open_at": "error"}).json()
    assert (found["inputs"][-1], found["outputs"][-1]) == ("loop", "loop")
    system = control.ss(*(np.array(found[name]) for name in "ABCD"))
    expected = response(client, stored, open_at="error")
    assert np.abs(-system(1j * FREQUENCIES)[-1, -1] / expected - 1).max() < 1e-12


def test_the_mat_file_holds_the_same(client, stored) -> None:
    reply = client.get(f"/v1/systems/{stored}/state-space", params={"format": "mat"})
    assert reply.headers["Content-Type"] == "application/x-matlab-data"
    assert f'filename="{stored}.mat"' in reply.headers["Content-Disposition"]
    found, document = loadmat(io.BytesIO(reply.content)), client.get(f"/v1/systems/{stored}/state-space").json()
    for name in "ABCD":
        np.testing.assert_array_equal(found[name], document[name])
    assert [cell[0] for cell in found["states"].ravel()] == document["states"]


def test_a_delay_comes_in_linear_fractional_form(client) -> None:
    """The lag behind a delay: y = e^(-0.3 s) u/(0.5 s + 1)."""
    blocks = {**LAG["blocks"], "line": {"kind": "delay", "time": 0.3}}
    delayed = LAG | {
        "blocks": blocks,
        "connections": [{"from": "u", "to": "line"}, {"from": "line", "to": "plant"}],
    }
    where = f"/v1/systems/{client.post('/v1/systems', json=delayed).json()['id']}/state-space"
    found = client.get(where).json()
    assert found["delays"] == [0.3]
    assert found["channels"] == ["line.w1"]
    assert found["D21"] == [[1.0]]
    assert "B" not in found
    assert loadmat(io.BytesIO(client.get(where, params={"format": "mat"}).content))["delays"].tolist() == [[0.3]]


def test_what_is_wrong_is_refused(client, stored) -> None:
    where = f"/v1/systems/{stored}/state-space"
    assert client.get("/v1/systems/sys_none/state-space").status_code == 404
    assert client.get(where, params={"format": "xls"}).status_code == 422
    refused = client.get(where, params={"open_at": "nowhere", "format": "mat"})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/open_at"
    assert "nowhere" in refused.json()["detail"]


def test_a_python_control_model_goes_there_and_back(service) -> None:
    given = control.ss(
        [[0.0, 1.0], [-9.0, -0.6]], [[0.0], [9.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0], [0.5]],
        inputs=["force"], outputs=["x", "v"], name="stage",
    )  # fmt: skip
    with servotune.connect(service.url, key=service.keys["write"]) as client:
        system = client.systems.create(system_document(from_control(given)))["id"]
        found = client.systems.state_space(system)
        assert (found["inputs"], found["outputs"]) == (["force"], ["x", "v"])
        back = control.ss(*(np.array(found[name]) for name in "ABCD"))
        np.testing.assert_allclose(back(1j * FREQUENCIES), given(1j * FREQUENCIES), rtol=1e-12)
        file = loadmat(io.BytesIO(client.systems.matlab(system, open_at="stage.x")))
        assert file["D"].shape == (3, 2)


def test_a_nonlinear_system_says_that_it_is_linearised(client) -> None:
    """A saturation within its limits has slope 1: x' = -x + 2 sat(u)."""
    document = {
        "name": "limited",
        "blocks": {
            "u": {"kind": "input"},
            "limit": {"kind": "saturation", "lower": -3.0, "upper": 3.0},
            "lag": {"kind": "transfer_function", "numerator": [2.0], "denominator": [1.0, 1.0]},
        },
        "connections": [{"from": "u", "to": "limit"}, {"from": "limit", "to": "lag"}],
        "outputs": {"y": "lag"},
    }
    system = client.post("/v1/systems", json=document).json()["id"]
    found = client.get(f"/v1/systems/{system}/state-space").json()
    assert any("linearised" in warning["detail"] for warning in found["warnings"])
    assert (np.array(found["C"]) @ np.array(found["B"])).tolist() == [[2.0]]
