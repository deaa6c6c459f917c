"""Functions of frequency in files: listed, read, taken as measured responses by all that takes computed ones."""

from __future__ import annotations

import copy
import io

import h5py
import numpy as np
import pytest
import scipy.io

import api.schemas.frfs as schemas
from tests.integration.api.conftest import finished
from tests.integration.api.documents import sha256
from tests.integration.api.test_frfs import MASS, MODEL, W0, ZETA
from tests.integration.api.test_imports import imported

HZ = np.arange(4, 404) / 4  # 1 ... 100.75 Hz
JW = 2j * np.pi * HZ
RECEPTANCE = 1 / MASS / (JW**2 + 2 * ZETA * W0 * JW + W0**2)
COHERENCE = 0.9 + 0.1 * np.cos(HZ)


@pytest.fixture(scope="module")
def client(sqlite_service, sqlite_worker):
    with sqlite_service.client() as client:
        yield client


def dataset58(values, *, kind, double=True, uneven=False, binary=False, units=("mm", "kN"), axis=18):
    """Return one dataset 58 by the published format: every field in its columns."""
    is_complex = np.iscomplexobj(values)
    ordinate = (6 if double else 5) if is_complex else (4 if double else 2)
    head = [
        "a function", "NONE", "18-Apr-16 13:49:58", "NONE", "NONE",
        f"{kind:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{7:10d}{3:4d} {'NONE':10s}{2:10d}{-1:4d}",
        f"{ordinate:10d}{values.size:10d}{0 if uneven else 1:10d}{HZ[0]:13.5E}{HZ[1] - HZ[0]:13.5E}{0:13.5E}",
        f"{axis:10d}{0:5d}{0:5d}{0:5d} {'Frequency':20s} {'Hz':20s}",
        f"{8:10d}{0:5d}{0:5d}{0:5d} {'Response':20s} {units[0]:20s}",
        f"{13:10d}{0:5d}{0:5d}{0:5d} {'Force':20s} {units[1]:20s}",
        f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}",
    ]  # fmt: skip
    columns = [values.real, values.imag] if is_complex else [values]
    if binary:
        data = np.column_stack(columns).astype("<f8" if double else "<f4").tobytes()
        first = f"{58:6d}b{1:6d}{2:6d}{11:12d}{len(data):12d}" + f"{0:6d}{0:6d}{0:12d}{0:12d}"
        return "\n".join(["    -1", first, *head, ""]).encode() + data + b"\n    -1\n"
    width, digits = (20, 12) if double else (13, 5)
    points = ["".join(f"{one:{width}.{digits}E}" for one in point) for point in zip(*columns, strict=True)]
    if uneven:
        points = [f"{hz:13.5E}{point}" for hz, point in zip(HZ, points, strict=True)]
    each = 80 // len(points[0])
    lines = ["".join(points[i : i + each]) for i in range(0, len(points), each)]
    return "\n".join(["    -1", "    58", *head, *lines, "    -1", ""]).encode()


def measured(client, content, format_="uff"):
    dataset = imported(client, format_, content)
    assert dataset["status"] == "ready", dataset["error"]
    return dataset


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("double", [False, True])
def test_a_response_of_a_universal_file_is_the_one_that_was_written(client, double, uneven, binary):
    if uneven and binary:
        pytest.skip("abscissas in binary have no one layout")
    content = dataset58(RECEPTANCE * 1e6, kind=4, double=double, uneven=uneven, binary=binary)
    dataset = measured(client, content)
    (one,) = dataset["functions"]
    assert one == {
        "name": "7+Z over 2-X, frequency response", "kind": "frequency response", "response": "7+Z", "reference": "2-X",
        "response_unit": "mm", "reference_unit": "kN", "lines": 400,
    }  # fmt: skip
    assert (dataset["channels"], dataset["sample_count"], dataset["uneven"]) == ([], 0, False)
    found = client.get(f"/v1/datasets/{dataset['id']}/functions/{one['name']}").json()
    np.testing.assert_allclose(found["frequency"], 2 * np.pi * HZ, rtol=1e-5 if uneven else 1e-12)
    values = np.array(found["real"]) + 1j * np.array(found["imag"])
    np.testing.assert_allclose(values, RECEPTANCE * 1e6, rtol=1e-11 if double else 1e-5)


@pytest.fixture(scope="module")
def file(client):
    content = dataset58(RECEPTANCE * 1e6, kind=4) + dataset58(COHERENCE, kind=6, units=("NONE", "NONE"))
    content += dataset58(np.abs(RECEPTANCE) ** 2, kind=9) + dataset58(np.conj(RECEPTANCE), kind=3)
    return measured(client, content)["id"]


