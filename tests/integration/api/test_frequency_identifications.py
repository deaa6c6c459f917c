"""Identification from measured frequency responses over HTTP: a chirp, a kept response, both at once, and what is refused."""

from __future__ import annotations

from typing import Any

import httpx
import numpy as np
import pytest
from scipy.signal import chirp, cont2discrete, lfilter

from tests.integration.api.test_identifications import made, result

RATE = 200.0
TRUTH = {"k": 3.0, "w": 25.0, "d": 0.3, "tau": 0.02}
"""The delay is four samples."""
CHIRPS = chirp(np.arange(2400) / RATE, 0.3, 12.0, 12.0)

SYSTEM: dict[str, Any] = {
    "name": "late oscillator",
    "parameters": {
        "k": {"value": 2.0, "lower": 0.1, "upper": 10.0},
        "w": {"value": 18.0, "unit": "rad/s", "lower": 1.0, "upper": 100.0},
        "d": {"value": 0.6, "lower": 0.01, "upper": 2.0},
        "tau": {"value": 0.01, "unit": "s", "lower": 0.0, "upper": 0.1},
    },
    "blocks": {
        "u": {"kind": "input"},
        "late": {"kind": "delay", "time": "=tau"},
        "plant": {"kind": "transfer_function", "numerator": ["=k*w**2"], "denominator": [1, "=2*d*w", "=w**2"]},
    },
    "connections": [{"from": "u", "to": "late"}, {"from": "late", "to": "plant"}],
    "outputs": {"y": "plant"},
}


def driven(u: np.ndarray) -> np.ndarray:
    """Return the response to a held input, by scipy's zero-order hold."""
    k, w, d = TRUTH["k"], TRUTH["w"], TRUTH["d"]
    numerator, denominator, _ = cont2discrete(([k * w * w], [1.0, 2 * d * w, w * w]), 1 / RATE, method="zoh")
    return np.asarray(lfilter(numerator[0], denominator, np.concatenate([np.zeros(4), u[:-4]])))


@pytest.fixture(scope="module")
def client(sqlite_service):
    with sqlite_service.client() as own:
        yield own


@pytest.fixture(scope="module")
def dataset(client) -> str:
    """Return ten chirps one after the other, as channels u and y, with noise."""
    u = np.tile(CHIRPS, 10)
    return made(client, u=u, y=driven(u) + 0.05 * np.random.default_rng(5).normal(size=u.size))


def response(dataset: str, **settings: Any) -> dict[str, Any]:
    held = {"channel": "u", "between_samples": "hold"}
    return {
        "dataset": dataset, "inputs": {"u": held}, "outputs": {"y": "y"}, "segment": 8.0, "band": ["0.4 Hz", "10 Hz"], **settings
    }  # fmt: skip


def asked(*responses: dict[str, Any], **settings: Any) -> dict[str, Any]:
    return {"system": SYSTEM, "parameters": list(TRUTH), "frequency_responses": list(responses), **settings}


def refused(client: httpx.Client, body: dict[str, Any]) -> str:
    reply = client.post("/v1/identifications", json=body)
    assert reply.status_code == 422, reply.text
    return str(reply.json())


def check_truth(found: dict[str, Any]) -> None:
    for name, value in TRUTH.items():
        estimate = found["parameters"][name]
        assert estimate["value"] == pytest.approx(value, rel=0.01)
        half = estimate["upper95"] - estimate["value"]
        assert abs(estimate["value"] - value) < 2 * half
        assert half < 0.02 * value


def test_a_chirp_gives_the_parameters_with_a_fit_for_each_response(client, sqlite_worker, dataset):
    found = result(client, asked(response(dataset)))
    check_truth(found)
    assert found["status"] == "converged"
    assert found["dataset"] == dataset
    assert found["experiments"] == []
    (one,) = found["frequency_responses"]
    assert one["name"] == "response_1"
    judged = one["outputs"]["y"]
    assert judged["fit_percent"] > 97.0
    low, high = judged["band"]
    assert 2 * np.pi * 0.4 <= low < high <= 2 * np.pi * 10.0
    lines = round((high - low) / (2 * np.pi / 8.0)) + 1
    assert judged["lines"] + judged["lines_left_out"] >= lines >= judged["lines"]
    assert judged["scatter"] > 0


def test_a_kept_response_is_the_same_as_its_recording(client, sqlite_worker, dataset):
    kept = client.post(
        "/v1/frfs", json={"dataset": dataset, "input": "u", "output": "y", "segment": 8.0, "keep": True}
    ).json()
    held = {"channel": "u", "between_samples": "hold"}
    stored = {"frf": kept["id"], "inputs": {"u": held}, "outputs": {"y": "y"}, "band": ["0.4 Hz", "10 Hz"]}
    direct = result(client, asked(response(dataset)))
    found = result(client, asked(stored))
    assert found["parameters"] == direct["parameters"]
    assert found["datasets"] == [dataset]
    said = refused(client, asked(stored | {"dataset": dataset}))
    assert "must have dataset or frf, got both" in said
    assert "must have segment with dataset only" in refused(client, asked(stored | {"segment": 4.0}))
    assert "must be the channel of the kept response (u)" in refused(client, asked(stored | {"inputs": {"u": "y"}}))
    assert "frf must be a result that exists" in refused(client, asked(stored | {"frf": "res_nothing"}))


def test_both_at_once(client, sqlite_worker, dataset):
    recording = {
        "dataset": dataset, "inputs": {"u": {"channel": "u", "between_samples": "hold"}}, "outputs": {"y": "y"},
        "estimation": [0, 5], "validation": [5, 10],
    }  # fmt: skip
    found = result(client, asked(response(dataset, part=[12, 120]), **recording))
    check_truth(found)
    assert found["fit"]["validation"]["y"]["fit_percent"] > 90
    assert len(found["experiments"]) == len(found["frequency_responses"]) == 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"band": ["0.01 Hz", "0.05 Hz"]}, "band must hold lines"),
        ({"band": ["60 Hz", "90 Hz"]}, "coherence of at least"),
        ({"band": ["1 Hz", "150 Hz"]}, "band must end at most at 628.319 rad/s, half the sample rate"),
        ({"inputs": {"v": "u"}}, "v"),
        ({"outputs": {"z": "y"}}, "z"),
        ({"outputs": {"y": "nothing"}}, "channel must be one of the dataset's"),
        ({"segment": 100.0}, "segment must"),
        ({"part": [0, 12], "segment": 6.0}, "independent averages"),
        ({"frf": "res_x"}, "must have dataset or frf, got both"),
        ({"dataset": None}, "must have dataset or frf, got neither"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_words(client, dataset, settings, message):
    said = refused(client, asked(response(dataset) | settings))
    assert message in said
    assert "frequency_responses" in said
