"""What is noticed in recordings, whatever model is fitted to them: each kind of bad data, and good data of every kind."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import chirp, cont2discrete, lfilter

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.model.between_samples import BetweenSamples
from optimizers.black_box import black_box
from optimizers.identification import Identified, identify
from optimizers.problem import Variable
from optimizers.recorded.recorded_data import doubted_data, made_by, one_step, outliers
from optimizers.recorded.recording import Identification, RecordedExperiment, Recording

H, COUNT = 0.01, 3000
TIME = H * np.arange(COUNT)
LEVELS = np.repeat(np.append(0.0, np.random.default_rng(7).normal(size=COUNT // 50 - 1)), 50)
INPUTS = {
    "levels": LEVELS,
    "chirp": chirp(TIME, 0.1, TIME[-1], 10.0, phi=-90),
    "fast chirp": chirp(TIME, 0.1, TIME[-1], 45.0, phi=-90),
    "multisine": np.asarray(sum(np.sin(2 * np.pi * f * TIME) for f in (0.2, 0.7, 1.1, 3.0, 5.0))),
    "noise": np.append(0.0, np.random.default_rng(8).choice([-1.0, 1.0], size=COUNT - 1)),
}


def lag(u: np.ndarray, k: float = 2.0, constant: float = 0.2) -> np.ndarray:
    """Return the response to a held input, by scipy's zero-order hold."""
    b, a, _ = cont2discrete(([k], [constant, 1.0]), H, method="zoh")
    return np.asarray(lfilter(b[0], a, u))


def recorded(u: np.ndarray, y: np.ndarray) -> RecordedExperiment:
    recording = Recording(inputs={"u": u}, outputs={"y": y}, sample_time=H, between_samples={"u": BetweenSamples.HOLD})
    return RecordedExperiment(recording=recording, split=1.0)


def first_order(k: float = 1.5) -> Diagram:
    return compile_system(
        System(
            name="lag",
            parameters={
                "k": Parameter(value=k, lower=0.0, upper=100.0), "T": Parameter(value=0.3, lower=1e-3, upper=10.0)
            },
            blocks={
                "u": Block(kind="input"),
                "plant": Block(kind="transfer_function", values={"numerator": ["=k"], "denominator": ["=T", 1.0]}),
            },
            connections=(Connection(source="u", target="plant"),),
            outputs={"y": "plant"},
        )
    )  # fmt: skip


def found_by(u: np.ndarray, y: np.ndarray, k: float = 1.5) -> Identified:
    problem = Identification(
        diagram=first_order(k), experiments=(recorded(u, y),), parameters=(Variable(parameter="k"), Variable(parameter="T"))
    )  # fmt: skip
    return identify(problem, rng=np.random.default_rng(0))


def noise(seed: int, size: float = 0.02) -> np.ndarray:
    return size * np.random.default_rng(seed).normal(size=COUNT)


@pytest.mark.parametrize("kind", INPUTS)
def test_nothing_is_said_about_good_data(kind):
    found = found_by(INPUTS[kind], lag(INPUTS[kind]) + noise(3))
    assert found.warnings == ()
    for name, value in (("k", 2.0), ("T", 0.2)):
        assert found.parameters[name].value == pytest.approx(value, rel=0.02)


def said(found: Identified, words: str) -> bool:
    return any(words in sentence for sentence in found.warnings)


def test_each_kind_of_bad_data_is_said():
    clean = lag(LEVELS) + noise(4)
    spoilt = clean.copy()
    spoilt[np.random.default_rng(5).integers(0, COUNT, 15)] += 1.0
    assert said(found_by(LEVELS, spoilt), "lie apart from the others")
    assert said(found_by(LEVELS, np.clip(clean, -1.5, 1.5)), "y may be clipped: it stays at 1.5")
    turned = found_by(-LEVELS, clean)
    assert said(turned, "y moves against the model at its start")
    assert said(turned, "k came to rest at 0")
    assert said(turned, "the model explains little of y")
    assert said(found_by(LEVELS, 1e3 * clean), "k came to rest at its upper bound 100")
    assert said(found_by(LEVELS, 1e3 * clean), "mm taken for m: 1000")
    assert said(found_by(LEVELS, 1e-3 * clean), "mm taken for m: 1000")
    assert said(found_by(LEVELS, clean * math.pi / 30, k=2.0), "1/min taken for rad/s, or the reverse: 9.549")