def test_a_measured_response_is_compared_with_a_model_and_has_modes(client, file):
    body = {
        "dataset": file, "estimator": "measured", "input": "2-X", "output": "7+Z", "system": MODEL,
        "from": "force", "to": "position", "modes": {}, "keep": True,
    }  # fmt: skip
    reply = client.post("/v1/frfs", json=body)
    assert reply.status_code == 200, reply.text
    found = schemas.FrfReply.model_validate(reply.json())
    one = found.outputs["7+Z"]
    assert (found.estimator, one.unit, found.input_unit) == ("measured", "m/N", "N")
    np.testing.assert_allclose(np.array(one.real) + 1j * np.array(one.imag), RECEPTANCE, rtol=1e-11)
    np.testing.assert_allclose(one.coherence, COHERENCE, rtol=1e-11)
    assert one.simulated.relative_error_percent < 1e-6
    (mode,) = found.modes.modes
    assert mode.frequency == pytest.approx(W0, rel=1e-6)
    assert mode.damping_ratio == pytest.approx(ZETA, rel=1e-5)
    kept = reply.json()
    again = client.get(f"/v1/frfs/{kept['id']}/uff")
    assert again.status_code == 200, again.text
    back = measured(client, again.content)
    assert [one["kind"] for one in back["functions"]] == ["frequency response", "coherence"]
    lineage = client.get(f"/v1/lineage/{kept['id']}").json()
    assert file in {node["id"] for node in lineage["nodes"]}


def _table():
    head = "Frequency [Hz];Re(tip/hammer) [mm/kN];Im(tip/hammer) [mm/kN];Coherence tip/hammer\n"
    rows = (
        f"{hz!r};{value.real!r};{value.imag!r};{coherence!r}\n"
        for hz, value, coherence in zip(HZ.tolist(), (RECEPTANCE * 1e6).tolist(), COHERENCE.tolist(), strict=True)
    )
    return (head + "".join(rows)).replace(".", ",").encode()


def _matlab():
    target = io.BytesIO()
    scipy.io.savemat(target, {"g": {"f": HZ, "H": RECEPTANCE, "coh": COHERENCE}})
    return target.getvalue()


def _hdf5():
    target = io.BytesIO()
    with h5py.File(target, "w") as file:
        file["run/omega"], file["run/H"], file["run/coherence"] = 2 * np.pi * HZ, RECEPTANCE, COHERENCE
        file["run/H"].attrs["unit"] = "mm/kN"
        file["run/H"][:] = RECEPTANCE * 1e6
    return target.getvalue()


def _touchstone():
    rows = (
        f"{hz!r} {value.real!r} {value.imag!r}\n" for hz, value in zip(HZ.tolist(), RECEPTANCE.tolist(), strict=True)
    )
    return ("# Hz S RI R 1\n" + "".join(rows)).encode()


OTHERS = {
    "csv": ("csv", _table, "hammer", "tip", True), "mat": ("mat", _matlab, "reference", "H", True),
    "hdf5": ("hdf5", _hdf5, "reference", "H", True), "touchstone": ("touchstone", _touchstone, "1", "1", False),
}  # fmt: skip


@pytest.mark.parametrize("kind", OTHERS)
def test_responses_of_other_files_are_taken_as_those_of_universal_ones(client, kind):
    format_, write, source, target, coherent = OTHERS[kind]
    dataset = measured(client, write(), format_)
    assert (dataset["channels"], dataset["sample_count"]) == ([], 0)
    one = next(one for one in dataset["functions"] if one["kind"] == "frequency response")
    assert (one["response"], one["reference"], one["lines"]) == (target, source, 400)
    scale = 1e6 if one["response_unit"] == "mm" else 1.0
    found = client.get(f"/v1/datasets/{dataset['id']}/functions/{one['name']}").json()
    np.testing.assert_allclose(found["frequency"], 2 * np.pi * HZ, rtol=1e-12)
    np.testing.assert_allclose(np.array(found["real"]) + 1j * np.array(found["imag"]), RECEPTANCE * scale, rtol=1e-12)
    body = {"dataset": dataset["id"], "estimator": "measured", "input": source, "output": target, "modes": {}}
    reply = client.post("/v1/frfs", json=body)
    assert reply.status_code == 200, reply.text
    output = reply.json()["outputs"][target]
    np.testing.assert_allclose(np.array(output["real"]) + 1j * np.array(output["imag"]), RECEPTANCE, rtol=1e-11)
    if coherent:
        np.testing.assert_allclose(output["coherence"], COHERENCE, rtol=1e-11)
    (mode,) = reply.json()["modes"]["modes"]
    assert mode["frequency"] == pytest.approx(W0, rel=1e-6)
    assert mode["damping_ratio"] == pytest.approx(ZETA, rel=1e-5)


