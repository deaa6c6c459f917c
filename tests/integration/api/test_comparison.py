"""Comparative analysis as a user's script does it: one request, one motor, three armature resistances."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import servotune
from tests.integration.api.conftest import Service

#: The comparison of the paper's Fig. 4, ohm.
RESISTANCES = (0.33, 0.5, 0.8)
INDUCTANCE, TORQUE, EMF, INERTIA, FRICTION = 1e-3, 0.2, 0.2, 2e-3, 1e-3

MOTOR: dict[str, Any] = {
    "name": "DC motor on a voltage",
    "parameters": {"r_a": {"value": 0.5, "unit": "ohm", "lower": 0.1, "upper": 2}},
    "blocks": {
        "voltage": {"kind": "input"},
        "load": {"kind": "input", "role": "disturbance"},
        "motor": {
            "kind": "dc_motor",
            "resistance": "=r_a",
            "inductance": {"value": 1, "unit": "mH"},
            "torque_constant": TORQUE,
            "back_emf_constant": EMF,
            "inertia": INERTIA,
            "viscous_friction": FRICTION,
        },
    },
    "connections": [{"from": "voltage", "to": "motor.voltage"}, {"from": "load", "to": "motor.load_torque"}],
    "outputs": {"speed": "motor.speed", "current": "motor.current"},
}
STEP = {"port": "voltage", "signal": {"kind": "step", "amplitude": 24}}
VARIANTS = [{"r_a": resistance} for resistance in RESISTANCES]


@pytest.fixture(scope="module")
def script(service: Service) -> Iterator[servotune.Client]:
    with servotune.connect(service.url, key=service.keys["run"]) as connected:
        yield connected


def denominator(resistance: float) -> list[float]:
    # L J s² + (R J + L b) s + R b + K_t K_e, from u = R i + L i' + K_e ω and J ω' = K_t i - b ω
    return [
        INDUCTANCE * INERTIA,
        resistance * INERTIA + INDUCTANCE * FRICTION,
        resistance * FRICTION + TORQUE * EMF,
    ]


def speed_after(resistance: float, time: np.ndarray) -> np.ndarray:
    """The step response of two real poles, by partial fractions."""
    p, q = np.roots(denominator(resistance)).real
    final = 24 * TORQUE / denominator(resistance)[2]
    return final * (1 + (q * np.exp(p * time) - p * np.exp(q * time)) / (p - q))


def test_all_variants_come_together_in_order(script: servotune.Client) -> None:
    reply = script.simulate(MOTOR, input=STEP, variants=VARIANTS, duration=0.4, samples=101)
    assert [variant["parameters"] for variant in reply["variants"]] == VARIANTS
    # The motor as a whole turns on and on: its angle integrates. The outputs settle.
    assert {variant["verdict"] for variant in reply["variants"]} == {"integrating"}
    assert {variant["metrics"]["speed"]["settling_time"]["verdict"] for variant in reply["variants"]} == {"ok"}
    for resistance, variant in zip(RESISTANCES, reply["variants"], strict=True):
        exact = speed_after(resistance, np.array(variant["time"]))
        np.testing.assert_allclose(variant["outputs"]["speed"], exact, atol=1e-10 * exact.max())
    times = [variant["time"] for variant in reply["variants"]]
    assert times[0] == times[1] == times[2]


def test_metrics_tell_the_variants_apart(script: servotune.Client) -> None:
    reply = script.simulate(MOTOR, input=STEP, variants=VARIANTS, metrics=["rise_time", "peak"])
    rise = [variant["metrics"]["speed"]["rise_time"]["value"] for variant in reply["variants"]]
    for resistance, found in zip(RESISTANCES, rise, strict=True):
        time = np.linspace(0, 0.5, 200_001)
        share = speed_after(resistance, time) / speed_after(resistance, np.array([100.0]))
        expected = np.interp(0.9, share, time) - np.interp(0.1, share, time)
        assert found == pytest.approx(expected, rel=1e-6)
    assert rise == sorted(rise)
    currents = [variant["metrics"]["current"]["peak"]["value"] for variant in reply["variants"]]
    assert currents == sorted(currents, reverse=True)


def test_a_load_takes_more_speed_where_the_resistance_is_larger(script: servotune.Client) -> None:
    load = {"port": "load", "signal": {"kind": "step", "amplitude": 1}}
    reply = script.simulate(MOTOR, input=load, outputs=["speed"], variants=VARIANTS, metrics=["steady_state_error"])
    for resistance, variant in zip(RESISTANCES, reply["variants"], strict=True):
        # ω/M_L at rest = -R/(R b + K_t K_e); the wanted speed under a disturbance is 0
        expected = resistance / denominator(resistance)[2]
        assert variant["metrics"]["speed"]["steady_state_error"]["value"] == pytest.approx(expected, rel=1e-9)


def test_frequency_responses_of_all_variants(script: servotune.Client) -> None:
    frequencies = [1.0, 30.0, 200.0, 5000.0]
    reply = script.frequency_response(MOTOR, from_="voltage", to="speed", frequencies=frequencies, variants=VARIANTS)
    assert [variant["parameters"] for variant in reply["variants"]] == VARIANTS
    bandwidths = []
    for resistance, variant in zip(RESISTANCES, reply["variants"], strict=True):
        exact = TORQUE / np.polyval(denominator(resistance), 1j * np.array(frequencies))
        assert variant["frequency"] == frequencies
        np.testing.assert_allclose(np.array(variant["real"]) + 1j * np.array(variant["imag"]), exact, rtol=1e-12)
        found = sorted(root["real"] for root in variant["poles"])
        np.testing.assert_allclose(found[:2], sorted(np.roots(denominator(resistance)).real), rtol=1e-10)
        bandwidths.append(variant["metrics"]["bandwidth"]["value"])
    assert bandwidths == sorted(bandwidths, reverse=True)


def test_any_parameter_in_any_unit_and_a_block_beside_a_system_parameter(script: servotune.Client) -> None:
    variants = [
        {"r_a": {"value": 330, "unit": "mohm"}},
        {"motor.inertia": {"value": 40, "unit": "kg*cm**2"}, "r_a": 0.8},
    ]
    first, second = script.simulate(MOTOR, input=STEP, variants=variants, duration=0.4, samples=11)["variants"]
    assert first["outputs"]["speed"][-1] == pytest.approx(speed_after(0.33, np.array([0.4]))[0], rel=1e-9)
    slow = script.simulate(MOTOR, input=STEP, variants=[{"r_a": 0.8}], metrics=["rise_time"])["variants"][0]
    ratio = second["metrics"]["speed"]["rise_time"]["value"] / slow["metrics"]["speed"]["rise_time"]["value"]
    # With twice the inertia the mechanical time constant R J/(K_t K_e) doubles; the electrical one, L/R, stays.
    assert ratio == pytest.approx(2.0, rel=0.05)


def test_a_variant_out_of_bounds_is_refused_by_name(script: servotune.Client) -> None:
    with pytest.raises(servotune.InvalidRequestError) as caught:
        script.simulate(MOTOR, input=STEP, variants=[{}, {"r_a": -0.5}])
    (error,) = caught.value.errors
    assert error.pointer.startswith("/variants/1")
    assert "must be > 0 ohm, got -0.5" in error.detail
