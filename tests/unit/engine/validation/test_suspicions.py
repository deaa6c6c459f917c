"""Recordings with one known defect each: the suspicion that belongs to it finds its size, the others stay silent or behind."""

from __future__ import annotations

import numpy as np
import pytest

from engine.recordings.validation.comparison import Comparison, directions, rate
from engine.recordings.validation.delay import delay
from engine.recordings.validation.diagnosis import diagnose
from engine.recordings.validation.direction import direction
from engine.recordings.validation.friction import friction
from engine.recordings.validation.gain import gain, unit_of
from engine.recordings.validation.offset import offset
from engine.recordings.validation.saturation import clipped, saturation
from engine.recordings.validation.steps import Movable, steps
from tests.unit.engine.validation.lags import H, chirp, lag


def comparison(measured: np.ndarray, simulated: np.ndarray, **more) -> Comparison:
    return Comparison(name="y", measured=measured, simulated=simulated, sample_time=H, **more)


NOISE = np.random.default_rng(4).normal(scale=0.005, size=4000)


def test_a_constant_is_an_offset_unless_it_is_estimated() -> None:
    y = lag(chirp())
    found = offset(comparison(y + 0.25 + NOISE, y))
    assert found is not None
    assert found.values["offset"] == pytest.approx(0.25, abs=1e-3)
    # what is left is the noise: 0.005 / rms of the measurement
    rms = np.sqrt(np.mean((y + 0.25 + NOISE) ** 2))
    assert found.relative_error_percent == pytest.approx(100 * 0.005 / rms, rel=0.05)
    assert offset(comparison(y + 0.25, y, constant=True)) is None
    assert offset(comparison(y + NOISE, y)) is None


@pytest.mark.parametrize(("factor", "words"), [(1000.0, "milli"), (57.29577951308232, "degrees"), (1.7, "static gain")])
def test_a_wrong_scale_is_told_with_the_unit_that_has_it(factor, words) -> None:
    y = lag(chirp())
    found = gain(comparison(factor * y, y))
    assert found is not None
    assert found.values["gain"] == pytest.approx(factor, rel=1e-12)
    assert found.relative_error_percent == pytest.approx(0.0, abs=1e-9)
    assert words in found.sentence


def test_a_wrong_sign_is_told() -> None:
    y = lag(chirp())
    found = gain(comparison(-y, y))
    assert found is not None
    assert "sign" in found.sentence


def test_units_are_recognised_either_way_round() -> None:
    assert unit_of(1 / 25.4) == "inches"
    assert unit_of(3.0) is None
    assert unit_of(0.0) is None


@pytest.mark.parametrize("late", [0.0123, -0.0047])
def test_a_delay_is_found_between_the_samples(late) -> None:
    time = H * np.arange(4000)
    swing = lambda t: np.sin(2 * np.pi * (0.5 * t + t**2))  # noqa: E731
    found = delay(comparison(swing(time - late), swing(time)))
    assert found is not None
    # the chirp is no straight line between samples: the curvature of the last 8.5 Hz moves the estimate by 1e-6 s
    assert found.values["delay"] == pytest.approx(late, abs=2e-5)
    assert found.relative_error_percent < 1.5
    assert ("later" in found.sentence) == (late > 0)


def test_no_delay_is_claimed_where_there_is_none() -> None:
    y = lag(chirp())
    assert delay(comparison(y + NOISE, y)) is None
    assert delay(comparison(y[:5] + NOISE[:5], y[:5])) is None


def test_a_sensor_at_the_end_of_its_range_is_seen() -> None:
    y = lag(chirp())
    found = saturation(comparison(np.minimum(y, 0.3), y))
    assert found is not None
    assert found.values["level"] == pytest.approx(0.3)
    assert found.values["share_percent"] == pytest.approx(100 * np.mean(y >= 0.3), abs=0.1)
    assert found.relative_error_percent == pytest.approx(0.0, abs=1e-9)
    # a model that has the limit itself fails for another reason
    assert saturation(comparison(np.minimum(y, 0.3), 1.2 * np.minimum(y, 0.3))) is None


def test_peaks_are_no_clipping() -> None:
    assert clipped(chirp()) is None
    assert clipped(np.full(100, 3.0)) is None


def test_a_speed_that_is_never_exceeded_is_a_limit() -> None:
    time = H * np.arange(6000)
    demand = 0.1 * np.sin(2 * np.pi * 0.5 * time)
    # a sine of peak speed 0.314 m/s followed at no more than 0.15 m/s
    follower = np.zeros(time.size)
    for i in range(1, time.size):
        follower[i] = follower[i - 1] + np.clip(demand[i] - follower[i - 1], -0.15 * H, 0.15 * H)
    found = saturation(comparison(follower, demand))
    assert found is not None
    assert found.values["level"] == pytest.approx(0.15, rel=0.01)
    assert "speed" in found.sentence


def test_dry_friction_is_half_the_width_of_the_loop() -> None:
    time = H * np.arange(4000)
    x = 0.01 * np.sin(2 * np.pi * time)
    force = 300.0 * np.gradient(x, H)
    found = friction(
        Comparison(
            name="force", measured=force + 8.47 * np.sign(np.cos(2 * np.pi * time)), simulated=force, sample_time=H,
            inputs={"displacement": x},
        )
    )  # fmt: skip
    assert found is not None
    assert found.values["half_width"] == pytest.approx(8.47, rel=0.02)
    assert "displacement" in found.sentence