def test_a_look_at_a_file_of_functions_shows_them(client):
    where = client.post("/v1/datasets", json={"name": "x", "file": "run.csv"}).headers["Location"]
    client.put(f"{where}/segments/{sha256(_table())}", content=_table())
    reply = client.post(f"{where}/preview", json={"segments": [sha256(_table())]})
    job = finished(client, reply.json()["job"])
    look = client.get(job["result"]).json()
    assert [one["kind"] for one in look["functions"]] == ["frequency response", "coherence"]
    assert look["import"] is None
    assert "the file holds functions of frequency and no channels" in look["remarks"][-1]


def test_a_band_and_another_form_of_a_measured_response(client, file):
    body = {
        "dataset": file, "estimator": "measured", "input": "2-X", "output": ["7+Z"], "form": "accelerance",
        "band": [{"value": 10, "unit": "Hz"}, {"value": 50, "unit": "Hz"}],
    }  # fmt: skip
    found = client.post("/v1/frfs", json=body).json()
    inside = (HZ >= 10) & (HZ <= 50)
    values = np.array(found["outputs"]["7+Z"]["real"]) + 1j * np.array(found["outputs"]["7+Z"]["imag"])
    np.testing.assert_allclose(values, (RECEPTANCE * JW**2)[inside], rtol=1e-10)


def test_what_a_file_does_not_hold_is_refused_with_what_it_holds(client, file):
    body = {"dataset": file, "estimator": "measured", "input": "2-X", "output": "8+Z"}
    reply = client.post("/v1/frfs", json=body)
    assert reply.status_code == 422
    assert "must be a response that the file holds ('7+Z' / '2-X'), got '8+Z' / '2-X'" in reply.text
    over_time = client.post("/v1/frfs", json=body | {"estimator": "H1"})
    assert (over_time.status_code, "estimator measured takes its responses" in over_time.text) == (409, True)
    assert client.get(f"/v1/datasets/{file}/functions/none").status_code == 404
    assert client.get(f"/v1/datasets/{file}/export", params={"format": "csv"}).status_code == 409
    sources = {"name": "x", "sources": [file], "steps": [{"kind": "resample", "rate": 10}]}
    assert client.post("/v1/processings", json=sources).status_code == 409


def test_an_unknown_unit_is_said(client):
    file = measured(client, dataset58(RECEPTANCE, kind=4, units=("blurbs", "NONE")))["id"]
    found = client.post("/v1/frfs", json={"dataset": file, "estimator": "measured", "input": "2-X", "output": "7+Z"})
    assert "the unit 'blurbs' of the file is not known" in found.json()["warnings"][0]["detail"]


def test_a_cut_file_is_refused(client):
    bad = imported(client, "uff", dataset58(RECEPTANCE, kind=4)[:-200])
    assert bad["status"] == "failed"
    assert "cut off" in bad["error"]["detail"]


def test_a_measured_response_identifies_a_model(client, file):
    asked = {"dataset": file, "estimator": "measured", "input": "2-X", "output": "7+Z", "keep": True}
    kept = client.post("/v1/frfs", json=asked).json()["id"]
    started = copy.deepcopy(MODEL)
    started["parameters"] = {
        "m": {"value": 1.05 * MASS, "lower": 0.1 * MASS, "upper": 10 * MASS, "scale": "log"},
        "k": {"value": 0.98 * MASS * W0**2, "lower": 0.1 * MASS * W0**2, "upper": 10 * MASS * W0**2, "scale": "log"},
    }
    started["blocks"]["body"] |= {"mass": "=m", "stiffness": "=k"}
    experiment = {"inputs": {"force": "2-X"}, "outputs": {"position": "7+Z"}, "weights": "equal"}
    for source in ({"frf": kept}, {"dataset": file, "estimator": "measured"}):
        body = {"system": started, "parameters": ["m", "k"], "frequency_responses": [experiment | source]}
        reply = client.post("/v1/identifications", json=body)
        assert reply.status_code == 202, reply.text
        job = finished(client, reply.json())
        assert job["status"] == "succeeded", job["error"]
        found = client.get(job["result"]).json()["parameters"]
        assert found["m"]["value"] == pytest.approx(MASS, rel=1e-6)
        assert found["k"]["value"] == pytest.approx(MASS * W0**2, rel=1e-6)
