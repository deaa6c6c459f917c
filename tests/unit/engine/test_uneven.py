"""Uneven samples on an even axis, beside numpy's and scipy's own interpolation; holes stay holes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from engine.model.errors import ProcessingError
from engine.recordings.processing.resample import Resample
from engine.recordings.processing.uneven import evened

RNG = np.random.default_rng(3)
TIME = (np.arange(2000) + RNG.uniform(-0.4, 0.4, 2000)) / 500
TIME -= TIME[0]
VALUES = np.sin(2 * np.pi * 20 * TIME) + TIME
GRID = np.arange(int(TIME[-1] * 1000) + 1) / 1000


def test_both_methods_are_those_of_the_libraries():
    np.testing.assert_allclose(evened(TIME, VALUES, rate=1000), np.interp(GRID, TIME, VALUES), rtol=0, atol=1e-14)
    cubic = evened(TIME, VALUES, rate=1000, method="cubic")
    np.testing.assert_allclose(cubic, CubicSpline(TIME, VALUES)(GRID), rtol=0, atol=1e-13)
    truth = np.sin(2 * np.pi * 20 * GRID) + GRID
    assert np.abs(cubic - truth).max() < 2e-3
    assert np.abs(evened(TIME, VALUES, rate=1000) - truth).max() < 3e-2


def test_nothing_is_invented_across_holes():
    time = np.array([0.0, 1.0, 2.0, 3.0, 3.5, 20.0, 21.0])
    values = np.array([0.0, 1.0, np.nan, 3.0, 3.5, 20.0, 21.0])
    found = evened(time, values, rate=2.0)
    grid = np.arange(43) / 2
    known = (grid <= 1.0) | ((grid >= 3.0) & (grid <= 3.5)) | (grid >= 20.0)
    np.testing.assert_array_equal(np.isfinite(found), known)
    np.testing.assert_allclose(found[known], grid[known], rtol=0, atol=1e-14)
    assert np.isfinite(evened(time, values, rate=2.0, longest=17.0)[grid >= 3.0]).all()
    assert np.isnan(evened(time, np.full(7, np.nan), rate=2.0, method="cubic")).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 100.0}, r"rate must be at least the mean one of the uneven instants \(499.931 samples/s"),
        ({"rate": float("nan")}, "rate must be at least the mean one"),
        ({"method": "nearest"}, "method must be one of linear, cubic, got 'nearest'"),
        ({"time": TIME[::-1]}, "instants must rise to be resampled, .* they do not at sample 1"),
        ({"time": np.round(TIME, 2)}, "instants must rise to be resampled"),
        ({"time": TIME[:1], "values": VALUES[:1]}, "instants must rise to be resampled, and be at least 2"),
    ],
)
def test_what_cannot_be_resampled_is_refused(change, message):
    asked = {"time": TIME, "values": VALUES, "rate": 1000.0, **change}
    with pytest.raises(ProcessingError, match=message):
        evened(asked.pop("time"), asked.pop("values"), **asked)


@pytest.mark.parametrize(("given", "name"), [({"method": "nearest"}, "method"), ({"longest": 0.0}, "longest")])
def test_a_step_that_makes_no_sense_is_refused_at_its_place(given, name):
    with pytest.raises(ProcessingError) as caught:
        Resample(rate=10.0, **given)
    assert caught.value.at == (name,)
