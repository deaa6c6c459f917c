"""Identifications over HTTP: several recordings at once, models without a diagram, and what is refused."""

from __future__ import annotations

import time
from typing import Any

import httpx
import numpy as np
import pytest
from scipy.signal import lfilter

from api.schemas.replies import ExpectedReply
from tests.integration.api.conftest import finished
from tests.integration.api.documents import LAG, upload
from tests.support.patience import PATIENCE

RATE = 200.0
K, TAU = 3.0, 0.05
RNG = np.random.default_rng(3)
U = np.repeat(RNG.choice([-1.0, 1.0], size=60), 20)


def lag(k: float, tau: float, u: np.ndarray = U) -> np.ndarray:
    """Return y of τ y' + y = k u for an input in straight lines: exact, by its own recursion; from rest under u_0."""
    p = np.exp(-1 / (RATE * tau))
    r = tau * RATE * (1 - p)
    y, value = np.empty_like(u), k * u[0]
    for i in range(u.size):
        if i:
            value = p * value + k * ((r - p) * u[i - 1] + (1 - r) * u[i])
        y[i] = value
    return y


def made(client: httpx.Client, **columns: np.ndarray) -> str:
    described = [{"name": name, "unit": "" if name == "u" else "N"} for name in columns]
    document = {"name": "made", "format": "raw", "sample_rate": RATE, "channels": described}
    data = np.column_stack(list(columns.values())).astype("<f8").tobytes()
    reply = upload(client, document, data, segment=len(data))
    assert reply.status_code == 200, reply.text
    return str(reply.json()["id"])


@pytest.fixture(scope="module")
def client(sqlite_service):
    with sqlite_service.client() as own:
        yield own


@pytest.fixture(scope="module")
def recordings(client) -> list[str]:
    """Return two recordings of the same lag with other gains and sensor zeros, as channel y in N."""
    return [
        made(client, u=U, y=lag(gain, TAU) + zero + 0.01 * RNG.normal(size=U.size))
        for gain, zero in ((3, 0.2), (6, -0.1))
    ]


def result(client: httpx.Client, body: dict[str, Any]) -> dict[str, Any]:
    reply = client.post("/v1/identifications", json=body)
    assert reply.status_code == 202, reply.text
    job = finished(client, reply.json())
    assert job["status"] == "succeeded", job
    found: dict[str, Any] = client.get(f"/v1/jobs/{job['id']}/result").json()
    return found


SYSTEM = {
    **LAG,
    "parameters": {
        "k": {"value": 1.0, "lower": 0.1, "upper": 10.0},
        "tau": {"value": 0.2, "unit": "s", "lower": 0.001, "upper": 1.0},
    },
}
CHANNELS = {"inputs": {"u": "u"}, "outputs": {"y": "y"}}


def test_two_experiments_with_gains_of_their_own_give_one_time_constant(client, sqlite_worker, recordings) -> None:
    first, second = recordings
    found = result(
        client,
        {
            "system": SYSTEM, "parameters": ["tau"], "offsets": "estimate",
            "experiments": [
                {"name": "slow", "dataset": first, **CHANNELS, "parameters": {"k": 3.0}, "split": 1.0},
                {"name": "fast", "dataset": second, **CHANNELS, "parameters": {"k": 6.0}, "split": 0.0},
            ],
        },
    )  # fmt: skip
    assert found["parameters"]["tau"]["value"] == pytest.approx(TAU, rel=0.01)
    assert [one["name"] for one in found["experiments"]] == ["slow", "fast"]
    assert [one["offsets"]["y"] for one in found["experiments"]] == pytest.approx([0.2, -0.1], abs=0.01)
    # noise of 0.01 beside signals of spread 3 and 6
    assert found["fit"]["validation"]["y"]["fit_percent"] > 99
    assert found["datasets"] == [first, second]
    assert set(found["one_step_prediction"]) == {"y"}


