"""Recordings at uneven instants: kept as they are, resampled where that is asked for, refused where a rate is needed."""

from __future__ import annotations

import io

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from scipy.interpolate import CubicSpline

from api.schemas.replies import DatasetReply
from tests.integration.api.conftest import finished
from tests.integration.api.documents import LAG, sha256, upload

RNG = np.random.default_rng(29)
COUNT = 3000
TIME = np.round((np.arange(COUNT) + RNG.uniform(-0.4, 0.4, COUNT)) / 500 + 1.0, 6)
FORCE = np.round(np.sin(40 * TIME), 9)
TABLE = "t [s],u [V],y [mm]\n" + "".join(
    f"{t:.6f},{u:.9f},{2 * u:.9f}\n" for t, u in zip(TIME.tolist(), FORCE.tolist(), strict=True)
)
CONTENT = TABLE.encode()
SINCE = TIME - TIME[0]


@pytest.fixture(scope="module")
def client(sqlite_service, sqlite_worker):
    with sqlite_service.client() as client:
        yield client


def imported(client, content=CONTENT, **description):
    body = {"name": "jitter", **({"import": description} if description else {})}
    reply = upload(client, body, content, segment=1 << 22)
    finished(client, reply.json()["job"])
    dataset = client.get(f"/v1/datasets/{reply.json()['id']}").json()
    DatasetReply.model_validate(dataset)
    return dataset


@pytest.fixture(scope="module")
def kept(client):
    return imported(client)


def channel(client, dataset, name, **query):
    reply = client.get(f"/v1/datasets/{dataset['id']}/channels/{name}", params=query)
    assert reply.status_code == 200, reply.text
    return reply.json()


