"""The instants of samples: rate, gaps, uneven and coarse clocks."""

from __future__ import annotations

import numpy as np
import pytest

from api.formats import FormatError
from api.services.recordings.sampling import TimeAxis


def followed(instants, pieces=3, **options):
    axis = TimeAxis(**options)
    filled = []
    start = 0
    for piece in np.array_split(np.asarray(instants, float), pieces):
        axis.add(piece)
        filled.append(axis.filled(start, np.arange(start, start + piece.size, dtype=float)))
        start += piece.size
    return axis, np.concatenate(filled)


@pytest.mark.parametrize("pieces", [1, 2, 7])
def test_an_even_axis_has_its_rate(pieces):
    axis, values = followed(np.arange(1000) / 51_200, pieces)
    assert axis.rate == 51_200
    assert axis.document() | {"uneven": None} == {
        "requested": None, "first": 0, "actual": 51_200, "uneven": None, "gaps": [], "gap_count": 0, "filled": 0
    }  # fmt: skip
    assert axis.uneven() < 1e-6
    assert values.tolist() == list(range(1000))
    assert axis.remarks() == []


def test_stamps_of_a_millisecond_do_not_change_a_rate_that_was_requested():
    axis, _ = followed(np.round(np.arange(61_500) / 1000, 3), requested=1000.0)
    assert axis.rate == 1000.0


def test_a_rate_that_is_not_the_one_requested_is_found_and_said():
    axis, _ = followed(np.arange(10_000) / 5120, requested=5000.0)
    assert axis.rate == 5120
    assert "5120 samples/s where 5000 were requested" in axis.remarks()[0]


@pytest.mark.parametrize("pieces", [1, 2, 5, 10])
def test_gaps_are_filled_where_they_are(pieces):
    kept = [*range(10), *range(15, 30), *range(31, 40)]
    axis, values = followed([k / 100 for k in kept], pieces)
    expected = np.array([k if k in kept else np.nan for k in range(40)])
    where = ~np.isnan(expected)
    assert np.isnan(values).tolist() == np.isnan(expected).tolist()
    assert values[where].tolist() == list(range(len(kept)))
    assert [(gap["sample"], gap["missing"]) for gap in axis.document()["gaps"]] == [(10, 5), (25, 1)]
    assert axis.rate == 100
    assert "2 gaps, the longest of 0.06 s (5 samples) before sample 10; they are filled" in axis.remarks()[0]


def test_gaps_may_be_closed():
    axis, values = followed([0, 1, 2, 10, 11], 1, fill=False)
    assert values.tolist() == [0, 1, 2, 3, 4]
    assert axis.rate == 1
    assert "closed" in axis.remarks()[0]


def test_a_clock_that_is_coarser_than_the_samples():
    # 3000 samples/s, stamped in ms: three samples share one stamp
    axis, values = followed(np.floor(np.arange(3000) / 3) / 1000, 1)
    assert values.size == 3000
    assert abs(axis.rate - 3000) < 3  # a stamp of 1 ms in 1 s
    assert axis.document()["gap_count"] == 0


RNG = np.random.default_rng(29)
N = np.arange(5000)
JITTER = RNG.uniform(-0.4, 0.4, N.size)
EVEN = {
    "exact": N / 500,
    "written in ms": np.round(N / 512, 3),
    "cut to ms": np.floor(N / 512 * 1000) / 1000,
    "three samples in each ms": np.floor(N / 3) / 1000,
    "six digits": np.array([float(f"{n / 512:.6g}") for n in N]),
    "single precision": (N / 512.3).astype(np.float32).astype(float),
    "holes": np.delete(N, [10, 11, 40, 41, 42, 4000]) / 500,
    "a pause that is no whole number of steps": np.where(N > 2000, N / 500 + 3.3337, N / 500),
    "a late day": 57936.674 + N / 1000,
}
UNEVEN = {
    "jitter": (N + JITTER) / 500,
    "jitter in us": np.round((N + JITTER) / 500, 6),
    "jitter in ms": np.round((N + JITTER) / 500, 3),
    "jitter of one in a hundred": (N + 0.025 * JITTER) / 500,
    "steps that take turns": np.cumsum(np.where(N % 2, 0.8, 1.2)),
    "a rate that drifts": np.cumsum(1 + 0.3 * np.sin(N / 200)),
    "events": np.cumsum(RNG.exponential(size=N.size)),
}


@pytest.mark.parametrize("pieces", [1, 3])
@pytest.mark.parametrize("case", [*EVEN, *UNEVEN])
def test_what_is_even_is_told_from_what_is_not_by_the_rounding(case, pieces):
    axis, _ = followed({**EVEN, **UNEVEN}[case], pieces, judging=True)
    assert axis.regular == (case in EVEN)


def test_how_far_instants_are_off_is_told():
    axis, _ = followed(UNEVEN["jitter"], 1, judging=True)
    assert abs(axis.uneven() - 0.4) < 0.05


def test_times_of_day_pass_midnight():
    seconds = (86_399 + np.arange(0, 3, 0.01)) % 86_400
    axis, values = followed(seconds, 4, of_day=True)
    assert (axis.rate, values.size, axis.document()["gap_count"]) == (100, 300, 0)


@pytest.mark.parametrize(
    ("instants", "message"),
    [
        ([0, 1, 2, 1.5, 3], "must not run backwards, got a step of -0.5 s at sample 3"),
        ([0, 1, np.nan, 3], "must be given for every sample, got none at sample 2"),
        ([5.0], "must have at least 2 instants, got 1"),
        ([5.0, 5.0, 5.0], "must rise, got 3 equal instants"),
        ([0, 1, 2, 5e9], 'gaps must not be longer than what was recorded, .* at sample 3 .* say gaps: "close"'),
    ],
)
def test_instants_that_make_no_axis_are_refused(instants, message):
    with pytest.raises(FormatError, match=message):
        followed(instants, 1)
