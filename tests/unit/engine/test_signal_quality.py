"""What is noticed in samples: missing ones, clipping, channels that never move."""

from __future__ import annotations

import numpy as np
import pytest

from engine.recordings.signal_quality import ChannelQuality, remarks

TIME = np.arange(50_000) / 5000
SINE = np.sin(2 * np.pi * 3.3 * TIME)


def looked_at(values, pieces=1):
    quality = ChannelQuality()
    for piece in np.array_split(np.asarray(values, float), pieces):
        quality.add(piece)
    return quality.document()


@pytest.mark.parametrize("pieces", [1, 3, 997])
def test_a_clipped_sine_is_noticed_at_both_ends(pieces):
    found = looked_at(np.clip(SINE, -0.75, 0.9), pieces)
    high, low = np.clip(SINE, -0.75, 0.9) == 0.9, np.clip(SINE, -0.75, 0.9) == -0.75
    assert found["clipped"]["high"] == {"value": 0.9, "samples": high.sum(), "stretches": 33}
    assert found["clipped"]["low"] == {"value": -0.75, "samples": low.sum(), "stretches": 33}
    said = remarks("x", found, SINE.size)
    assert said[0].startswith("x may be clipped: it stays at 0.9 for")


@pytest.mark.parametrize(
    "values",
    [
        SINE,
        np.round(SINE * 100) / 100,  # a coarse converter: its peaks are flat, and rounded
        np.random.default_rng(0).normal(size=20_000),
        np.sign(SINE),  # a square wave stays at its extremes by nature
        1 - np.exp(-TIME) + 1e-12,  # a position that settles
    ],
)
def test_signals_that_are_not_clipped(values):
    assert looked_at(values, 7)["clipped"] == {}


@pytest.mark.parametrize("pieces", [1, 4, 1000])
def test_missing_samples_are_counted_where_they_are(pieces):
    values = SINE.copy()
    values[[5, 6, 7, 20_000]] = np.nan
    values[-2:] = np.nan
    found = looked_at(values, pieces)
    assert (found["missing"], found["missing_stretches"]) == (6, [[5, 8], [20_000, 20_001], [49_998, 50_000]])
    assert (found["minimum"], found["maximum"]) == (np.nanmin(values), np.nanmax(values))
    assert "x has 6 missing samples of 50000" in remarks("x", found, 50_000)[0]


def test_a_constant_channel():
    found = looked_at(np.full(40_000, 2.5), 3)
    assert found["constant"]
    assert remarks("x", found, 40_000) == ["x never changes: is its sensor connected?"]
    assert not looked_at([1.0, 2.0])["constant"]


def test_nothing_at_all():
    found = looked_at(np.full(10, np.nan))
    assert (found["minimum"], found["maximum"], found["missing"], found["constant"]) == (None, None, 10, False)


@pytest.mark.parametrize("size", [1e-300, 1e300, 1.7e308])
@pytest.mark.parametrize("pieces", [1, 7])
def test_numbers_of_any_size_are_looked_at_like_others(size, pieces):
    """Squares of 1e300 are beyond all numbers, and so is the way from -1.7e308 to 1.7e308: warnings fail this test."""
    values = np.clip(SINE, -0.75, 0.9)
    found = looked_at(size * values, pieces)
    assert found["clipped"]["high"] == {"value": size * 0.9, "samples": (values == 0.9).sum(), "stretches": 33}
    steps = np.tile([-1.7e308, 1.7e308], 40) * np.linspace(0.5, 1.0, 80)
    assert looked_at(steps, pieces)["clipped"] == {}
