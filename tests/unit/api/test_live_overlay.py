"""A recording at the instants of a picture, and the noise in it."""

from __future__ import annotations

import numpy as np
import pytest

from api.services.studies.live_overlay import at_instants, noise


def test_the_scatter_of_white_noise_is_found_beside_a_smooth_curve() -> None:
    time = np.arange(20_000) * 1e-3
    values = 50 * np.sin(2 * np.pi * 0.5 * time) + np.random.default_rng(3).normal(0.0, 0.2, time.size)
    # 20000 samples know their standard deviation to about 1 %; the median is 60 % as efficient.
    assert noise(values) == pytest.approx(0.2, rel=0.04)


def test_a_smooth_curve_and_a_very_short_one_have_no_noise() -> None:
    assert noise(np.linspace(0.0, 5.0, 1000)) == pytest.approx(0.0, abs=1e-12)
    assert noise(np.array([1.0, 2.0])) == 0.0


def test_few_samples_are_joined_by_straight_lines() -> None:
    found = at_instants(np.array([0.0, 10.0, 40.0]), 1.0, 0.0, np.linspace(0.0, 2.0, 5))
    assert found.tolist() == [0.0, 5.0, 10.0, 25.0, 40.0]


def test_of_many_samples_the_mean_is_seen() -> None:
    # 0, 1, 0, 1 ... at ten samples for each instant: the mean of ten is 0.5.
    values = np.tile([0.0, 1.0], 500)
    found = at_instants(values, 0.001, 0.2, np.linspace(0.0, 0.5, 51))
    np.testing.assert_allclose(found, 0.5, rtol=0, atol=1e-12)


def test_outside_of_the_recording_there_is_nothing() -> None:
    found = at_instants(np.ones(11), 0.1, -0.5, np.linspace(0.0, 2.0, 21))
    assert np.isnan(found).tolist() == [True] * 5 + [False] * 11 + [True] * 5
