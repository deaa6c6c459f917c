"""What stands on the simulated rig moves as the engine says, and its sensors distort as they are told to."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from engine.diagram.diagram import Block, Connection, System, compile_system
from engine.exact.time.sampled import simulate_sampled
from rig_simulator.plant import Plant, PlantError
from rig_simulator.sensors import Converter, HiddenMode, Sensor, SensorRun

RATE = 2000.0
T = np.arange(3000) / RATE
U = np.sin(2 * np.pi * 7 * T) + (T > 0.5)


def plant(*, delay: float = 0.0, saturated: bool = False) -> Plant:
    blocks = {
        "u": Block(kind="input", values={}),
        "wait": Block(kind="delay", values={"time": delay}) if delay else Block(kind="gain", values={"gain": 1.0}),
        "limit": Block(kind="saturation", values={"upper": 0.5, "lower": -0.5})
        if saturated
        else Block(kind="gain", values={"gain": 1.0}),
        "lag": Block(kind="transfer_function", values={"numerator": [900.0], "denominator": [1.0, 6.0, 900.0]}),
    }
    wires = (("u", "wait"), ("wait", "limit"), ("limit", "lag"))
    return Plant(
        diagram=compile_system(
            System(
                name="plant",
                parameters={},
                blocks=blocks,
                connections=tuple(Connection(source=a, target=b) for a, b in wires),
                outputs={"y": "lag"},
            )
        )
    )


def run(made: Plant, *, samples: int | None = U.size, steps: tuple[int, ...] = (1, 700, 3, 2296)) -> np.ndarray:
    running = made.start(RATE, lambda first, count: U[None, first : first + count], samples=samples)
    return np.concatenate([running.advance(count) for count in steps], axis=1)[0]


def test_a_linear_plant_is_followed_block_by_block() -> None:
    # Independent: scipy's simulation of the same filter for an input that is linear between samples.
    _, wanted, _ = signal.lsim(([900.0], [1.0, 6.0, 900.0]), U, T)
    assert np.abs(run(plant(), samples=None) - wanted).max() < 1e-9


def test_delays_and_laws_are_computed_when_a_finite_run_starts() -> None:
    late = plant(delay=0.0123)
    exact = simulate_sampled(late.diagram.realize(), U[None], 1 / RATE)[0]
    assert np.abs(run(late) - exact).max() < 1e-12
    assert np.abs(run(plant(saturated=True))).max() < 1.0  # 0.5 at the input, a resonance of 1/(2 0.1) cut by it
    for made in (late, plant(saturated=True)):
        with pytest.raises(PlantError, match="must be finite"):
            run(made, samples=None)


def volts(sensor: Sensor, values: np.ndarray, converter: Converter | None = None) -> np.ndarray:
    made = SensorRun(sensor, converter or Converter(bits=32), rate=RATE, rng=np.random.default_rng(1))
    return np.concatenate([made.deliver(part) for part in np.array_split(values, 7)])


def test_a_sensor_scales_and_a_cable_adds() -> None:
    assert np.abs(volts(Sensor(sensitivity=2.0, offset=0.1), U) - (2 * U + 0.1)).max() < 1e-8
    noisy = volts(Sensor(noise=0.01), np.zeros(3000))
    assert noisy.std() == pytest.approx(0.01, rel=0.05)
    humming = volts(Sensor(hum=0.3, mains=60.0), np.zeros(3000))
    assert np.abs(humming - 0.3 * np.sin(2 * np.pi * 60 * T)).max() < 1e-8


def test_an_iepe_sensor_forgets_what_stands_still() -> None:
    # First order, 1 Hz: a step decays as exp(-2 pi t).
    found = volts(Sensor(highpass=1.0), np.ones(3000))
    assert np.abs(found - np.exp(-2 * np.pi * T)).max() < 2e-3


def test_a_hidden_mode_adds_its_resonance() -> None:
    frequency = 2 * np.pi * 100
    mode = HiddenMode(frequency=frequency, damping_ratio=0.05, share=0.2)
    probe = 2 * np.pi * 80
    t = np.arange(20_000) / RATE
    found = volts(Sensor(hidden_mode=mode), np.sin(probe * t))[10_000:]
    s = 1j * 2 * RATE * np.tan(probe / (2 * RATE))  # where the bilinear transform has 80 Hz
    wanted = abs(1 - 0.2 * s**2 / (s**2 + 2 * 0.05 * frequency * s + frequency**2))
    assert np.sqrt(2) * found.std() == pytest.approx(wanted, rel=1e-4)  # 400 whole periods


def test_a_converter_is_late_clips_and_rounds() -> None:
    late = volts(Sensor(), U, Converter(bits=32, delay=2.5))
    wanted = np.interp(np.arange(U.size) - 2.5, np.arange(U.size), U, left=0.0)
    assert np.abs(late - wanted)[3:].max() < 1e-8
    coarse = volts(Sensor(), 3 * U, Converter(range=2.0, bits=4))
    assert set(np.round(coarse / 0.25, 9)) <= set(range(-8, 8))  # 16 values, 0.25 V apart, none beyond the range