def test_instants_are_kept_as_a_channel(client, kept):
    assert (kept["status"], kept["sample_rate"], kept["uneven"], kept["sample_count"]) == ("ready", None, True, COUNT)
    assert kept["channels"][0] == {"name": "time", "quantity": "time", "unit": "s"}
    assert kept["duration"] == pytest.approx(SINCE[-1], abs=1e-12)
    assert kept["report"]["import"]["uneven"] == "keep"
    assert kept["report"]["time"]["mean"] == pytest.approx((COUNT - 1) / SINCE[-1], rel=1e-12)
    assert "samples off an even axis of" in kept["report"]["remarks"][1]
    truth = pd.read_csv(io.StringIO(TABLE))
    read = channel(client, kept, "u")
    np.testing.assert_allclose(read["time"], truth["t [s]"] - truth["t [s]"][0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(read["values"], truth["u [V]"])
    assert read["sample_rate"] is None
    np.testing.assert_allclose(channel(client, kept, "time")["values"], SINCE, rtol=0, atol=1e-12)


def test_stretches_and_envelopes_are_found_by_the_instants(client, kept):
    inside = (SINCE >= 1.0) & (SINCE <= 2.0)
    read = channel(client, kept, "u", start=1.0, end=2.0)
    np.testing.assert_array_equal(read["values"], FORCE[inside])
    np.testing.assert_allclose(read["time"], SINCE[inside], rtol=0, atol=1e-12)
    few = channel(client, kept, "u", points=50)
    assert len(few["time"]) <= 50
    assert np.isin(np.round(few["time"], 9), np.round(SINCE, 9)).all()
    assert (min(few["min"]), max(few["max"])) == (FORCE.min(), FORCE.max())
    assert client.get(f"/v1/datasets/{kept['id']}/channels/u", params={"start": 99}).status_code == 422


def test_exports_hold_the_instants_and_come_back(client, kept):
    where = f"/v1/datasets/{kept['id']}/export"
    files = {name: client.get(where, params={"format": name}).content for name in ("csv", "mat", "hdf5", "parquet")}
    assert files["csv"].partition(b"\n")[0] == b"time [s],u [V],y [mm]"
    times = {
        "csv": np.loadtxt(io.BytesIO(files["csv"]), delimiter=",", skiprows=1)[:, 0],
        "mat": scipy.io.loadmat(io.BytesIO(files["mat"]))["t"][:, 0],
        "hdf5": h5py.File(io.BytesIO(files["hdf5"]))["time"][:],
        "parquet": pd.read_parquet(io.BytesIO(files["parquet"]))["time"].to_numpy(),
    }
    for found in times.values():
        np.testing.assert_allclose(found, SINCE, rtol=0, atol=1e-12)
    for content in files.values():
        again = imported(client, content)
        assert again["uneven"], again
        read = channel(client, again, "y")
        np.testing.assert_array_equal(read["values"], channel(client, kept, "y")["values"])
        np.testing.assert_allclose(read["time"], SINCE, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("path", "body", "place"),
    [
        ("spectra", {"quantity": "density", "channel": "u"}, "/dataset"),
        ("validations", {"system": LAG, "inputs": {"u": "u"}, "outputs": {"y": "y"}}, "/dataset"),
        ("processings", {"name": "x", "steps": [{"kind": "detrend"}]}, "/sources/0"),
    ],
)
def test_what_needs_a_rate_is_refused_with_the_remedy(client, kept, path, body, place):
    named = {"sources": [kept["id"]]} if path == "processings" else {"dataset": kept["id"]}
    reply = client.post(f"/v1/{path}", json=body | named)
    assert reply.status_code == 422, reply.text
    (error,) = reply.json()["errors"]
    assert error["pointer"] == place
    assert "has uneven instants" in error["detail"]
    assert '{"kind": "resample", "rate": ...} makes an even one' in error["detail"]


@pytest.mark.parametrize("method", ["linear", "cubic"])
def test_a_processing_makes_an_even_one(client, kept, method):
    steps = [{"kind": "resample", "rate": 1000, "method": method}, {"kind": "detrend"}]
    reply = client.post("/v1/processings", json={"name": "even", "sources": [kept["id"]], "steps": steps})
    assert reply.status_code == 201, reply.text
    made = reply.json()
    assert (made["sample_rate"], made["uneven"], [one["name"] for one in made["channels"]]) == (1000, False, ["u", "y"])
    grid = np.arange(int(SINCE[-1] * 1000) + 1) / 1000
    truth = np.interp(grid, SINCE, FORCE) if method == "linear" else CubicSpline(SINCE, FORCE)(grid)
    np.testing.assert_allclose(channel(client, made, "u")["values"], truth - truth.mean(), rtol=0, atol=1e-12)
    # now that it is even it has a low pass, and no interpolation
    again = {"name": "x", "sources": [made["id"]], "steps": [steps[0]]}
    assert "method must be left out for even samples" in client.post("/v1/processings", json=again).text


def test_an_import_resamples_where_it_is_told(client):
    even = imported(client, uneven={"resample": {"rate": 600, "method": "cubic"}})
    assert (even["sample_rate"], even["uneven"], len(even["channels"])) == (600, False, 2)
    grid = np.arange(int(SINCE[-1] * 600) + 1) / 600
    found = channel(client, even, "u")["values"]
    np.testing.assert_allclose(found, CubicSpline(SINCE, FORCE)(grid), rtol=0, atol=1e-12)
    assert "all channels are resampled to 600 samples/s (cubic)" in even["report"]["remarks"][1]
    slow = imported(client, uneven={"resample": {"rate": 100}})
    assert slow["status"] == "failed"
    assert "rate must be at least the mean one of the uneven instants" in slow["error"]["detail"]


def test_a_preview_says_that_instants_are_uneven(client):
    content = CONTENT
    where = client.post("/v1/datasets", json={"name": "jitter", "format": "csv"}).headers["Location"]
    client.put(f"{where}/segments/{sha256(content)}", content=content)
    job = client.post(f"{where}/preview", json={"segments": [sha256(content)]}).json()["job"]
    assert finished(client, job)["status"] == "succeeded"
    found = client.get(f"/v1/jobs/{job['id']}/result").json()
    assert (found["sample_rate"], found["sample_count"]) == (None, COUNT)
    assert found["uneven"] == pytest.approx(0.4, abs=0.05)
    assert found["import"]["uneven"] == "keep"
    assert "they are kept as a channel" in found["remarks"][-1]


def test_a_sampled_command_follows_the_instants(client, kept):
    """A lag driven by the recording, beside its closed form for an input that is linear between the instants."""
    signal = {"kind": "sampled", "dataset": kept["id"], "channel": "u", "between_samples": "linear"}
    body = {"system": LAG, "input": {"port": "u", "signal": signal}, "duration": 2.0, "samples": 401}
    reply = client.post("/v1/simulations", json=body)
    assert reply.status_code == 200, reply.text
    (variant,) = reply.json()["variants"]
    k, tau = 1.0, 0.2
    grid = np.array(variant["time"])
    union = np.union1d(grid, SINCE[SINCE <= 2.0])
    u = np.interp(union, SINCE, FORCE)
    y = np.zeros(union.size)
    for i, h in enumerate(np.diff(union)):
        decay, slope = np.exp(-h / tau), (u[i + 1] - u[i]) / h
        y[i + 1] = decay * y[i] + k * (u[i] * (1 - decay) + slope * (h - tau * (1 - decay)))
    np.testing.assert_allclose(variant["outputs"]["y"], y[np.isin(union, grid)], rtol=0, atol=1e-9)
