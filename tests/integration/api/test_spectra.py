"""/v1/spectra: exact transforms, waterfalls, estimates of simulated outputs and of recordings, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from api.schemas.spectra import SpectrumReply
from tests.integration.api.documents import RAW, upload

W0, ZETA = 20.0, 0.05
ARM = {
    "name": "Flexible arm",
    "blocks": {
        "drive": {"kind": "input"},
        "arm": {"kind": "transfer_function", "numerator": [W0**2], "denominator": [1, 2 * ZETA * W0, W0**2]},
        "speed": {"kind": "transfer_function", "numerator": [W0**2, 0], "denominator": [1, 2 * ZETA * W0, W0**2]},
    },
    "connections": [{"from": "drive", "to": "arm"}, {"from": "drive", "to": "speed"}],
    "outputs": {"position": "arm", "velocity": "speed"},
}
STEP = {"port": "drive", "signal": {"kind": "step"}}
DELAYED = {"port": "drive", "signal": {"kind": "programmed_delay", "delay": 0.1, "command": {"kind": "step"}}}
SINE = {"port": "drive", "signal": {"kind": "sine", "frequency": 10.0}}


def spectra(client, **fields):
    return client.post("/v1/spectra", json={"system": ARM, "input": STEP, "output": "velocity"} | fields)


def good(reply):
    assert reply.status_code == 200, reply.text
    SpectrumReply.model_validate(reply.json())
    return reply.json()


def path(w):
    w = np.asarray(w)
    return W0**2 / (W0**2 - w**2 + 2j * ZETA * W0 * w)


def test_the_transform_of_a_step_is_the_path_itself(client) -> None:
    body = good(spectra(client, quantity="transform", frequencies=[1, {"value": 3, "unit": "Hz"}, 50]))
    (variant,) = body["variants"]
    assert (body["quantity"], body["unit"], body["window"]) == ("transform", "s", None)
    assert variant["frequency"] == pytest.approx([1, 6 * math.pi, 50])
    # velocity of a unit step: jω · path / (jω)
    assert variant["value"] == pytest.approx(np.abs(path(variant["frequency"])), rel=1e-9)
    assert np.exp(1j * np.array(variant["phase"])) == pytest.approx(np.exp(1j * np.angle(path([1, 6 * math.pi, 50]))))


def test_frequencies_are_chosen_around_what_moves(client) -> None:
    (variant,) = good(spectra(client, quantity="transform"))["variants"]
    peak = variant["frequency"][int(np.argmax(variant["value"]))]
    assert peak == pytest.approx(W0, rel=0.1)
    assert variant["value"][-1] < 1e-4 * max(variant["value"])


def test_a_waterfall_is_one_variant_for_each_delay(client) -> None:
    half = math.pi / (W0 * math.sqrt(1 - ZETA**2))
    variants = [{"signals.drive.delay": delay} for delay in (0, {"value": 50, "unit": "ms"}, half)]
    body = good(
        spectra(client, input=DELAYED, quantity="transform", frequencies=[5, W0, 40], variants=variants, band=[19, 21])
    )
    assert [variant["parameters"] for variant in body["variants"]] == variants
    for variant, delay in zip(body["variants"], (0.0, 0.05, half), strict=True):
        w = np.array(variant["frequency"])
        assert variant["value"] == pytest.approx(np.abs(path(w) * np.cos(w * delay / 2)), abs=1e-9)
        assert variant["band"]["unit"] == "s"
    energies = [variant["band"]["value"] for variant in body["variants"]]
    assert energies[0] > energies[1] > 100 * energies[2]


def test_simulations_vary_commands_the_same_way(client) -> None:
    body = {"system": ARM, "input": DELAYED, "outputs": ["position"], "metrics": ["residual_vibration"], "samples": 5}
    half = math.pi / (W0 * math.sqrt(1 - ZETA**2))
    variants = [{"signals.drive.delay": 0}, {"signals.drive.delay": half, "signals.drive.command.amplitude": 2}]
    reply = client.post("/v1/simulations", json=body | {"variants": variants})
    assert reply.status_code == 200, reply.text
    plain, shaped = (v["metrics"]["position"]["residual_vibration"]["value"] for v in reply.json()["variants"])
    # K = exp(-πζ/√(1-ζ²)): the plain step swings from 0 to 1 + K; each half of the delayed one is a step of 1, and their
    # swings K and -1 add up: from 2 - (1 - K) to 2 + (1 - K) K
    k = math.exp(-math.pi * ZETA / math.sqrt(1 - ZETA**2))
    assert plain == pytest.approx((1 + k) / 2, rel=1e-9)
    assert shaped == pytest.approx((1 - k**2) / 2, rel=1e-9)


def test_amplitudes_and_harmonics_of_a_simulated_steady_state(client) -> None:
    fields = {"fundamental": 10, "orders": 3, "duration": 40 * math.pi, "part": [20 * math.pi, 40 * math.pi]}
    body = good(spectra(client, input=SINE, output="position", samples=8192, **fields))
    (variant,) = body["variants"]
    gain = abs(path(10.0))
    assert (body["unit"], body["window"]["kind"], variant["averages"]) == ("1", "flat_top", 1)
    assert max(variant["value"]) == pytest.approx(gain, rel=1e-6)
    assert variant["harmonics"]["amplitude"] == pytest.approx([gain, 0, 0], abs=1e-9)
    assert variant["harmonics"]["thd"] == pytest.approx(0, abs=1e-9)


def test_a_density_has_the_mean_square_of_the_movement(client) -> None:
    body = good(
        spectra(client, input=SINE, output="position", duration=40 * math.pi, part=[20 * math.pi, 40 * math.pi],
                quantity="density", window="none", samples=8192, band=[9, 11])
    )  # fmt: skip
    assert body["unit"] == "1/Hz"
    assert body["variants"][0]["band"] == {"value": pytest.approx(abs(path(10.0)) ** 2 / 2, rel=1e-6), "unit": "1"}


def test_an_output_that_does_not_settle_says_so(client) -> None:
    unstable = ARM | {
        "blocks": ARM["blocks"] | {"arm": {"kind": "transfer_function", "numerator": [1], "denominator": [1, "=k"]}},
        "parameters": {"k": {"value": -1.0}},
    }
    body = good(spectra(client, system=unstable, output="position", quantity="transform", variants=[{}, {"k": 1.0}]))
    assert [variant["verdict"] for variant in body["variants"]] == ["unstable", "ok"]
    assert body["variants"][0]["value"] == []


def test_a_kept_spectrum_can_be_read_again(client) -> None:
    reply = spectra(client, quantity="transform", frequencies=[1.0], keep=True)
    kept = client.get(f"/v1/results/{reply.json()['id']}").json()
    assert kept["kind"] == "spectrum"
    assert kept["result"]["variants"][0]["frequency"] == [1.0]


def test_a_recording_is_analysed_in_its_unit(client) -> None:
    rate = 1000.0
    t = np.arange(2000) / rate
    values = 3.0 * np.cos(2 * np.pi * 50 * t) + 0.5 * np.cos(2 * np.pi * 100 * t + 1)
    channel = {"name": "vibration", "quantity": "displacement", "unit": "mm"}
    stored = upload(client, RAW | {"name": "vibration", "channels": [channel]}, values.astype("<f8").tobytes())
    dataset = stored.json()["id"]
    reply = client.post(
        "/v1/spectra",
        json={
            "dataset": dataset, "channel": "vibration", "fundamental": {"value": 50, "unit": "Hz"}, "orders": 2,
            "segment": {"value": 500, "unit": "ms"}, "band": [{"value": 90, "unit": "Hz"}, {"value": 110, "unit": "Hz"}],
        },
    )  # fmt: skip
    body = good(reply)
    (variant,) = body["variants"]
    assert (body["unit"], variant["averages"], body["system"]) == ("m", 7, None)
    assert max(variant["value"]) == pytest.approx(3e-3, rel=1e-6)
    assert variant["frequency"][int(np.argmax(variant["value"]))] == pytest.approx(100 * math.pi)
    assert variant["harmonics"]["amplitude"] == pytest.approx([3e-3, 0.5e-3], rel=1e-9)
    assert variant["harmonics"]["phase"] == pytest.approx([0, 1], abs=1e-9)
    assert variant["band"] == {"value": pytest.approx(0.125e-6, rel=1e-3), "unit": "m**2"}


@pytest.mark.parametrize(
    ("fields", "pointer", "detail"),
    [
        ({"output": "speed"}, "/output", "output must be one of the system's outputs"),
        ({"input": DELAYED | {"port": "motor"}}, "/input/port", "port must be one of"),
        ({"dataset": "dat_x"}, "", "must have either system, input and output, or dataset and channel"),
        ({"quantity": "transform", "input": SINE}, "/input", "got one that goes on for ever"),
        ({"quantity": "transform", "fundamental": 1}, "", "fundamental must be left out"),
        ({"segment": 1e9}, "/segment", "segment must be 8 to 4096 samples"),
        ({"fundamental": -1}, "/fundamental", "fundamental must be > 0 rad/s"),
        ({"band": [3, 2]}, "/band", "low < high"),
        ({"quantity": "transform", "output": "position", "band": [0, 2]}, "/band/0", "band must begin above 0"),
        ({"variants": [{"signals.drive.delay": 1}]}, "/variants/0/signals.drive.delay", "parameter of step must be one"),
        ({"input": DELAYED, "variants": [{"signals.drive.delay": -1}]}, "/variants/0/signals.drive.delay", ">= 0 s"),
        ({"variants": [{"signals.motor.start": 1}]}, "/variants/0/signals.motor.start", "port must be one of"),
        ({"input": DELAYED, "variants": [{"signals.drive.delay": {"value": 1, "unit": "m"}}]},
         "/variants/0/signals.drive.delay", "s"),
    ],
)  # fmt: skip
def test_refuses(client, fields, pointer, detail) -> None:
    reply = spectra(client, **fields)
    assert reply.status_code == 422, reply.text
    (error,) = reply.json()["errors"]
    assert error["pointer"] == pointer
    assert detail in error["detail"]