def test_a_split_beside_experiments_is_that_of_those_that_say_none(client, sqlite_worker, recordings) -> None:
    """It was refused; a search with the same split in each gives the same values to the last digit."""
    first, second = recordings
    of_one = [
        {"dataset": dataset, **CHANNELS, "parameters": {"k": gain}} for dataset, gain in ((first, 3.0), (second, 6.0))
    ]
    common = {"system": SYSTEM, "parameters": ["tau"], "offsets": "estimate"}
    beside = result(client, {**common, "experiments": of_one, "split": 0.3})
    within = result(client, {**common, "experiments": [{**one, "split": 0.3} for one in of_one]})
    assert beside["windows"] == within["windows"]
    assert beside["parameters"] == within["parameters"]
    own = [{**of_one[0], "estimation": [0.0, 1.0]}, of_one[1]]
    mixed = result(client, {**common, "experiments": own, "split": 0.3})
    assert mixed["windows"]["estimation"] == [0.0, 1.0]


def test_what_an_identification_takes_is_told_without_starting_it(client, long_search) -> None:
    before = client.get("/v1/jobs", params={"kind": "identification"}).json()["items"]
    reply = client.post("/v1/identifications", params={"dry_run": True}, json=long_search)
    assert reply.status_code == 200, reply.text
    told = ExpectedReply.model_validate(reply.json())
    assert told.expected is not None
    assert told.expected.seconds > 60
    assert "simulations" in told.warnings[0].detail
    direct = {"method": "static_curve", "dataset": long_search["dataset"], "input": "u", "output": "y"}
    assert client.post("/v1/identifications", params={"dry_run": True}, json=direct).json() == {
        "expected": None,
        "warnings": [],
    }
    wrong = client.post("/v1/identifications", params={"dry_run": True}, json={**long_search, "parameters": ["none"]})
    assert wrong.status_code == 422
    assert client.get("/v1/jobs", params={"kind": "identification"}).json()["items"] == before


@pytest.fixture(scope="module")
def long_search(client) -> dict[str, Any]:
    """Return what would take minutes: a hundred starts on 120,000 samples."""
    u = np.tile(U, 100)
    dataset = made(client, u=u, y=lag(K, TAU, u) + 0.01 * RNG.normal(size=u.size))
    return {"system": SYSTEM, "dataset": dataset, **CHANNELS, "parameters": ["k", "tau"], "starts": 100}


def test_a_cancelled_search_gives_its_best_values(client, sqlite_worker, long_search) -> None:
    job = client.post("/v1/identifications", json=long_search).json()
    (said,) = [one["detail"] for one in job["warnings"]]
    assert "simulations" in said
    assert "fewer starts take less" in said
    until = time.monotonic() + PATIENCE
    while "best after" not in str(client.get(f"/v1/jobs/{job['id']}").json()["message"]) and time.monotonic() < until:
        time.sleep(0.05)
    client.post(f"/v1/jobs/{job['id']}/cancel")
    assert finished(client, job)["status"] == "cancelled"
    until = time.monotonic() + PATIENCE
    while (found := client.get(f"/v1/jobs/{job['id']}/result")).status_code == 409 and time.monotonic() < until:
        time.sleep(0.05)
    assert found.json()["status"] == "cancelled"
    assert {name: one["lower95"] is not None for name, one in found.json()["parameters"].items()} == {
        "k": True,
        "tau": True,
    }


def test_a_search_whose_time_is_over_gives_its_best_values(client, sqlite_worker, long_search) -> None:
    found = result(client, {**long_search, "queue": {"time_limit": 8}})
    assert found["status"] == "budget"
    assert found["parameters"]["k"]["value"] == pytest.approx(K, rel=0.01)
    assert found["parameters"]["tau"]["value"] == pytest.approx(TAU, rel=0.01)
    assert found["expected"]["evaluations"] >= 8 * 100  # that many for a start, as 33 known plants took
    assert found["expected"]["bytes"] > 60_000 * 8


