"""Whether the instants of a file can be told from an even axis, or from those that are kept; the expected ones are printed and read by Python."""

from __future__ import annotations

import numpy as np
import pytest

from api.services.recordings.leaving_out import InstantsHeld
from api.services.recordings.sampling import TimeAxis

NUMBER = np.arange(5000)
RNG = np.random.default_rng(4)
STEPS = np.cumsum(RNG.uniform(0.5, 1.5, NUMBER.size))


def printed(instants, digits):
    return np.array([float(f"{instant:.{digits}f}") for instant in instants])


def all_held(instants, *, rate_kept=True, piece=700, **settings):
    axis = TimeAxis(judging=not rate_kept, **settings)
    for start in range(0, instants.size, piece):
        axis.add(instants[start : start + piece])
    held = InstantsHeld(axis, axis.rate if rate_kept else None)
    for start in range(0, instants.size, piece):
        held.add(instants[start : start + piece])
    return held.all_held


EVEN = {
    "to the bit": (NUMBER / 51_200, {}, True),
    "to the rounding of float64": (NUMBER * 0.001, {}, True),
    "from an instant of its own": (NUMBER * 0.001 + 12.345, {}, True),
    "to the last digit": (printed(NUMBER[:4999] / 3000, 5), {}, True),
    "in ms": (printed(NUMBER * 0.1, 1), {"scale": 1e-3}, True),
    "of single precision": ((NUMBER / 1024).astype(np.float32).astype(np.float64), {}, True),
    "past midnight": (printed((86_398 + NUMBER / 1000) % 86_400, 3), {"of_day": True}, True),
    "with gaps": (np.delete(NUMBER, [9, 10, 400]) / 1000, {}, True),
    "with closed gaps": (np.delete(NUMBER, [9, 10, 400]) / 1000, {"fill": False}, False),
    "off by a ten thousandth of a sample": (NUMBER / 1000 + RNG.uniform(-1e-7, 1e-7, NUMBER.size), {}, False),
    "of a coarse clock": (np.floor(NUMBER / 10) / 100, {}, False),
    "of a rate that has more digits than it is told with": (NUMBER / 714.1428571428571, {}, False),
}


@pytest.mark.parametrize("case", EVEN)
def test_instants_on_an_even_axis(case):
    instants, settings, expected = EVEN[case]
    assert all_held(instants, **settings) == expected


def test_one_instant_that_is_not_its_place_is_seen_wherever_it_is():
    for at in (1, 300, 2500, NUMBER.size - 2):
        instants = printed(NUMBER / 1000, 3)
        instants[at] = instants[at - 1]
        assert not all_held(instants)


def test_few_instants_with_more_digits_than_the_others():
    instants = printed(NUMBER / 1000, 3)
    assert all_held(instants)
    instants[1500] += 1e-4
    assert not all_held(instants)


@pytest.mark.parametrize(
    ("instants", "settings", "expected"),
    [
        (STEPS - STEPS[0], {}, True),
        (printed(STEPS + 5.0, 4), {}, True),
        (printed(STEPS + 5.0, 4), {"scale": 1e-3}, True),
        (STEPS / 3.0, {"scale": 1e-3}, False),  # what was multiplied is not each of them to the bit when it is divided
    ],
)
def test_instants_that_are_kept_beside_the_samples(instants, settings, expected):
    assert all_held(instants, rate_kept=False, **settings) == expected
