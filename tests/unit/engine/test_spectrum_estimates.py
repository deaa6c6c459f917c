"""Spectra of samples: a sine reads its amplitude, power adds up, windows have their published figures."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import welch

from engine.exact.frequency.harmonics import harmonics_of_samples
from engine.model.errors import SpectrumError
from engine.recordings.spectra.sampled import averaged_spectrum, band_mean_square, spectrum, window_of

RATE = 1000.0


def sine(frequency: float, amplitude: float, seconds: float = 2.0, phase: float = 0.0):
    t = np.arange(round(seconds * RATE)) / RATE
    return amplitude * np.cos(frequency * t + phase)


@pytest.mark.parametrize(
    ("kind", "gain", "bandwidth"),
    # F. Harris, table 1: 1, 1.5; flat-top of five terms: 3.77 (G. Heinzel, A. Rüdiger, R. Schilling 2002, "SFT5F"-like)
    [("none", 1.0, 1.0), ("hann", 0.5, 1.5), ("flat_top", 0.2156, 3.770)],
)
def test_windows_have_their_published_figures(kind: str, gain: float, bandwidth: float) -> None:
    window, weights = window_of(kind, 4096)
    assert window.coherent_gain == pytest.approx(gain, abs=1e-4)
    assert window.noise_bandwidth == pytest.approx(bandwidth, abs=1e-3)
    assert weights.shape == (4096,)


@pytest.mark.parametrize("window", ["flat_top", "hann", "none"])
def test_a_sine_on_a_line_reads_its_amplitude_and_phase(window: str) -> None:
    found = spectrum(sine(2 * np.pi * 50, 0.7, phase=0.4), RATE, window=window)
    line = int(np.argmax(found.value))
    assert found.frequency[line] == pytest.approx(2 * np.pi * 50, rel=1e-12)
    assert found.value[line] == pytest.approx(0.7, rel=1e-9)
    assert found.phase[line] == pytest.approx(0.4, abs=1e-9)
    assert (found.averages, found.resolution) == (1, pytest.approx(np.pi))


@pytest.mark.parametrize(("window", "error"), [("flat_top", 2e-3), ("hann", 0.16), ("none", 0.37)])
def test_a_sine_between_lines_reads_within_the_scalloping_of_its_window(window: str, error: float) -> None:
    # worst case, half way: flat-top 0.01 dB, Hann 1.42 dB, none 3.92 dB (F. Harris, table 1)
    found = spectrum(sine(2 * np.pi * 50.25, 0.7), RATE, window=window)
    assert found.value.max() == pytest.approx(0.7, rel=error)
    if window != "flat_top":
        assert found.value.max() < 0.7 * (1 - 0.9 * error)


def test_a_constant_reads_itself_at_zero_and_is_removed_on_request() -> None:
    values = np.full(512, 3.0)
    assert spectrum(values, RATE, window="none").value[0] == pytest.approx(3.0, rel=1e-12)
    assert np.abs(spectrum(values, RATE, removal="mean").value).max() < 1e-12
    trend = np.linspace(0, 1, 512)
    assert np.abs(spectrum(trend, RATE, removal="trend").value).max() < 1e-12


@pytest.mark.parametrize("samples", [1024, 1023])
def test_density_without_window_has_the_mean_square_exactly(samples: int) -> None:
    values = np.random.default_rng(1).normal(size=samples) + 0.5
    found = spectrum(values, RATE, quantity="density", window="none")
    assert band_mean_square(found, 0.0, 1e9) == pytest.approx(np.mean(values**2), rel=1e-12)
    assert found.value.sum() * found.resolution / (2 * np.pi) == pytest.approx(np.mean(values**2), rel=1e-12)


def test_density_of_white_noise_is_its_variance_over_half_the_rate() -> None:
    values = np.random.default_rng(2).normal(scale=2.0, size=200_000)
    found = spectrum(values, RATE, quantity="density", window="hann", segment=1000)
    assert found.averages == 399
    assert found.phase is None
    # 4 / 500 Hz; the mean over 400 lines of 399 overlapping averages scatters by well below 1 %
    assert found.value[50:450].mean() == pytest.approx(4 / 500, rel=0.01)
    assert band_mean_square(found, 2 * np.pi * 100, 2 * np.pi * 200) == pytest.approx(0.8, rel=0.03)


def test_averaging_keeps_the_amplitude_of_a_sine() -> None:
    found = spectrum(sine(2 * np.pi * 50, 0.7, 10.0), RATE, window="flat_top", segment=1000, overlap=0.75)
    assert found.averages == 37
    assert found.value.max() == pytest.approx(0.7, rel=1e-9)


def test_harmonics_of_a_record_that_is_no_whole_number_of_periods() -> None:
    w = 2 * np.pi * 7.3
    values = 0.2 + sine(w, 1.0, phase=0.3) + sine(2 * w, 0.3, phase=-1) + sine(3 * w, 0.4, phase=2)
    found = harmonics_of_samples(values, RATE, w, 5)
    np.testing.assert_allclose(found.amplitude, [1.0, 0.3, 0.4, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.phase[:3], [0.3, -1, 2], atol=1e-10)
    assert found.mean == pytest.approx(0.2, rel=1e-10)
    assert found.thd == pytest.approx(0.5, rel=1e-10)  # sqrt(0.09 + 0.16)


def test_harmonics_of_a_square_wave_fall_as_one_over_the_order() -> None:
    w = 2 * np.pi
    t = np.arange(100_000) / 100_000
    found = harmonics_of_samples(np.sign(np.sin(w * (t + 0.5e-5))), 100_000, w, 7)
    np.testing.assert_allclose(found.amplitude, 4 / np.pi * np.array([1, 0, 1 / 3, 0, 1 / 5, 0, 1 / 7]), atol=1e-6)
    assert harmonics_of_samples(np.ones(1000), RATE, w, 3).thd is None


@pytest.mark.parametrize(
    ("settings", "at", "message"),
    [
        ({"segment": 4}, ("segment",), "segment must be 8 to 100 samples, got 4"),
        ({"segment": 101}, ("segment",), "segment must be 8 to 100 samples, got 101"),
        ({"overlap": 1.0}, ("overlap",), "overlap must be >= 0 and < 1, got 1"),
    ],
)
def test_refuses(settings, at, message) -> None:
    with pytest.raises(SpectrumError, match=message) as caught:
        spectrum(np.zeros(100), RATE, **settings)
    assert caught.value.at == at


def test_harmonics_refuse_a_record_without_a_period_and_orders_beyond_half_the_rate() -> None:
    with pytest.raises(SpectrumError, match=r"fundamental must be >= 62\.8319 rad/s"):
        harmonics_of_samples(np.zeros(100), RATE, 1.0, 1)
    with pytest.raises(SpectrumError, match="orders must be <= 4"):
        harmonics_of_samples(np.zeros(100), RATE, 2 * np.pi * 100, 5)


def test_experiments_are_averaged_segment_by_segment_and_never_across() -> None:
    rng = np.random.default_rng(8)
    long, short = rng.standard_normal(4000), rng.standard_normal(1000)
    whole = averaged_spectrum([long, short], 100.0, segment=500, quantity="density", window="hann", overlap=0.0)
    # Welch of each by itself, weighted by segments: 8 and 2
    parts = [welch(values, 100.0, nperseg=500, noverlap=0, detrend=False)[1] for values in (long, short)]
    assert whole.averages == 10
    assert whole.value == pytest.approx((8 * parts[0] + 2 * parts[1]) / 10)
    loud = averaged_spectrum([3 * np.cos(np.arange(1000)), np.cos(np.arange(1000))], 1.0)
    assert loud.value.max() == pytest.approx(np.sqrt((9 + 1) / 2), rel=2e-3)  # powers are averaged
    assert loud.phase is None
