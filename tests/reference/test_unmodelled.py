"""What an input still explains of a residual: a mode of known frequency, damping and share, and noises in which there is nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import settings
from scipy.signal import bilinear, lfilter
from scipy.stats import binom

from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.unmodelled import FALSE_ALARMS, threshold, unmodelled
from tests.unit.engine.validation.lags import H, lag

SEEDS = 300 if settings().max_examples > 1000 else 10
SAMPLES = 4000
TIME = H * np.arange(SAMPLES)
FREQUENCY, DAMPING, SHARE = 2 * np.pi * 55.0, 0.03, 0.05


def compared(measured: np.ndarray, simulated: np.ndarray, **inputs: np.ndarray) -> Comparison:
    return Comparison(
        name="y", measured=measured, simulated=simulated, sample_time=H, inputs=inputs, constant=True
    )  # fmt: skip


def signals(rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray]]:
    """Give a chirp to 80 Hz, noise, a multisine, and steps at random."""
    yield "chirp", np.sin(2 * np.pi * (0.5 * TIME + 10 * TIME**2))
    yield "noise", rng.normal(size=SAMPLES)
    phases = rng.uniform(0, 2 * np.pi, size=160)
    yield "multisine", sum(np.sin(np.pi * k * TIME + phase) for k, phase in enumerate(phases, 1)) / 12
    yield "steps", np.repeat(rng.choice([-1.0, 1.0], size=40), 100)


def noises(rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Give white noise, slow noise, the noise of a resonance at 35 Hz, and white noise with a strong hum of the mains."""
    white = rng.normal(size=SAMPLES)
    yield white
    yield 0.14 * lfilter([1.0], [1.0, -0.99], white)
    yield 0.1 * lfilter([1.0], [1.0, -1.9, 0.95], white)
    yield 0.3 * white + 2 * np.sin(2 * np.pi * 50 * TIME + rng.uniform(0, 2 * np.pi))


def with_mode(y: np.ndarray) -> np.ndarray:
    """Return y - share s² / (s² + 2 d w s + w²) y, by the bilinear transformation."""
    denominator = [1.0, 2 * DAMPING * FREQUENCY, FREQUENCY**2]
    return lfilter(*bilinear([1.0 - SHARE, *denominator[1:]], denominator, fs=1 / H), y)


def test_noise_of_any_color_is_no_finding() -> None:
    alarms, trials = 0, 0
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        for _, u in signals(rng):
            y = lag(u, tau=0.02)
            for noise in noises(rng):
                alarms += bool(unmodelled(compared(y + 0.01 * noise, y, u=u)))
                trials += 1
    # As many as promised, at most: the chance of more than this is one in a million, were they independent.
    assert alarms <= binom.ppf(1 - 1e-6, trials, FALSE_ALARMS)


@pytest.mark.parametrize("kind", ["chirp", "noise", "multisine", "steps"])
def test_a_mode_that_the_model_lacks_is_named(kind) -> None:
    # The bilinear transformation moves a frequency w to (2/h) atan(w h / 2): 54.46 Hz.
    expected = 2 / H * np.arctan(FREQUENCY * H / 2)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        u = dict(signals(rng))[kind]
        y = lag(u, tau=0.02)
        noise = 0.005 * rng.normal(size=SAMPLES)
        found = unmodelled(compared(with_mode(y) + noise, y, u=u))
        band = found[0]
        assert band.resonance is not None
        assert band.source == "u"
        assert band.lower < expected < band.upper
        assert band.resonance.frequency == pytest.approx(expected, rel=0.02)
        assert band.resonance.damping_ratio == pytest.approx(DAMPING, abs=0.02)
        # Of b2 s² / (...): steps tell the least of it.
        assert band.resonance.numerator[0] == pytest.approx(-SHARE, rel=0.5 if kind == "steps" else 0.12)
        assert band.resonance.denominator[2] == pytest.approx(expected**2, rel=0.04)
        # What the mode really adds, of which the lines below the threshold are missing.
        part = with_mode(y) - y
        total = sum(one.rms**2 for one in found) ** 0.5
        assert 0.6 * part.std() < total < 1.1 * part.std()
        share = 100 * part.var() / (part + noise).var()
        assert 0.35 * share < sum(one.share_percent for one in found) < 1.1 * share


def test_a_wrong_gain_is_a_band_without_a_resonance() -> None:
    u = dict(signals(np.random.default_rng(1)))["chirp"]
    y = lag(u, tau=0.02)
    (band,) = unmodelled(compared(1.3 * y + 1e-3 * np.random.default_rng(2).normal(size=SAMPLES), y, u=u))
    assert band.resonance is None
    assert band.relative == pytest.approx(0.3, rel=0.02)
    assert band.share_percent > 95


@pytest.mark.parametrize("kind", ["chirp", "noise", "multisine", "steps"])
def test_a_model_that_is_wrong_everywhere_names_no_mode(kind) -> None:
    # Gain, dead time, order and pace are wrong: what looks out of the noise here and there is a part of that.
    poles = [1.0, 2 * 0.6 * 90.0, 90.0**2]
    for seed in range(5):
        rng = np.random.default_rng(seed)
        u = dict(signals(rng))[kind]
        late = np.concatenate([np.zeros(7), u[:-7]])
        swinging = lfilter(*bilinear([2 * 90.0**2], poles, fs=1 / H), late)
        slower, twice = lag(u, tau=0.05), lag(lag(u, tau=0.02), tau=0.01)
        for measured, model in ((swinging, lag(u, tau=0.1)), (slower, lag(u, tau=0.02)), (twice, lag(u, tau=0.02))):
            noise = 0.003 * measured.std() * rng.normal(size=SAMPLES)
            found = unmodelled(compared(measured + noise, model, u=u))
            assert found  # the input does explain what is left
            assert [band.resonance for band in found if band.resonance is not None] == []


def test_of_several_inputs_the_one_that_excites_the_mode_is_named() -> None:
    rng = np.random.default_rng(3)
    first, second = rng.normal(size=(2, SAMPLES))
    y = lag(first, tau=0.02) + 0.5 * lag(second, tau=0.01)
    noise = 0.005 * rng.normal(size=SAMPLES)
    found = unmodelled(compared(y + with_mode(lag(second)) - lag(second) + noise, y, a=first, b=second))
    assert {band.source for band in found} == {"b"}
    assert unmodelled(compared(y + noise, y, a=first, b=second)) == ()


@pytest.mark.parametrize(
    "case",
    [
        compared(np.sin(TIME)[:200], np.cos(TIME)[:200], u=np.sin(TIME)[:200]),
        compared(np.sin(TIME), np.sin(TIME), u=np.cos(TIME)),
        compared(np.sin(TIME), np.cos(TIME), u=np.ones(SAMPLES)),
        compared(np.sin(TIME), np.cos(TIME)),
        compared(np.sin(TIME), np.cos(TIME), **{f"u{i}": np.sin(i * TIME) for i in range(1, 8)}),
    ],
)
def test_where_nothing_can_be_told_nothing_is(case) -> None:
    assert unmodelled(case) == ()


def test_the_threshold_is_that_of_a_beta_distribution() -> None:
    # 1 - (1 - c)^(n - 1) is the law of Beta(1, n - 1): SciPy's, beside ours.
    from scipy.stats import beta

    assert threshold(400, 14.0) == pytest.approx(beta.isf(FALSE_ALARMS / 400, 1, 13), rel=1e-9)
    assert threshold(400, 14.0, tests=2) == pytest.approx(beta.isf(FALSE_ALARMS / 800, 1, 13), rel=1e-9)