def test_missing_viscous_friction_is_not_called_dry() -> None:
    time = H * np.arange(4000)
    x = 0.01 * np.sin(2 * np.pi * time)
    velocity = np.gradient(x, H)
    measured = Comparison(
        name="force", measured=500 * velocity, simulated=300 * velocity, sample_time=H, inputs={"displacement": x}
    )
    assert friction(measured) is None


def _tangents(u: np.ndarray) -> dict[str, np.ndarray]:
    """Return dy/dk and dy/dtau of the lag at k = 1, tau = 0.05 s by central differences of the formula."""
    return {
        "k": (lag(u, k=1.001) - lag(u, k=0.999)) / 0.002,
        "tau": (lag(u, tau=0.0501) - lag(u, tau=0.0499)) / 0.0002,
    }


K = Movable(parameter="k", value=1.0, lower=0.1, upper=10.0, unit="")
TAU = Movable(parameter="tau", value=0.05, lower=0.001, upper=1.0, unit="s")


@pytest.mark.parametrize(("k", "tau", "first", "suggested"), [(1.08, 0.05, "k", 1.08), (1.0, 0.053, "tau", 0.053)])
def test_one_step_names_the_parameter_that_is_wrong(k, tau, first, suggested) -> None:
    u = chirp()
    found = steps([comparison(lag(u, k=k, tau=tau), lag(u), tangents=_tangents(u))], [K, TAU])
    assert found is not None
    assert found.alone[0].parameter == first
    # k enters linearly: exact; tau by a straight line
    assert found.alone[0].suggested == pytest.approx(suggested, rel=5e-3)
    assert found.alone[0].relative_error_percent < 0.1 * found.present_error_percent
    assert found.together_error_percent <= found.alone[0].relative_error_percent


def test_a_step_keeps_to_the_bounds_and_says_what_is_left() -> None:
    u = chirp()
    narrow = Movable(parameter="k", value=1.0, lower=0.9, upper=1.05, unit="")
    found = steps([comparison(lag(u, k=1.2), lag(u), tangents=_tangents(u))], [narrow])
    assert found is not None
    assert found.alone[0].suggested == 1.05
    # 1.2 y beside 1.05 y: an eighth of the measurement is left
    assert found.alone[0].relative_error_percent == pytest.approx(100 * 0.15 / 1.2, rel=1e-6)


def test_a_parameter_without_influence_stays_where_it_is() -> None:
    u = chirp()
    silent = Movable(parameter="zero", value=2.0, lower=0.0, upper=9.0, unit="")
    found = steps([comparison(lag(u, k=1.1), lag(u), tangents=_tangents(u) | {"zero": np.zeros(u.size)})], [silent, K])
    assert found is not None
    assert [step.parameter for step in found.alone] == ["k", "zero"]
    assert found.alone[1].suggested == 2.0
    assert found.together["zero"] == 2.0


def test_two_directions_with_two_lags_are_told_apart() -> None:
    """The lag of a load that hangs: 0.04 s up, 0.06 s down; the model has 0.05 s for both."""
    u = np.sign(np.sin(2 * np.pi * 0.8 * H * np.arange(8000)))
    y = np.zeros(u.size)
    for i in range(1, u.size):
        tau = 0.04 if u[i - 1] > y[i - 1] else 0.06
        a = np.exp(-H / tau)
        y[i] = a * y[i - 1] + (1 - a) * u[i - 1]
    measured = comparison(y, lag(u), tangents={"tau": _tangents(u)["tau"]})
    found = direction(measured, [TAU])
    assert found is not None
    assert found.values["tau rising"] == pytest.approx(0.04, rel=0.1)
    assert found.values["tau falling"] == pytest.approx(0.06, rel=0.1)
    same = comparison(lag(u, tau=0.055), lag(u), tangents={"tau": _tangents(u)["tau"]})
    assert direction(same, [TAU]) is None


def test_the_most_helpful_comes_first_and_a_perfect_model_needs_nothing() -> None:
    u = chirp()
    y = lag(u)
    found = diagnose([comparison(1000 * y, y, tangents=_tangents(u), inputs={"u": u})], [K, TAU])
    assert found.remedies["y"][0].kind == "gain"
    assert found.steps is not None
    assert found.steps.alone[0].parameter == "k"
    assert diagnose([comparison(y, y, inputs={"u": u})]).remedies == {"y": ()}


def test_nothing_can_be_said_of_a_channel_that_is_0() -> None:
    found = diagnose([comparison(np.zeros(100), np.ones(100), tangents={"k": np.ones(100)})], [K])
    assert found.remedies == {"y": ()}
    assert found.steps is None


def test_directions_follow_the_motion_and_not_the_noise() -> None:
    time = H * np.arange(4000)
    x = np.sin(2 * np.pi * time)
    noisy = x + np.random.default_rng(1).normal(scale=0.01, size=4000)
    truth = np.sign(np.cos(2 * np.pi * time))
    moving = np.abs(np.cos(2 * np.pi * time)) > 0.3
    assert np.mean(directions(rate(noisy, H))[moving] == truth[moving]) > 0.99
    assert rate(np.arange(10.0), 0.5) == pytest.approx(np.full(10, 2.0))
    assert not directions(np.zeros(5)).any()


@pytest.mark.parametrize(
    ("measured", "simulated", "words"),
    [
        (np.zeros(1), np.zeros(1), "at least 2 samples, got 1"),
        (np.zeros(4), np.zeros(5), "simulated must have 4 samples"),
        (np.zeros(4), np.array([0.0, np.inf, 0.0, 0.0]), "simulated must be finite"),
    ],
)
def test_signals_that_cannot_be_compared_are_refused(measured, simulated, words) -> None:
    with pytest.raises(ValueError, match=words):
        comparison(measured, simulated)