@pytest.mark.parametrize("colour", [0.0, 0.5, 0.9, 0.99])
def test_noise_of_any_colour_has_no_outliers_and_hides_few(colour):
    false, found = 0, 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        noise = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], random.normal(size=COUNT))
        noise = lfilter([0.3, 0.4, 0.3], [1.0], noise) if seed % 2 else noise
        false += outliers(noise, 5.0).size > 0
        apart = 50 + 400 * np.arange(7)
        noise[apart] += 15.0 * random.choice([-1.0, 1.0], size=7)
        found += np.isin(apart, outliers(noise, 5.0)).sum()
    assert false == 0
    assert found >= 0.97 * 7 * 40


def test_one_step_tells_no_more_than_its_spectrum():
    """A/ω against σ h √N: a step of 2, noise of 0.02."""
    u = (TIME >= 5.0).astype(float)
    (sentence,) = doubted_data(recorded(u, lag(u) + noise(6)))
    assert "u moves once, at 5 s" in sentence
    limit = float(sentence.split("poles beyond ")[1].split()[0])
    assert limit == pytest.approx(2.0 / (0.02 * H * math.sqrt(COUNT)), rel=0.1)
    assert one_step(LEVELS) is None
    assert one_step(u + noise(7)) == 500
    assert "one sine of 1.3 Hz" in doubted_data(recorded(wave := np.sin(2 * np.pi * 1.3 * TIME), lag(wave)))[0]


@pytest.mark.parametrize("reference", ["none", "step", "levels"])
def test_a_loop_that_nothing_moves_from_outside_is_told(reference):
    """A PI controller round the lag, by its difference equations, with noise on the plant and on the sensor."""
    r = {"none": 0 * TIME, "step": (TIME >= 5) * 1.0, "levels": LEVELS}[reference]
    rng, pole = np.random.default_rng(9), math.exp(-H / 0.2)
    u, y = np.zeros(COUNT), np.zeros(COUNT)
    state = total = 0.0
    for k in range(COUNT):
        y[k] = state + 0.02 * rng.normal()
        total += H * (r[k] - y[k])
        u[k] = 2.0 * (r[k] - y[k]) + 3.0 * total
        state = pole * state + 2.0 * (1 - pole) * u[k] + 0.01 * rng.normal()
    assert made_by(u, y) is (reference == "none")
    assert any("follows from the output" in one for one in doubted_data(recorded(u, y))) is (reference == "none")


def test_a_model_without_a_diagram_says_it_too():
    clean = lag(LEVELS) + noise(4)
    cut = black_box(recorded(LEVELS, np.clip(clean, -1.5, 1.5)), method="transfer_function", orders=(1,))
    assert any("y may be clipped" in sentence for sentence in cut.warnings)
    clean[700] += 2.0
    spoilt = black_box(recorded(LEVELS, clean), method="transfer_function", orders=(1,))
    assert any("1 sample of y" in sentence for sentence in spoilt.warnings)


@pytest.mark.parametrize("moves", [False, True])
def test_a_reference_may_move_late_in_a_long_recording(moves):
    """A controller u = 0.3 (r - y) of a lag in noise; whether r moves is seen after the first stretch."""
    rng = np.random.default_rng(11)
    count = 60_000
    reference, errors = np.where(np.arange(count) >= 45_000, 1.0 * moves, 0.0), 0.05 * rng.normal(size=count)
    u, y, state = np.zeros(count), np.zeros(count), 0.0
    for k in range(count):
        y[k] = state + errors[k]
        u[k] = 0.3 * (reference[k] - y[k])
        state = 0.99 * state + 0.02 * u[k]
    assert made_by(u, y) is not moves
