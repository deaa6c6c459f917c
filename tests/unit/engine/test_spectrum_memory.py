"""Spectra of long recordings: as those of the whole array, in memory that does not grow with what is computed from it."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.signal import welch

from engine.exact.frequency.harmonics import harmonics_of_samples
from engine.recordings.spectra.averaged import averaged_frf
from engine.recordings.spectra.sampled import spectrum

RATE = 1000.0
NAMES = {"flat_top": "flattop", "hann": "hann", "none": "boxcar"}


def peak(work: Callable[[], Any]) -> int:
    """Return the most bytes that are held at one time beyond what was there before."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("window", NAMES)
@pytest.mark.parametrize(("segment", "overlap"), [(5001, 0.0), (512, 0.5), (511, 0.9), (8, 0.0)])
def test_densities_are_those_of_scipy_over_the_whole_array(window: Any, segment: int, overlap: float) -> None:
    values = np.random.default_rng(1).standard_normal(5001) + 2.0
    found = spectrum(values, RATE, quantity="density", window=window, segment=segment, overlap=overlap)
    cycles, expected = welch(
        values, RATE, window=NAMES[window], nperseg=segment, noverlap=round(overlap * segment), detrend=False
    )
    assert np.abs(found.value - expected).max() < 1e-12 * expected.max()
    assert found.frequency == pytest.approx(2 * np.pi * cycles, rel=1e-14)


def test_segments_of_two_million_samples_need_less_than_the_recording() -> None:
    values = np.random.default_rng(2).standard_normal(2_000_000)
    needed = peak(lambda: spectrum(values, RATE, quantity="density", window="hann", segment=10_000))
    assert (
        needed < values.nbytes
    )  # all windowed segments at once, half overlapping, would be twice that, and as much again


class Read:
    """Samples that are made when they are looked at; remembers the most that were looked at together."""

    size = 3_000_000

    def __init__(self, delay: int) -> None:
        self.delay = delay
        self.most = 0

    def __getitem__(self, span: slice) -> np.ndarray:
        start, stop, _ = span.indices(self.size)
        self.most = max(self.most, stop - start)
        time = np.arange(start - self.delay, stop - self.delay, dtype=np.float64)
        return np.sin(1e-6 * time**2) + np.sin(2e-7 * time**2)


@pytest.mark.parametrize("window", ["hann", "none"])
def test_a_response_of_three_million_samples_is_that_of_the_whole_arrays_and_reads_some_at_a_time(window: Any) -> None:
    x, y = Read(0), Read(3)
    settings = {"segment": 4096, "window": window, "overlap": 0.4}
    found = averaged_frf([(x, y)], RATE, **settings)
    assert max(x.most, y.most) <= 1 << 19
    whole = averaged_frf([(x[:], y[:])], RATE, **settings)
    np.testing.assert_array_equal(found.value, whole.value)
    np.testing.assert_array_equal(found.coherence, whole.coherence)
    assert found.doubts == whole.doubts
    # a delay of three samples, which costs three of the 4096 of a segment
    inside = (found.frequency > 0.2 * RATE) & (found.frequency < 0.4 * RATE)
    assert np.abs(found.value * np.exp(3j * found.frequency / RATE) - 1)[inside].max() < 0.01


def test_harmonics_are_those_of_the_whole_least_squares_problem_in_little_memory() -> None:
    values = np.random.default_rng(3).standard_normal(200_000)
    t = np.arange(values.size) / RATE
    orders = np.arange(1, 6)
    angle = np.multiply.outer(3.0 * t, orders)
    columns = np.concatenate([np.ones((t.size, 1)), np.cos(angle), np.sin(angle)], axis=1)
    expected = np.linalg.lstsq(columns, values, rcond=None)[0]
    found = harmonics_of_samples(values, RATE, 3.0, orders.size)
    assert found.mean == pytest.approx(expected[0], abs=1e-14)
    lines = found.amplitude * np.exp(1j * found.phase)
    assert np.abs(lines - (expected[1:6] - 1j * expected[6:])).max() < 1e-13
    # the columns alone are 18 MB
    assert peak(lambda: harmonics_of_samples(values, RATE, 3.0, orders.size)) < columns.nbytes
