"""Frequency response functions against a plant whose response is known, and against scipy's estimates."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy import signal

from engine.model.errors import SpectrumError
from engine.recordings.spectra.averaged import averaged_frf
from engine.recordings.spectra.comparison import compared
from engine.recordings.spectra.frf import Frf, confidence
from engine.recordings.spectra.motion import in_form
from engine.recordings.spectra.multisine import multisine_frf
from engine.recordings.spectra.sensors import Sensor, correction
from engine.recordings.spectra.stepped_sine import SineStep, stepped_sine_frf

HZ = 2 * np.pi
RATE = 2560.0


@dataclass(frozen=True)
class Plant:
    """A mass on a spring as a digital filter, whose response at every frequency is a quotient of polynomials."""

    frequency: float = 40.0
    damping: float = 0.03

    @property
    def coefficients(self) -> tuple[np.ndarray, np.ndarray]:
        w = HZ * self.frequency
        system = signal.cont2discrete(([1.0, 0, 0], [1.0, 2 * self.damping * w, w**2]), 1 / RATE, method="bilinear")
        return system[0].ravel(), system[1].ravel()

    def drive(self, x: np.ndarray) -> np.ndarray:
        return signal.lfilter(*self.coefficients, x)

    def response(self, w: np.ndarray) -> np.ndarray:
        b, a = self.coefficients
        z = np.exp(-1j * w / RATE)
        return np.polynomial.polynomial.polyval(z, b) / np.polynomial.polynomial.polyval(z, a)


PLANT = Plant()


def decibel(found: Frf, truth: np.ndarray) -> np.ndarray:
    return 20 * np.log10(np.abs(found.value / truth))


def at(found: Frf, hertz: float) -> int:
    return int(np.argmin(np.abs(found.frequency - HZ * hertz)))


def noise(seed: int, samples: int, size: float = 1.0) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(samples)


def test_h1_h2_and_coherence_are_those_of_scipy() -> None:
    x = noise(1, 40_000)
    y = PLANT.drive(x) + noise(2, 40_000, 0.5)
    settings = {"fs": RATE, "nperseg": 1024, "noverlap": 512, "detrend": "constant"}
    _, sxx = signal.welch(x, **settings)
    _, syy = signal.welch(y, **settings)
    _, sxy = signal.csd(x, y, **settings)
    hertz, coherence = signal.coherence(x, y, **settings)
    h1 = averaged_frf([(x, y)], RATE, segment=1024)
    assert h1.frequency == pytest.approx(HZ * hertz[1:-1])
    assert np.abs(h1.value - (sxy / sxx)[1:-1]).max() < 1e-10
    assert h1.coherence == pytest.approx(coherence[1:-1], abs=1e-10)
    h2 = averaged_frf([(x, y)], RATE, segment=1024, estimator="H2")
    assert np.abs(h2.value / (syy / sxy.conj())[1:-1] - 1).max() < 1e-9
    hv = averaged_frf([(x, y)], RATE, segment=1024, estimator="Hv")
    assert np.abs(hv.value) == pytest.approx(np.sqrt(np.abs(h1.value * h2.value)), rel=1e-10)


@pytest.mark.parametrize(("on_input", "on_output", "best"), [(0.0, 1.0, "H1"), (1.0, 0.0, "H2"), (1.0, 1.0, "Hv")])
def test_each_estimator_is_right_where_its_assumption_holds(on_input: float, on_output: float, best: str) -> None:
    # well damped, so that the noise is the same part of input and output on all lines looked at
    plant, x = Plant(damping=0.7), noise(3, 200_000)
    y = plant.drive(x)
    ratio = 10**-0.5  # 10 dB
    seen = x + noise(4, x.size, on_input * ratio * x.std())
    heard = y + noise(5, x.size, on_output * ratio * y.std())
    errors = {}
    for estimator in ("H1", "H2", "Hv"):
        found = averaged_frf([(seen, heard)], RATE, segment=4096, estimator=estimator)
        band = (found.frequency > HZ * 60) & (found.frequency < HZ * 400)
        errors[estimator] = float(np.median(np.abs(decibel(found, plant.response(found.frequency))[band])))
    assert min(errors, key=errors.__getitem__) == best
    # a tenth of noise power makes H1 too small, or H2 too large, by 20 lg 1.1 = 0.83 dB
    assert errors[best] < 0.25


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_units_change_nothing_but_the_scale(estimator: str) -> None:
    x = noise(6, 30_000)
    y = PLANT.drive(x) + noise(7, 30_000, 0.5)
    plain = averaged_frf([(x, y)], RATE, segment=1024, estimator=estimator)
    scaled = averaged_frf([(x, 1000 * y)], RATE, segment=1024, estimator=estimator)
    assert np.abs(scaled.value / plain.value / 1000 - 1).max() < 1e-12


@pytest.mark.parametrize(("estimator", "overlap"), [("H1", 0.5), ("H1", 0.75), ("Hv", 0.5)])
def test_95_percent_bands_hold_the_truth_95_times_of_100(estimator: str, overlap: float) -> None:
    # no dynamics: nothing but the random error is left; noise on both sides for Hv
    inside, turned = [], []
    for seed in range(60):
        x, e, f = noise(3 * seed, 6000), noise(3 * seed + 1, 6000), noise(3 * seed + 2, 6000)
        seen = x + 0.7 * f if estimator == "Hv" else x
        found = averaged_frf(
            [(seen, 2 * x + 1.4 * e)], RATE, segment=512, estimator=estimator, removal="nothing", overlap=overlap
        )
        band = confidence(found, 0.95)
        assert band is not None
        inside.append((band.magnitude_lower < 2) & (band.magnitude_upper > 2))
        bias = np.angle(found.value)
        turned.append(np.abs(bias) < band.phase_upper - np.unwrap(bias))
    assert 0.94 < np.mean(inside) < 0.965
    assert 0.94 < np.mean(turned) < 0.965


def test_a_narrow_resonance_is_read_too_low_and_this_is_said() -> None:
    x = noise(8, int(RATE) * 60)
    y = PLANT.drive(x)
    coarse = averaged_frf([(x, y)], RATE, segment=1024)
    error = decibel(coarse, PLANT.response(coarse.frequency))[at(coarse, 40)]
    assert error < -3  # lines 2.5 Hz apart, half-power width 2 ζ f = 2.4 Hz
    (doubt,) = coarse.doubts
    assert doubt.kind == "resonance_bias"
    assert doubt.frequency == pytest.approx(HZ * 40, rel=0.05)
    fine = averaged_frf([(x, y)], RATE, segment=16_384)
    assert abs(decibel(fine, PLANT.response(fine.frequency))[at(fine, 40)]) < 0.1
    assert fine.doubts == ()


def test_a_wide_resonance_raises_no_doubt() -> None:
    plant = Plant(damping=0.2)
    x = noise(9, int(RATE) * 40)
    assert averaged_frf([(x, plant.drive(x) + noise(10, x.size, 0.1))], RATE, segment=4096).doubts == ()


def test_segments_without_a_window_leak_unless_they_are_periods_or_at_rest() -> None:
    def kinds(x: np.ndarray, segment: int) -> list[str]:
        return [doubt.kind for doubt in averaged_frf([(x, 3 * x)], RATE, segment=segment, window="none").doubts]

    repeating = np.tile(noise(11, 512), 20)
    assert "leakage" not in kinds(repeating, 512)
    assert "leakage" in kinds(repeating, 500)
    pulse = np.zeros(4096)
    pulse[100:110] = 1.0
    assert "leakage" not in kinds(np.tile(pulse, 3), 4096)
    assert "leakage" not in kinds(pulse, 4096)
    assert "leakage" in kinds(noise(12, 4096), 4096)


SILENT = np.zeros(int(RATE))
SWEEP = np.concatenate([SILENT, signal.chirp(np.arange(int(8 * RATE)) / RATE, 5, 8, 100), SILENT])


@pytest.mark.parametrize("segment", [2048, 8192, SWEEP.size])
def test_a_window_over_a_sweep_is_doubted(segment: int) -> None:
    kinds = [doubt.kind for doubt in averaged_frf([(SWEEP, PLANT.drive(SWEEP))], RATE, segment=segment).doubts]
    assert "sweep" in kinds


def test_a_whole_sweep_without_a_window_is_exact_and_a_part_of_it_under_a_window_is_not() -> None:
    plant = Plant(damping=0.1)
    y = plant.drive(SWEEP)

    def error(**settings: Any) -> float:
        found = averaged_frf([(SWEEP, y)], RATE, **settings)
        band = (found.frequency > HZ * 10) & (found.frequency < HZ * 90)
        return float(np.abs(found.value / plant.response(found.frequency) - 1)[band].max())

    whole = averaged_frf([(SWEEP, y)], RATE, segment=SWEEP.size, window="none", removal="nothing")
    assert [doubt.kind for doubt in whole.doubts] == ["averages"]
    assert error(segment=SWEEP.size, window="none", removal="nothing") < 1e-6
    assert error(segment=SWEEP.size) > 0.02
    assert error(segment=4096) > 0.02


@pytest.mark.parametrize("segment", [512, 4096, 20_480])
def test_noise_and_random_sequences_under_a_window_are_not_doubted(segment: int) -> None:
    held = np.sign(noise(31, 4096))[np.arange(40_960) // 10]
    half = np.where(np.arange(40_960) % 8192 < 4915, noise(32, 40_960), 0.0)
    for x in (noise(30, 40_960), held, half):
        kinds = [doubt.kind for doubt in averaged_frf([(x, 2 * x)], RATE, segment=segment).doubts]
        assert "sweep" not in kinds


def test_a_delay_that_is_long_beside_a_segment_is_named() -> None:
    x = noise(13, 60_000)
    late = np.roll(x, 200)
    (doubt,) = averaged_frf([(x, late)], RATE, segment=1024).doubts
    assert doubt.kind == "delay"
    assert "0.0781 s" in doubt.detail  # 200 / 2560
    assert averaged_frf([(x, late)], RATE, segment=16_384).doubts == ()


def test_one_segment_tells_no_error() -> None:
    x = noise(14, 4096)
    found = averaged_frf([(x, 2 * x)], RATE, segment=4096)
    assert found.coherence is None
    assert confidence(found) is None
    assert found.doubts[0].kind == "averages"


def test_no_segment_lies_in_two_experiments() -> None:
    one, two = noise(15, 5000), noise(16, 3000)
    both = averaged_frf([(one, 2 * one), (two, 2 * two)], RATE, segment=1024)
    assert both.averages == (1 + (5000 - 1024) // 512) + (1 + (3000 - 1024) // 512)
    assert np.abs(both.value - 2).max() < 1e-12


def multisine(seed: int, period: int) -> np.ndarray:
    lines = np.zeros(period // 2 + 1, dtype=complex)
    driven = np.arange(20, min(1600, period // 2 - 20))
    lines[driven] = np.exp(2j * np.pi * np.random.default_rng(seed).random(driven.size))
    return np.fft.irfft(lines) * period / 50


def test_a_multisine_is_exact_on_its_lines() -> None:
    period = int(RATE) * 4
    x = np.tile(multisine(17, period), 6)
    found = multisine_frf(x, PLANT.drive(x), RATE, period=4.0, settle=4.0)
    assert found.frequency == pytest.approx(HZ * np.arange(20, 1600) / 4)
    # what is left of the beginning after 4 s: exp(-0.03 * 2 pi 40 * 4) = 8e-14
    assert np.abs(found.value / PLANT.response(found.frequency) - 1).max() < 1e-9
    assert found.averages == 5
    assert found.doubts == ()


def test_the_bands_of_a_multisine_hold_the_truth() -> None:
    x = np.tile(multisine(18, int(RATE)), 9)
    hits = []
    for seed in range(20):
        y = 2 * x + noise(seed, x.size, 2.0)
        found = multisine_frf(x, y, RATE, period=1.0, settle=1.0)
        band = confidence(found)
        assert band is not None
        hits.append((band.magnitude_lower < 2) & (band.magnitude_upper > 2))
    assert 0.94 < np.mean(hits) < 0.96


def test_a_multisine_that_has_not_settled_is_doubted() -> None:
    plant = Plant(frequency=6.0, damping=0.005)  # dies away with 5.3 s
    x = np.tile(multisine(19, int(RATE) * 4), 5)
    late = multisine_frf(x, plant.drive(x), RATE, period=4.0)
    assert [doubt.kind for doubt in late.doubts] == ["not_settled"]


def faded(x: np.ndarray, period: int, *, begin: float, end: float) -> np.ndarray:
    """Return a drive with half cosines over some periods at its ends, as the agent plays it (agent/safety.py)."""
    k = np.arange(x.size)
    for periods, place in ((begin, k), (end, x.size - 1 - k)):
        if periods:
            x = x * (0.5 - 0.5 * np.cos(np.pi * np.clip(place / (periods * period), 0, 1)))
    return x


@pytest.mark.parametrize("noisy", [0.0, 0.001])
@pytest.mark.parametrize(
    ("periods", "begin", "end", "says"),
    [
        (
            2,
            0.0,
            0.0,
            "the first of 2 periods .* or it is noise, which 2 periods cannot tell; leave it out by `settle`",
        ),
        (3, 0.0, 0.0, "the first of 3 periods"),
        (3, 0.15, 0.0, "the first of 3 periods"),
        (6, 0.0, 0.15, "(first|last) of 6 periods"),
        (12, 0.0, 0.0, "12 periods|the lines change"),
    ],
)
def test_periods_in_which_nothing_has_settled_are_told(periods, begin, end, says, noisy) -> None:
    """Against H(z) of the plant: they cost half a percent and more, which no band shows; without them nothing is told."""
    period, plant = int(RATE), Plant(frequency=24.0, damping=0.01)  # dies away with 0.66 s
    x = faded(np.tile(multisine(24, period), periods), period, begin=begin, end=end)
    y = plant.drive(x)
    y += noise(25, y.size, noisy * y.std())
    whole = multisine_frf(x, y, RATE, period=1.0)
    assert np.abs(whole.value / plant.response(whole.frequency) - 1).max() > 0.005
    (doubt,) = whole.doubts
    assert doubt.kind == "not_settled"
    assert re.search(says, doubt.detail), doubt.detail


def test_a_drive_that_fades_in_and_out_costs_nothing_by_itself() -> None:
    """A record that begins and ends at rest holds the whole response to the whole input: Y = H X without a window."""
    period, rest, plant = int(RATE), int(RATE) // 10, Plant(frequency=100.0, damping=0.3)  # dies away with 5 ms
    x = faded(np.tile(multisine(27, period), 8)[:-rest], period, begin=0.1, end=0.1)
    x = np.concatenate([x, np.zeros(rest)])
    found = multisine_frf(x, plant.drive(x), RATE, period=1.0)
    assert np.abs(found.value / plant.response(found.frequency) - 1).max() < 1e-6
    assert found.doubts == ()


def test_noise_alone_is_not_taken_for_something_that_fades() -> None:
    x = np.tile(multisine(26, int(RATE)), 5)
    told = [multisine_frf(x, 2 * x + noise(seed, x.size, 2.0), RATE, period=1.0).doubts for seed in range(20)]
    assert told == [()] * 20


def stepped(hertz: list[float], seconds: float) -> tuple[np.ndarray, list[SineStep]]:
    time = np.arange(round(seconds * RATE)) / RATE
    x = np.concatenate([5 * np.sin(HZ * frequency * time) for frequency in hertz])
    steps = [SineStep(frequency=HZ * f, start=i * seconds, end=(i + 1) * seconds) for i, f in enumerate(hertz)]
    return x, steps


def test_stepped_sines_are_exact_once_they_have_settled() -> None:
    x, steps = stepped([100.0, 10.0, 38.0, 40.0, 41.7], 4.0)
    found = stepped_sine_frf(x, PLANT.drive(x), RATE, steps, settle=3.0)
    assert found.frequency == pytest.approx(HZ * np.array([10, 38, 40, 41.7, 100]))
    # exp(-0.03 * 2 pi 40 * 3) = 1.5e-10 of the beginning is left
    assert np.abs(found.value / PLANT.response(found.frequency) - 1).max() < 1e-8
    assert found.doubts == ()
    hasty = stepped_sine_frf(x, PLANT.drive(x), RATE, steps)
    assert {doubt.kind for doubt in hasty.doubts} == {"not_settled"}


def test_the_bands_of_stepped_sines_hold_the_truth_in_coloured_noise() -> None:
    x, steps = stepped([20.0, 33.3, 50.0], 1.0)
    hits = []
    for seed in range(150):
        coloured = signal.lfilter([1.0], [1.0, -0.9], noise(seed, x.size))
        found = stepped_sine_frf(x, 2 * x + coloured, RATE, steps)
        band = confidence(found)
        assert band is not None
        hits.append((band.magnitude_lower < 2) & (band.magnitude_upper > 2))
    assert 0.92 < np.mean(hits) < 0.98


def test_a_sine_of_another_frequency_than_was_said_is_named() -> None:
    x, _ = stepped([50.0 * 1.024], 1.0)
    (doubt,) = stepped_sine_frf(x, 2 * x, RATE, [SineStep(frequency=HZ * 50, start=0.0, end=1.0)]).doubts
    assert doubt.kind == "frequency"
    assert "51.2" in doubt.detail


def test_receptance_mobility_and_accelerance_are_powers_of_jw_apart() -> None:
    w = HZ * np.array([1.0, 10.0, 100.0])
    mass = Frf(frequency=w, value=np.full(3, 0.5 + 0j))  # acceleration of 2 kg per N
    receptance, unit = in_form(mass, "receptance", unit="m/s**2")
    assert unit == "m"
    assert receptance.value == pytest.approx(-0.5 / w**2)
    back, unit = in_form(receptance, "mobility", unit="m")
    assert (unit, back.value) == ("m/s", pytest.approx(0.5 / (1j * w)))
    assert in_form(receptance, "accelerance", unit="rad")[1] == "rad/s**2"
    with pytest.raises(SpectrumError, match="for the form receptance, got one in Pa"):
        in_form(mass, "receptance", unit="Pa")


def test_sensors_are_taken_back_as_complex_factors() -> None:
    x = np.tile(multisine(20, int(RATE) * 4), 3)
    w_c = HZ * 20
    b, a = signal.bilinear([1.0, 0], [1.0, w_c], RATE)
    found = multisine_frf(x, signal.lfilter(b, a, np.roll(x, 3)), RATE, period=4.0, settle=4.0)
    sensor = Sensor(delay=3 / RATE, coupling=w_c)
    corrected = found.times(correction(found.frequency, input=None, output=sensor))
    low = corrected.frequency < HZ * 60  # above, the bilinear transform bends the frequency axis
    assert np.abs(corrected.value[low] - 1).max() < 0.002
    points = HZ * np.array([1.0, 10.0, 100.0])
    table = Sensor(frequency=points, magnitude=np.array([1.0, 1.1, 1.3]), phase=np.array([0.0, -0.1, -0.4]))
    assert table.response(points[1:]) == pytest.approx([1.1 * np.exp(-0.1j), 1.3 * np.exp(-0.4j)])
    assert correction(points, input=table, output=table) == pytest.approx(np.ones(3))
    with pytest.raises(SpectrumError, match="calibration must cover all lines"):
        table.response(HZ * np.array([200.0]))


def test_a_model_is_compared_line_by_line() -> None:
    x = noise(21, 100_000)
    found = averaged_frf([(x, 2 * x + noise(22, 100_000, 0.6))], RATE, segment=1024)
    right = compared(found, np.full(found.value.size, 2.0 + 0j))
    wrong = compared(found, np.full(found.value.size, 2.2 + 0j))
    assert right.within_percent == pytest.approx(95, abs=2.5)
    assert wrong.within_percent is not None
    assert wrong.within_percent < 10
    assert wrong.median_deviation == pytest.approx(20 * np.log10(1.1), abs=0.02)
    assert wrong.relative_error_percent == pytest.approx(10, abs=0.5)


@pytest.mark.parametrize(
    ("call", "rule"),
    [
        (lambda x: averaged_frf([(x, np.ones(x.size))], RATE, segment=64), "output must change, got a constant"),
        (lambda x: averaged_frf([(np.ones(x.size), x)], RATE, segment=64), "input must change, got a constant"),
        (lambda x: averaged_frf([(x, x[1:])], RATE, segment=64), "same length, got 256 and 255 samples"),
        (lambda x: averaged_frf([(x, 2 * x)], RATE, segment=257), "segment must be 8 to 256 samples"),
        (lambda x: averaged_frf([(x, 2 * x)], RATE, segment=64, overlap=1.0), "overlap must be >= 0 and < 1, got 1"),
        (lambda x: averaged_frf([(x, 2 * x)], RATE, segment=64).within(1e5, 2e5), "band must hold lines"),
        (lambda x: confidence(averaged_frf([(x, 2 * x)], RATE, segment=64), 1.0), "confidence must be > 0 and < 1"),
        (lambda x: multisine_frf(x, 2 * x, RATE, period=0.0311), "period must be a whole number"),
        (lambda x: multisine_frf(x, 2 * x, RATE, period=0.2), "must hold 1 periods of 0.2 s, got 0.1 s"),
        (lambda x: multisine_frf(x, 2 * x, RATE, period=0.025), "input must repeat with the period of 0.025 s, but"),
        (lambda x: stepped_sine_frf(x, x, RATE, []), "steps must be at least one"),
        (lambda x: stepped_sine_frf(x, x, RATE, [SineStep(frequency=9000.0, start=0, end=0.1)]), "frequency must be > 0 and <"),
        (lambda x: stepped_sine_frf(x, x, RATE, [SineStep(frequency=100.0, start=0, end=0.2)]), "within the recording of 0.1 s"),
        (lambda x: stepped_sine_frf(x, x, RATE, [SineStep(frequency=10.0, start=0, end=0.1)]), "must hold a period of"),
    ],
)  # fmt: skip
def test_what_has_no_response_function_is_refused(call, rule: str) -> None:
    with pytest.raises(SpectrumError, match=rule):
        call(noise(23, 256))