def test_a_transfer_function_is_made_from_a_recording_alone(client, sqlite_worker, recordings) -> None:
    found = result(
        client,
        {"method": "transfer_function", "dataset": recordings[0], **CHANNELS, "orders": [1, 2], "largest_delay": 0.02},
    )
    assert found["order"] == 1
    assert found["delay"] == 0
    assert found["poles"][0] == pytest.approx([-1 / TAU, 0], rel=0.02)
    assert [one["order"] for one in found["tried"]] == [1, 2]
    document = found["document"]
    body = {"system": document, "dataset": recordings[0], **CHANNELS, "offsets": "estimate"}
    validation = client.post("/v1/validations", json=body)
    assert validation.status_code == 200, validation.text
    assert validation.json()["outputs"]["y"]["fit_percent"] > 99


def test_the_friction_of_a_drive_is_found_without_a_start(client, sqlite_worker) -> None:
    t = np.arange(2000) / RATE
    velocity = np.sin(3 * t) + 0.5 * np.sin(11 * t + 1)
    acceleration = 3 * np.cos(3 * t) + 5.5 * np.cos(11 * t + 1)
    force = 2 * acceleration + 5 * velocity + 0.7 * np.sign(velocity) - 0.3
    dataset = made(client, v=velocity, f=force)
    found = result(client, {"method": "inverse_dynamics", "dataset": dataset, "force": "f", "velocity": "v"})
    values = {name: term["value"] for name, term in found["parameters"].items()}
    # central differences miss sin(ωh)/(ωh): 0.05 % at 11 rad/s
    assert values == pytest.approx({"mass": 2, "viscous": 5, "coulomb": 0.7, "offset": -0.3}, rel=2e-3)
    assert found["equation_error"]["fit_percent"] > 99.9
    assert "fit" not in found


