"""What is wrong with a channel is seen while it is recorded: overload, drop-out, missing values; and a range that is too large."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from agent.settings import InputSettings
from agent.watching import Watch

RATE = 1000.0
Values = np.ndarray[Any, np.dtype[np.float64]]


def entry(name: str = "position", **more: Any) -> InputSettings:
    return InputSettings(name=name, channel=f"Dev1/{name}", **more)


def noise(count: int = 4000, *, seed: int = 1, rms: float = 1e-3) -> Values:
    return np.asarray(rms * np.random.default_rng(seed).standard_normal(count))


def watched(values: Values, *inputs: InputSettings, cuts: Any = (), **ranges: tuple[float, ...]) -> Watch:
    """Look at values (channels, n), or (n,) of the usual channel, in blocks that end at some samples."""
    watch = Watch(inputs or (entry(),), rate=RATE, ranges={f"Dev1/{name}": limits for name, limits in ranges.items()})
    for block in np.split(np.atleast_2d(values), sorted(cuts), axis=1):
        watch.take(block)
    return watch


def seen(watch: Watch, name: str = "position") -> dict[str, Any]:
    found = dict(watch.facts()["channels"][name])
    del found["largest"]
    return found


def test_a_channel_that_reaches_its_range_is_overloaded() -> None:
    values = noise()
    values[1500:1503], values[2000], values[2001] = 4.99751, -7.0, 4.9974
    watch = watched(values, entry(range=5.0), position=(1.0, 5.0, 10.0))
    assert seen(watch) == {"overload": {"count": 4, "first": 1.5}}
    assert watch.told() == "overload: position"
    assert watch.facts()["channels"]["position"]["largest"] == 7.0
    detail = "position reached its range of 5 V: 4 samples, first at 1.5 s; set range = 10"
    assert watch.facts()["warnings"] == [{"channel": "position", "level": "warning", "detail": detail}]
    widest = watched(values, entry(range=5.0), position=(1.0, 5.0)).facts()["warnings"][0]["detail"]
    assert widest.endswith("the hardware has no larger one: lower the signal")


@pytest.mark.parametrize(
    ("more", "limit", "unit"),
    [
        ({"kind": "bridge", "range": 0.025}, 0.025, "V/V"),
        ({"kind": "current", "range": 0.02}, 0.02, "A"),
        ({"kind": "acceleration", "range": 5.0, "sensitivity": 0.01}, 5.0, "V"),
        ({"kind": "voltage", "range": 10.0, "sensitivity": 100.0, "offset": 3.0}, 10.0, "V"),
    ],
)
def test_the_range_is_that_of_what_the_hardware_measures(more, limit, unit) -> None:
    assert seen(watched(np.array([0.0, 0.9994 * limit]), entry(**more))) == {}
    over = watched(np.array([0.0, -0.9996 * limit]), entry(**more))
    assert seen(over)["overload"]["count"] == 1
    (warning,) = over.facts()["warnings"]
    assert f"reached its range of {limit:g} {unit}:" in warning["detail"]
    assert warning["detail"].endswith("; set a larger range, or lower the signal")


@pytest.mark.parametrize("kind", ["encoder", "digital", "thermocouple"])
def test_what_has_no_range_and_may_stand_still_is_left_alone(kind) -> None:
    values = np.concatenate([300.0 + noise(), np.full(1000, 300.0)])
    values[0] = np.inf  # missing, and beyond no range
    assert seen(watched(values, entry(kind=kind, pulses=100.0 if kind == "encoder" else 0.0))) == {
        "missing": {"count": 1, "first": 0.0}
    }


@pytest.mark.parametrize("cuts", [[], [1250], [1000], [1199, 1200, 1201], range(1, 6000, 7), range(1, 6000)])
def test_a_channel_with_noise_that_stays_the_same_has_dropped_out(cuts) -> None:
    values = noise(6000)
    values[1001:1200], values[3001:3202] = values[1000], values[3000]
    values[5799:] = 0.5  # goes on to the end
    assert np.count_nonzero(np.diff(values) == 0) == 199 + 201 + 200
    assert seen(watched(values, cuts=cuts)) == {"drop-out": {"count": 200 + 202 + 201, "first": 1.0}}
    values[1199] = 9.0
    assert seen(watched(values, cuts=cuts)) == {"drop-out": {"count": 202 + 201, "first": 3.0}}


HUM = 2.0 * np.sin(2 * np.pi * 50.0 / RATE * np.arange(4000))


@pytest.mark.parametrize("cuts", [[], [2999, 3000, 3001], range(3, 4000, 4)])
@pytest.mark.parametrize("bits", [16, 24])
def test_noise_is_seen_beneath_hum(cuts, bits) -> None:
    step = 20.0 / 2**bits
    values = step * np.round((HUM + noise(rms=5 * step)) / step)
    values[3000:] = 0.0  # the cable breaks
    assert seen(watched(values, cuts=cuts)) == {"drop-out": {"count": 1000, "first": 3.0}}


def test_stretches_are_counted_as_one_would_by_hand() -> None:
    rng = np.random.default_rng(7)
    for _ in range(30):
        # Equal values come in stretches of up to 500.
        lengths = rng.choice([1, 1, 1, 1, 150, 199, 200, 201, 500], size=60)
        values = np.repeat(noise(60, seed=int(rng.integers(1 << 30))), lengths)
        values = np.concatenate([noise(1500), values, noise(3)])
        starts = 1500 + np.concatenate([[0], np.cumsum(lengths)[:-1]])
        long = lengths >= 200
        cuts = np.unique(rng.integers(1, values.size, size=40))
        found = seen(watched(values, cuts=cuts))
        expected = (
            {"drop-out": {"count": int(lengths[long].sum()), "first": float(starts[long][0] / RATE)}}
            if long.any()
            else {}
        )
        assert found == expected


SETTLING = np.cos(2 * np.pi * 21.7 / RATE * np.arange(6000)) * np.exp(-np.arange(6000) / 250.0)
"""A vibration that comes to rest."""


@pytest.mark.parametrize(
    "values",
    [
        np.zeros(5000),  # at rest from the beginning: without noise nobody can tell
        np.concatenate([np.sin(np.arange(3000) / 50), np.zeros(1000)]),  # a simulation without noise
        np.concatenate([HUM[:3000], np.zeros(1000)]),
        SETTLING,
        np.concatenate([2.0**-20 * np.round(2.0**20 * SETTLING), np.zeros(1000)]),  # to a converter's steps: no noise
        np.concatenate([np.round(noise(4000, rms=0.5), 2), np.zeros(1000)]),  # few digits, or a converter of few bits
        np.concatenate([noise(4000), np.full(199, 0.1), noise(10)]),  # too short
    ],
)
def test_what_may_stand_still_has_not_dropped_out(values) -> None:
    assert seen(watched(values)) == {}


def test_a_channel_that_is_cut_off_at_its_range_has_not_dropped_out() -> None:
    values = np.concatenate([noise(), np.full(500, 10.0), noise(10), np.full(500, -10.0)])
    assert seen(watched(values, cuts=[4200])) == {"overload": {"count": 1000, "first": 4.0}}


def test_at_a_high_rate_a_stretch_must_last() -> None:
    watch = Watch([entry()], rate=50_000.0)
    watch.take(np.concatenate([noise(), np.zeros(9_999), noise()])[None, :])
    assert seen(watch) == {}
    watch.take(np.zeros((1, 10_000)))
    assert seen(watch)["drop-out"]["count"] == 10_000


def test_missing_values_are_counted_and_do_not_spoil_the_rest() -> None:
    values = noise()
    values[[7, 8, 900]] = np.nan, np.inf, -np.inf
    watch = watched(values, cuts=[8])
    assert seen(watch)["missing"] == {"count": 3, "first": 0.007}
    assert seen(watch)["overload"]["count"] == 2
    assert watch.told() == "overload: position; missing: position"
    assert watch.facts()["channels"]["position"]["largest"] == pytest.approx(np.abs(noise()).max(), rel=0.2)


def test_channels_are_told_apart() -> None:
    values = np.stack([noise(seed=1), noise(seed=2), np.full(4000, 9.999)])
    values[1, 3000:] = 1e-5
    watch = watched(values, entry("a"), entry("b"), entry("c"))
    assert watch.told() == "overload: c; drop-out: b"
    assert [seen(watch, name) for name in "abc"] == [
        {},
        {"drop-out": {"count": 1000, "first": 3.0}},
        {"overload": {"count": 4000, "first": 0.0}},
    ]


@pytest.mark.parametrize(
    ("largest", "given", "ranges", "advice"),
    [
        (0.31, 10.0, (0.2, 0.5, 10.0), "position: 0.31 V of 10 V used; range = 0.5 would resolve it 20 times finer"),
        (0.42, 10.0, (0.2, 0.5, 10.0), ""),  # 20 % to spare are not there
        (0.31, 0.5, (0.2, 0.5, 10.0), ""),
        # The hardware is at 5 V for a range of 3 V.
        (0.5, 3.0, (5.0, 1.0, 10.0), "position: 0.5 V of 5 V used; range = 1 would resolve it 5 times finer"),
        (1.0, 3.0, (5.0, 1.0, 10.0), ""),
        (0.31, 10.0, (10.0,), ""),
        (0.31, 10.0, (), ""),
        (0.0, 10.0, (0.2, 10.0), ""),
    ],
)
def test_a_finer_range_is_advised_where_the_hardware_has_one(largest, given, ranges, advice) -> None:
    watch = watched(np.array([0.0, -largest, largest / 2]), entry(range=given), position=ranges)
    told = [{"channel": "position", "level": "information", "detail": advice}] if advice else []
    assert watch.facts() == {"channels": {"position": {"largest": largest}}, "warnings": told}


def test_no_other_range_is_advised_of_what_is_not_in_volts() -> None:
    watch = watched(np.array([1e-4]), entry(kind="bridge", range=0.025), position=(0.2, 10.0))
    assert watch.facts()["warnings"] == []
