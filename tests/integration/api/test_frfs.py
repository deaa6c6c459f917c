"""/v1/frfs: a resonance that is known, a real recording, what is held against a measurement, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from scipy import signal

import servotune
from api.schemas.frfs import FrfReply
from api.services.frequency import measured_parts
from tests.integration.api.conftest import Service
from tests.integration.api.documents import RAW, upload

HZ = 2 * np.pi
RATE = 1024.0
W0, ZETA, MASS = HZ * 40, 0.03, 2.0
EXAMPLE = Path(__file__).parents[3] / "examples" / "data" / "servo_hydraulic_actuator"
CHANNELS = [
    {"name": "force", "quantity": "force", "unit": "kN"},
    {"name": "acceleration", "quantity": "acceleration", "unit": "m/s**2"},
    {"name": "displacement", "quantity": "displacement", "unit": "mm"},
    {"name": "still", "unit": "V"},
]
#: A mass on a spring: displacement and acceleration by a force.
MODEL: dict[str, Any] = {
    "name": "mass on a spring",
    "blocks": {
        "force": {"kind": "input"},
        "body": {
            "kind": "mass_spring_damper", "mass": MASS, "stiffness": MASS * W0**2, "damping": 2 * ZETA * W0 * MASS,
        },
    },
    "connections": [{"from": "force", "to": "body"}],
    "outputs": {"position": "body.position", "acceleration": "body.acceleration"},
}  # fmt: skip


@pytest.fixture(scope="module")
def client(sqlite_service: Service) -> Iterator[httpx.Client]:
    with sqlite_service.client() as client:
        yield client


def stored(client: httpx.Client, force: np.ndarray, noise: float = 0.02, seed: int = 1) -> str:
    """Upload a shaken mass on a spring, each response with independent noise."""
    rng = np.random.default_rng(seed)
    columns = [force / 1000]
    for numerator, scale in (([1 / MASS, 0, 0], 1.0), ([1 / MASS], 1000.0)):
        # held force: what a system sees between two samples of a converter
        b, a, _ = signal.cont2discrete((numerator, [1.0, 2 * ZETA * W0, W0**2]), 1 / RATE, method="foh")
        response = signal.lfilter(b.ravel(), a, force) * scale
        columns.append(response + noise * response.std() * rng.standard_normal(force.size))
    columns.append(np.full(force.size, 3.0))
    body = RAW | {"name": "shaker", "sample_rate": RATE, "channels": CHANNELS}
    reply = upload(client, body, np.column_stack(columns).astype("<f8").tobytes(), segment=320_000)
    assert reply.status_code == 200, reply.text
    return str(reply.json()["id"])


@pytest.fixture(scope="module")
def shaken(client: httpx.Client) -> str:
    b, a = signal.butter(4, 0.4)  # force below 200 Hz: what a converter holds is known well there
    force = 50 * signal.lfilter(b, a, np.random.default_rng(2).standard_normal(int(RATE) * 60))
    return stored(client, force)


def ask(client: httpx.Client, dataset: str, /, **fields: Any) -> httpx.Response:
    body = {"dataset": dataset, "input": "force", "output": "acceleration"} | fields
    return client.post("/v1/frfs", json=body)


def good(reply: httpx.Response) -> dict[str, Any]:
    assert reply.status_code == 200, reply.text
    FrfReply.model_validate_json(reply.content)
    return dict(reply.json())


def truth(w: np.ndarray, power: int) -> np.ndarray:
    return (1j * w) ** power / (MASS * (W0**2 - w**2 + 2j * ZETA * W0 * w))


BAND = {"band": [{"value": 5, "unit": "Hz"}, {"value": 150, "unit": "Hz"}], "segment": 8}


@pytest.mark.parametrize(
    "case",
    [
        ("acceleration", None, 2, "m/s**2/N"),
        ("acceleration", "receptance", 0, "m/N"),
        ("displacement", "mobility", 1, "m/s/N"),
        ("displacement", "accelerance", 2, "m/s**2/N"),
    ],
)
def test_a_known_response_lies_in_the_bands(client, shaken, case) -> None:
    output, form, power, unit = case
    body = good(ask(client, shaken, output=output, **({"form": form} if form else {}), **BAND))
    found = body["outputs"][output]
    assert found["unit"] == unit
    expected = np.abs(truth(np.array(body["frequency"]), power))
    lower, upper = np.array(found["magnitude_lower"]), np.array(found["magnitude_upper"])
    away = np.abs(np.array(found["magnitude"]) / expected - 1)
    assert np.median(away) < 0.02
    # half of a percent of bias by resolution counts where the random error is smaller than that
    assert np.mean((lower < expected * 1.005) & (expected * 0.995 < upper)) > 0.9
    assert body["averages"] == 14
    assert np.median(found["coherence"]) > 0.9
    assert body["warnings"] == []


def test_modes_are_those_of_the_mass_on_the_spring(client, shaken) -> None:
    body = good(ask(client, shaken, output=["acceleration", "displacement"], modes={}, **BAND))
    (mode,) = body["modes"]["modes"]
    assert body["modes"]["form"] == "receptance"
    assert mode["frequency_lower"] * 0.9995 < W0 < mode["frequency_upper"] * 1.0005
    assert mode["damping_ratio_lower"] < ZETA * 1.02
    assert mode["damping_ratio_upper"] > ZETA
    assert mode["residues"]["displacement"]["imag"] == pytest.approx(
        -1 / (2 * MASS * W0 * np.sqrt(1 - ZETA**2)), rel=0.02
    )


def test_a_model_is_held_against_the_measurement(client, shaken) -> None:
    path = {"system": MODEL, "from": "force", "form": "receptance", **BAND}
    right = good(ask(client, shaken, to="position", **path))["outputs"]["acceleration"]["simulated"]
    assert right["median_deviation_db"] < 0.2
    assert right["relative_error_percent"] < 5
    assert right["within_percent"] > 85
    heavy = {"parameters": {"body.mass": {"value": 2.5, "unit": "kg"}}}
    wrong = good(ask(client, shaken, to="position", **path, **heavy))["outputs"]["acceleration"]["simulated"]
    assert wrong["relative_error_percent"] > 50
    assert wrong["worst_frequency"] == pytest.approx(W0, rel=0.2)
    refused = ask(client, shaken, to="acceleration", **path)
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/to"


def test_coarse_lines_are_warned_about(client, shaken) -> None:
    body = good(ask(client, shaken, segment=0.5))
    (warning,) = body["warnings"]
    assert warning["pointer"] == "/segment"
    assert "the resonance at 40 Hz" in warning["detail"]
    assert body["outputs"]["acceleration"]["doubts"][0]["kind"] == "resonance_bias"


def test_a_multisine_and_stepped_sines(client) -> None:
    period = int(RATE) * 2
    lines = np.zeros(period // 2 + 1, dtype=complex)
    lines[10:300] = np.exp(2j * np.pi * np.random.default_rng(3).random(290))
    multisine = stored(client, np.tile(np.fft.irfft(lines) * period, 8), noise=0.0)
    body = good(ask(client, multisine, output="displacement", estimator="multisine", period=2, settle=4))
    w = np.array(body["frequency"])
    assert w == pytest.approx(HZ * np.arange(10, 300) / 2)
    found = np.array(body["outputs"]["displacement"]["real"]) + 1j * np.array(body["outputs"]["displacement"]["imag"])
    low = w < HZ * 80  # above, lines between samples of the force count
    assert found[low] == pytest.approx(truth(w, 0)[low], rel=0.02)
    assert body["averages"] == 6
    time = np.arange(int(RATE) * 3) / RATE
    sines = stored(client, np.concatenate([10 * np.sin(HZ * f * time) for f in (20, 40)]), noise=0.0)
    steps = [{"frequency": {"value": f, "unit": "Hz"}, "start": s, "end": s + 3} for f, s in ((20, 0), (40, 3))]
    stepped = good(ask(client, sines, output="displacement", estimator="stepped_sine", steps=steps, settle=2))
    assert stepped["frequency"] == pytest.approx([HZ * 20, HZ * 40])
    assert stepped["outputs"]["displacement"]["magnitude"] == pytest.approx(
        np.abs(truth(HZ * np.array([20, 40.0]), 0)), rel=0.01
    )


def test_sensors_are_taken_back(client, shaken) -> None:
    plain = good(ask(client, shaken, **BAND))
    sensor = {"delay": {"value": 1, "unit": "ms"}, "frequency": [10, 1e4], "magnitude": [2, 2]}
    body = good(ask(client, shaken, corrections={"acceleration": sensor}, **BAND))
    before, after = plain["outputs"]["acceleration"], body["outputs"]["acceleration"]
    assert after["magnitude"] == pytest.approx(np.array(before["magnitude"]) / 2)
    turned = np.array(after["phase"]) - np.array(before["phase"]) - np.array(body["frequency"]) * 1e-3
    assert np.exp(1j * turned) == pytest.approx(np.ones(turned.size))


def test_the_servo_hydraulic_actuator_at_five_hertz(client) -> None:
    # measured: gain 0.825, phase -42.6 degrees (the recording's own description)
    layout = json.loads((EXAMPLE / "import.json").read_text())
    lines = (EXAMPLE / "0A.txt").read_text().splitlines()[layout["header_lines"] :]
    samples = np.array([[float(line.split(",")[i]) for i in (2, 4)] for line in lines])
    channels = [{"name": "position", "unit": "mm", "scale": 10}, {"name": "command", "unit": "mm", "scale": 10}]
    reply = upload(client, RAW | {"channels": channels}, samples.astype("<f8").tobytes(), segment=320_000)
    body = good(
        ask(client, reply.json()["id"], input="command", output="position", segment=8,
            band=[{"value": 4.9, "unit": "Hz"}, {"value": 5.1, "unit": "Hz"}])
    )  # fmt: skip
    found = body["outputs"]["position"]
    line = int(np.argmin(np.abs(np.array(body["frequency"]) - HZ * 5)))
    assert found["unit"] == "1"
    assert found["magnitude"][line] == pytest.approx(0.825, abs=0.002)
    assert np.degrees(found["phase"][line]) == pytest.approx(-42.6, abs=0.1)
    assert found["magnitude_lower"][line] < 0.825 < found["magnitude_upper"][line]


def test_a_merged_recording_is_averaged_without_its_joint(client, shaken) -> None:
    both = client.post("/v1/processings", json={"name": "both", "sources": [shaken, shaken]}).json()["id"]
    once, twice = good(ask(client, shaken, segment=8)), good(ask(client, both, segment=8))
    assert twice["averages"] == 2 * once["averages"]
    assert twice["outputs"]["acceleration"]["magnitude"] == pytest.approx(once["outputs"]["acceleration"]["magnitude"])
    spectrum = client.post("/v1/spectra", json={"dataset": both, "channel": "force", "segment": 8}).json()
    assert spectrum["variants"][0]["averages"] == 2 * 14
    split = ask(client, both, estimator="multisine", period=1)
    assert split.json()["errors"][0]["detail"] == "part must lie in one experiment for multisine, got 2 of them"


def test_a_gap_outside_of_the_part_does_not_matter(client, monkeypatch) -> None:
    force = np.random.default_rng(4).standard_normal(4000)
    force[3500] = np.nan
    channels = [{"name": "force", "unit": "N"}, {"name": "acceleration", "unit": "m/s**2"}]
    samples = np.column_stack([force, 2 * np.nan_to_num(force)]).astype("<f8").tobytes()
    dataset = upload(client, RAW | {"sample_rate": 1000, "channels": channels}, samples).json()["id"]
    assert good(ask(client, dataset, part=[0, 3]))["outputs"]["acceleration"]["magnitude"][20] == pytest.approx(2)
    refused = ask(client, dataset).json()["errors"][0]
    assert refused["pointer"] == "/input"
    assert refused["detail"].endswith("got one at 3.5 s")
    monkeypatch.setattr(measured_parts, "MOST_NUMBERS", 4000)
    assert ask(client, dataset, part=[0, 2]).status_code == 200
    long = ask(client, dataset, part=[0, 3]).json()["errors"][0]
    assert long["pointer"] == "/part"
    assert "part must hold at most 2000 samples of 2 channels, got 3000" in long["detail"]


def test_a_kept_response_leaves_as_a_universal_file(client, shaken) -> None:
    body = good(ask(client, shaken, output=["displacement", "acceleration"], keep=True, **BAND))
    reply = client.get(f"/v1/frfs/{body['id']}/uff")
    assert reply.headers["Content-Type"].startswith("text/plain")
    blocks = reply.text.split("    -1\n    58\n")[1:]
    assert len(blocks) == 4  # two responses, each with its coherence
    lines = blocks[0].splitlines()
    function, _, count, _, start, step = (*lines[5].split()[:2], *lines[6].split()[1:5])
    assert function == "4"  # a frequency response
    assert int(count) == len(body["frequency"])
    assert float(start) == pytest.approx(body["frequency"][0] / HZ, rel=1e-5)
    assert float(step) == pytest.approx(1 / 8, rel=1e-5)
    numbers = np.array(" ".join(lines[11:-1]).split(), dtype=float)
    found = body["outputs"]["displacement"]
    assert numbers[0::2] == pytest.approx(found["real"], rel=1e-11)
    assert numbers[1::2] == pytest.approx(found["imag"], rel=1e-11)
    assert lines[8].split()[0] == "8"  # displacement
    assert "displacement" in lines[8]
    assert lines[9].split()[0] == "13"  # force
    simulation = client.post(
        "/v1/simulations",
        json={"system": MODEL, "input": {"port": "force", "signal": {"kind": "step"}}, "keep": True, "duration": 1},
    )
    assert client.get(f"/v1/frfs/{simulation.json()['id']}/uff").status_code == 404


def test_uneven_lines_do_not_leave_as_a_universal_file(client) -> None:
    time = np.arange(int(RATE)) / RATE
    sines = stored(client, np.concatenate([np.sin(HZ * f * time) for f in (10, 20, 50)]), noise=0.0)
    steps = [{"frequency": HZ * f, "start": s, "end": s + 1} for f, s in ((10, 0), (20, 1), (50, 2))]
    body = good(ask(client, sines, estimator="stepped_sine", steps=steps, keep=True))
    reply = client.get(f"/v1/frfs/{body['id']}/uff")
    assert reply.status_code == 409
    assert "evenly spaced" in reply.json()["detail"]


def test_a_kept_response_can_be_read_again(client, shaken) -> None:
    identifier = good(ask(client, shaken, keep=True, **BAND))["id"]
    kept = client.get(f"/v1/results/{identifier}").json()
    assert kept["kind"] == "frf"
    assert kept["request"]["dataset"] == shaken


def test_a_script_filters_a_recording_and_measures_its_response(sqlite_service, shaken) -> None:
    with servotune.connect(sqlite_service.url, key=sqlite_service.keys["admin"]) as client:
        made = client.process(shaken, [{"kind": "decimate", "factor": 2}], name="slower")
        assert made["sample_rate"] == 512
        found = client.frf(
            made["id"], input="force", output="displacement", segment=8, band=[HZ * 20, HZ * 60], modes={}, keep=True
        )
        assert found["outputs"]["displacement"]["unit"] == "m/N"
        assert found["modes"] is not None
        assert found["modes"]["modes"][0]["frequency"] == pytest.approx(W0, rel=1e-3)
        assert client.universal_file(found["id"]).startswith(b"    -1\n    58\n")


def test_a_measured_response_is_traced_to_its_samples_and_repeats(sqlite_service, shaken, tmp_path) -> None:
    with (
        sqlite_service.client() as raw,
        servotune.connect(sqlite_service.url, key=sqlite_service.keys["admin"]) as client,
    ):
        made = client.process(shaken, [{"kind": "cut", "end": 20}, {"kind": "decimate", "factor": 2}])
        kept = good(ask(raw, made["id"], segment=4, keep=True))["id"]
        edges = {(edge["from"], edge["to"]) for edge in client.lineage.get(kept, direction="up")["edges"]}
        assert {(made["id"], kept), (shaken, made["id"])} <= edges
        again = client.lineage.repeat(client.lineage.export(kept, tmp_path / "frf.zip"))
    assert {each.id: each.note for each in again} == {shaken: "", made["id"]: "", kept: ""}
    assert max(each.largest for each in again) == 0


@pytest.mark.parametrize(
    ("fields", "pointer", "detail"),
    [
        ({"dataset": "ds_none"}, "/dataset", "dataset must be one that exists"),
        ({"output": "speed"}, "/output", "channel must be one of the dataset's (force, acceleration, displacement, still)"),
        ({"output": ["acceleration", "speed"]}, "/output/1", "channel must be one of the dataset's"),
        ({"output": ["acceleration", "acceleration"]}, "/output", "output must name each channel once"),
        ({"output": "still"}, "/output", "output must change, got a constant channel"),
        ({"input": "still"}, "/input", "input must change, got a constant channel"),
        ({"segment": 100}, "/segment", "segment must be 8 to 61440 samples (60 s, the recording), got 102400 (100 s)"),
        ({"segment": {"value": 1, "unit": "m"}}, "/segment", "segment must be in s, got 'm'"),
        ({"band": [{"value": 600, "unit": "Hz"}, {"value": 700, "unit": "Hz"}]}, "/band", "band must hold lines of"),
        ({"part": [70, 80]}, "/part/0", "part must begin within the recording"),
        ({"part": [0, 0.005]}, "/segment", "segment must be 8 to 5 samples"),
        ({"output": "force", "form": "mobility"}, "/form", "output must be a displacement, velocity or acceleration"),
        ({"estimator": "H3"}, "/estimator", "estimator"),
        ({"estimator": "multisine"}, "", "must have period with the estimator multisine, and only with it"),
        ({"estimator": "multisine", "period": 0.0301}, "/period", "period must be a whole number"),
        ({"estimator": "multisine", "period": 1}, "/period", "input must repeat with the period of 1 s"),
        ({"estimator": "stepped_sine", "steps": [{"frequency": 1e5, "start": 0, "end": 1}]}, "/steps/0/frequency",
         "frequency must be > 0 and < 3216.99 rad/s (half the sample rate), got 100000"),
        ({"corrections": {"other": {}}}, "/corrections/other", "corrections must be of channels used here"),
        ({"corrections": {"force": {"frequency": [1, 2], "magnitude": [1, 1]}}}, "/corrections/force/frequency",
         "the calibration must cover all lines"),
        ({"corrections": {"force": {"magnitude": [1, 1]}}}, "/corrections/force", "must have frequency together with"),
        ({"system": MODEL, "from": "force"}, "", "must have system, from and to together"),
        ({"system": MODEL, "from": "torque", "to": "position"}, "/from", "from must be one of the system's inputs"),
        ({"modes": {"band": [1, 2]}}, "/modes/band", "band must hold at least 12 lines to find modes, got 1"),
        ({"modes": {"count": 20}, **BAND}, "/modes/count", "count must be <="),
    ],
)  # fmt: skip
def test_refuses(client, shaken, fields, pointer, detail) -> None:
    reply = ask(client, shaken, **fields)
    assert reply.status_code == 422, reply.text
    (error,) = reply.json()["errors"]
    assert error["pointer"] == pointer
    assert detail in error["detail"]


def test_a_model_answers_from_sample_to_sample_where_its_input_is_held(client) -> None:
    """A mass on a spring shaken by a converter that holds a new force at every sample, up to half the sample rate."""
    force = 50 * np.random.default_rng(6).standard_normal(int(RATE) * 40)
    b, a, _ = signal.cont2discrete(([1 / MASS], [1.0, 2 * ZETA * W0, W0**2]), 1 / RATE)
    columns = [force / 1000, 0 * force, signal.lfilter(b.ravel(), a, force) * 1000, 0 * force]
    body = RAW | {"name": "held", "sample_rate": RATE, "channels": CHANNELS}
    dataset = upload(client, body, np.column_stack(columns).astype("<f8").tobytes(), segment=320_000).json()["id"]
    path = {"system": MODEL, "from": "force", "to": "position", "output": "displacement", "segment": 8}
    path["band"] = [{"value": 60, "unit": "Hz"}, {"value": 0.45 * RATE, "unit": "Hz"}]
    found = good(ask(client, dataset, **path))
    simulated = found["outputs"]["displacement"]["simulated"]
    assert simulated["between_samples"]["chosen"] == "hold"
    tried = simulated["between_samples"]["tried"]
    assert tried["hold"] == simulated["relative_error_percent"] < 1
    assert tried["band_limited"] > 20 * tried["hold"]
    z = np.exp(1j * np.array(found["frequency"]) / RATE)
    expected = np.polyval(b.ravel(), z) / np.polyval(a, z)
    assert simulated["magnitude"] == pytest.approx(np.abs(expected), rel=1e-6)
    said = good(ask(client, dataset, **path, between_samples="band_limited"))["outputs"]["displacement"]["simulated"]
    assert said["between_samples"] == {"chosen": "band_limited", "tried": {"band_limited": tried["band_limited"]}}
    blocks = MODEL["blocks"] | {"own": {"kind": "zero_order_hold", "sample_time": 1 / RATE}}
    links = [{"from": "force", "to": "own"}, {"from": "own", "to": "body"}]
    sampling = path | {"system": MODEL | {"blocks": blocks, "connections": links}}
    refused = ask(client, dataset, **sampling, between_samples="hold")
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["pointer"] == "/between_samples"
    own = good(ask(client, dataset, **sampling))["outputs"]["displacement"]["simulated"]
    assert set(own["between_samples"]["tried"]) == {"band_limited"}
    refused = ask(client, dataset, **path, form="receptance", between_samples="hold")
    assert refused.status_code == 422
    assert "between_samples band_limited" in refused.json()["errors"][0]["detail"]