def test_a_static_curve_becomes_a_lookup_table(client, sqlite_worker) -> None:
    u = np.sin(np.arange(1000) / 9)
    dataset = made(client, u=u, y=u**3 - 0.5 * u)
    found = result(client, {"method": "static_curve", "dataset": dataset, "input": "u", "output": "y"})
    assert found["degree"] == 3
    assert found["static_fit"]["fit_percent"] == pytest.approx(100, abs=1e-6)
    assert found["document"]["blocks"]["curve"]["values"][-1] == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize(
    ("body", "pointer", "detail"),
    [
        ({"system": SYSTEM, "parameters": ["k"]}, "", "dataset, inputs and outputs, or experiments"),
        ({"system": SYSTEM, "parameters": ["k"], "dataset": "ds_1", **CHANNELS, "experiments": [{"dataset": "ds_1", **CHANNELS}]}, "", "in each of its experiments"),
        ({"system": SYSTEM, "parameters": ["k"], "experiments": [{"dataset": "ds_none", **CHANNELS}]}, "/experiments/0/dataset", "must be one that exists"),
        ({"method": "neural", "dataset": "ds_1"}, "", "must be grey_box"),
        ({"method": "subspace", "dataset": "ds_none", **CHANNELS}, "/dataset", "must be one that exists"),
        ({"method": "subspace", "dataset": "ds_none", **CHANNELS, "orders": [0]}, "/orders/0", ">= 1"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_refused_with_its_place(client, body, pointer, detail) -> None:
    reply = client.post("/v1/identifications", json=body)
    assert reply.status_code == 422, reply.text
    errors = reply.json()["errors"]
    assert errors[0]["pointer"] == pointer
    assert detail in errors[0]["detail"]


def test_bad_recordings_are_refused_by_name(client, recordings) -> None:
    def refused(**change: Any) -> str:
        body = {"system": SYSTEM, "dataset": recordings[0], **CHANNELS, "parameters": ["k"], **change}
        reply = client.post("/v1/identifications", json=body)
        assert reply.status_code == 422, reply.text
        return str(reply.json()["errors"][0]["detail"])

    short = made(client, u=U[10:35], y=lag(K, TAU)[10:35])
    constant = made(client, u=U, y=np.full(U.size, 2.0))
    still = made(client, u=np.ones(U.size), y=lag(K, TAU))
    assert "at least 20 samples, got 13" in refused(dataset=short)
    assert "output y must vary" in refused(dataset=constant)
    assert "inputs must vary" in refused(dataset=still)
    assert "must be one of the dataset's" in refused(inputs={"u": "w"})
    late = {"method": "transfer_function", "dataset": recordings[0], **CHANNELS, "largest_delay": 60}
    assert "must be 0 to" in client.post("/v1/identifications", json=late).json()["errors"][0]["detail"]
    assert "starts" in client.post("/v1/identifications", json={"system": SYSTEM, "dataset": short, **CHANNELS, "parameters": ["k"], "starts": 0}).text  # fmt: skip


def test_the_recursion_of_the_test_is_the_lag() -> None:
    """Against the impulse response of the same lag, summed by brute force on a grid twenty times finer."""
    fine = np.interp(np.arange(U.size * 20) / 20, np.arange(U.size), U)
    p = np.exp(-1 / (20 * RATE * TAU))
    y = lfilter([0.0, K * (1 - p)], [1.0, -p], fine, zi=[K * U[0] * p])[0]
    assert lag(K, TAU)[5:] == pytest.approx(y[::20][5:], abs=0.02)


def test_a_held_input_is_found_out_and_an_assumption_that_is_wrong_is_told(client, sqlite_worker) -> None:
    u = RNG.normal(size=800)
    u[0] = 0.0
    y = lfilter([0.0, 2.0 * (1 - np.exp(-1 / 4))], [1.0, -np.exp(-1 / 4)], u)  # a lag of 20 ms at 200 Hz, held
    dataset = made(client, u=u, y=y + 0.02 * RNG.normal(size=u.size))
    body = {"system": SYSTEM, "dataset": dataset, **CHANNELS, "parameters": ["k", "tau"], "split": 0.9}
    found = result(client, body)
    assert found["between_samples"]["chosen"] == "hold"
    assert found["warnings"] == []
    tau = found["parameters"]["tau"]
    assert tau["lower95"] < 0.02 < tau["upper95"]
    tried = found["between_samples"]["tried"]
    assert set(tried) == {"hold", "linear", "band_limited"}
    assert tried["hold"]["parameters"]["tau"] == tau["value"]
    assert tried["linear"]["fit_percent"] < tried["hold"]["fit_percent"]
    wrong = result(client, {**body, "inputs": {"u": {"channel": "u", "between_samples": "linear"}}})
    assert wrong["between_samples"] is None
    assert not wrong["parameters"]["tau"]["lower95"] < 0.02 < wrong["parameters"]["tau"]["upper95"]
    details = [warning["detail"] for warning in wrong["warnings"]]
    assert any("u still explains a part of the residuals of y" in detail for detail in details)
    assert not wrong["residuals"]["y"]["independent"]


def test_a_validation_goes_on_with_what_was_found_between_the_samples(client, sqlite_worker, recordings) -> None:
    body = {"system": SYSTEM, "dataset": recordings[0], **CHANNELS, "parameters": ["k", "tau"], "offsets": "estimate"}
    reply = client.post("/v1/identifications", json=body)
    job = finished(client, reply.json())
    found = client.get(f"/v1/jobs/{job['id']}/result").json()
    window = found["windows"]["validation"]
    again = {"system": SYSTEM, "dataset": recordings[0], **CHANNELS, "identification": job["id"], "window": window}
    checked = client.post("/v1/validations", json=again).json()
    assert found["between_samples"]["chosen"] == "linear"
    assert checked["between_samples"] is None
    fit = found["fit"]["validation"]["y"]["fit_percent"]
    assert checked["outputs"]["y"]["fit_percent"] == pytest.approx(fit, abs=1e-6)
