"""Movements, shapers and delays of commands: limits met, published amplitudes and vibrations, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.model.errors import SignalError
from engine.signals import make
from engine.signals._shapers import impulses


def derivative(signal, order: int, points: int = 4001):
    """Return (t, central difference of order 1, 2 or 3) over the movement."""
    start, end = signal.breakpoints()[0], signal.end()
    t, h = np.linspace(start, end, points, retstep=True)
    values = signal.value(t)
    for _ in range(order):
        values = np.diff(values) / h
    return values


def test_trapezoid_keeps_its_limits_and_takes_the_shortest_time():
    move = make("trapezoid", {"distance": 2, "max_velocity": 1, "max_acceleration": 4, "start": 0.5})
    # h/v + v/a = 2 + 0.25
    assert move.breakpoints() == pytest.approx((0.5, 0.75, 2.5, 2.75), rel=1e-15)
    assert (move.end(), move.final(), move.degree()) == (pytest.approx(2.75), 2.0, 2)
    # v²/(2a) = 0.125 of the way in the first ramp, half of the way at half time, straight in between
    np.testing.assert_allclose(
        move.value(np.array([0.5, 0.75, 1.625, 2.5, 2.75, 9.0])), [0, 0.125, 1, 1.875, 2, 2], atol=1e-15
    )
    assert np.abs(derivative(move, 1)).max() == pytest.approx(1.0, rel=1e-9)
    assert np.abs(derivative(move, 2)).max() == pytest.approx(4.0, rel=1e-6)
    assert move.value(np.array([0.0, 0.49])).tolist() == [0, 0]


def test_trapezoid_of_a_short_distance_is_a_triangle_and_goes_backwards_too():
    move = make("trapezoid", {"distance": -1, "max_velocity": 10, "max_acceleration": 4})
    # two ramps of sqrt(h/a) = 0.5
    assert move.breakpoints() == pytest.approx((0.0, 0.5, 1.0), rel=1e-15)
    np.testing.assert_allclose(move.value(np.array([0.25, 0.5, 1.0])), [-0.125, -0.5, -1], atol=1e-15)


@pytest.mark.parametrize(
    ("distance", "velocity", "acceleration", "jerk", "end"),
    [
        # all three limits reached: T = h/v + T_a, T_a = a/j + v/a
        (1, 1, 4, 40, 1 + 0.35),
        # the acceleration limit is never reached: T_a = 2 sqrt(v/j)
        (2, 1, 4, 4, 2 + 1),
        # the velocity limit is never reached: T = 2 T_a, T_a = (a/j + sqrt((a/j)² + 4 h/a))/2
        (1, 10, 4, 40, 0.1 + math.sqrt(0.01 + 1)),
        # neither is reached: T = 4 (h/(2j))^(1/3)
        (1, 10, 40, 32, 4 * 0.25),
        # the edge between the last two, h = 2 a³/j² exactly
        (0.25, 10, 2, 8, 4 * 0.25),
    ],
)
def test_s_curve_keeps_every_limit_and_takes_the_shortest_time(distance, velocity, acceleration, jerk, end):
    move = make(
        "s_curve",
        {
            "distance": distance,
            "max_velocity": velocity,
            "max_acceleration": acceleration,
            "max_jerk": jerk,
            "start": 1,
        },
    )
    assert move.end() == pytest.approx(1 + end, rel=1e-14)
    assert (move.final(), move.degree()) == (distance, 3)
    middle = np.array([1.0, 1 + end / 2, 1 + end * (1 - 1e-14), 99.0])
    np.testing.assert_allclose(move.value(middle), [0, distance / 2, distance, distance], rtol=1e-13)
    for order, limit in ((1, velocity), (2, acceleration), (3, jerk)):
        assert np.abs(derivative(move, order, 401)).max() <= limit * (1 + 1e-5)
    assert np.abs(derivative(move, 3, 401)).max() == pytest.approx(jerk, rel=1e-5)


@pytest.mark.parametrize("kind", ["trapezoid", "s_curve"])
def test_no_distance_is_no_movement(kind):
    limits = {"max_velocity": 1, "max_acceleration": 1} | ({"max_jerk": 1} if kind == "s_curve" else {})
    move = make(kind, {"distance": 0, "start": 2, **limits})
    assert (move.breakpoints(), move.end(), move.final(), move.degree()) == ((2.0,), 2.0, 0.0, 0)
    assert move.value(np.array([0.0, 5.0])).tolist() == [0, 0]


def test_multisine_excites_its_lines_equally_and_no_others():
    signal = make("multisine", {"amplitude": 0.5, "fundamental": 2.0, "harmonics": [1, 3, 4]})
    t = np.arange(64) * signal.repeats_after() / 64
    lines = np.abs(np.fft.rfft(signal.value(t))) / 32
    np.testing.assert_allclose(lines[:8], [0, 0.5, 0, 0.5, 0.5, 0, 0, 0], atol=1e-14)
    assert (signal.repeats_after(), signal.final(), signal.end()) == (pytest.approx(math.pi), None, None)


def test_multisine_of_many_lines_keeps_a_low_peak():
    signal = make("multisine", {"fundamental": 1.0, "harmonics": list(range(1, 65))})
    values = signal.value(np.linspace(0, 2 * np.pi, 4096, endpoint=False))
    # Schroeder: about 1.7 times the rms; zero phases would give sqrt(2 K) = 11.3
    assert np.abs(values).max() / np.sqrt(np.mean(values**2)) < 2.0


AMPLITUDES = {
    "zv": [0.578286, 0.421714],
    "zvd": [0.334415, 0.487743, 0.177843],
}


@pytest.mark.parametrize("shaper", AMPLITUDES)
def test_amplitudes_at_a_damping_ratio_of_a_tenth(shaper):
    found = impulses(shaper, frequency=3.0, damping_ratio=0.1, tolerance=0.05)
    np.testing.assert_allclose(found.amplitudes, AMPLITUDES[shaper], atol=1e-6)
    damped = 3.0 * math.sqrt(1 - 0.01)
    np.testing.assert_allclose(found.times, np.arange(len(found.times)) * math.pi / damped, rtol=1e-14)


def test_amplitudes_of_the_ei_shaper_are_near_the_published_curve_fit():
    # W. Singhose's fit for V = 5 %, ζ = 0.1
    found = impulses("ei", frequency=1.0, damping_ratio=0.1, tolerance=0.05)
    np.testing.assert_allclose(found.amplitudes, [0.354881, 0.452998, 0.192121], atol=0.002)


def vibration(shaper: str, ratio, damping_ratio: float = 0.0, tolerance: float = 0.05):
    """Return what vibrates after the impulses at ``ratio`` times the frequency they are made for, relative to one impulse."""
    made = impulses(shaper, frequency=1.0, damping_ratio=damping_ratio, tolerance=tolerance)
    ratio = np.asarray(ratio)[..., None]
    pole = damping_ratio + 1j * math.sqrt(1 - damping_ratio**2)
    total = (made.amplitudes * np.exp(pole * ratio * (made.times - made.times[-1] * damping_ratio / pole))).sum(axis=-1)
    return np.abs(total)


@pytest.mark.parametrize(
    ("shaper", "beside", "width"),
    # without damping: |cos(π/2 · 0.9)|^n; width of the band below 5 %; EI with V = 5 %
    [("zv", 0.1564, 0.0637), ("zvd", 0.0245, 0.2871), ("ei", 0.0243, 0.3995)],
)
def test_residual_vibration_at_a_wrong_frequency_and_width_of_the_5_percent_band(shaper, beside, width):
    assert vibration(shaper, 0.9) == pytest.approx(beside, abs=1e-4)
    assert vibration(shaper, 1.1) == pytest.approx(beside, abs=1e-4)
    ratios = np.linspace(0.7, 1.3, 60001)
    inside = ratios[vibration(shaper, ratios) <= 0.05 + 1e-12]
    assert inside[-1] - inside[0] == pytest.approx(width, abs=1e-4)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.02, 0.1, 0.3])
@pytest.mark.parametrize("tolerance", [0.001, 0.05, 0.15])
def test_ei_leaves_its_tolerance_at_the_frequency_and_nothing_at_one_below_and_one_above(damping_ratio, tolerance):
    made = impulses("ei", frequency=1.0, damping_ratio=damping_ratio, tolerance=tolerance)
    assert made.amplitudes.sum() == pytest.approx(1.0, rel=1e-15)
    assert (made.amplitudes > 0).all()
    assert vibration("ei", 1.0, damping_ratio, tolerance) == pytest.approx(tolerance, rel=1e-12)
    for ratios in (np.linspace(0.6, 1.0, 2001), np.linspace(1.0, 1.5, 2001)):
        assert vibration("ei", ratios, damping_ratio, tolerance).min() < 1e-3


@pytest.mark.parametrize("shaper", ["zv", "zvd", "zvdd"])
@pytest.mark.parametrize("damping_ratio", [0.0, 0.1, 0.7])
def test_zero_vibration_shapers_leave_nothing_of_their_mode(shaper, damping_ratio):
    assert vibration(shaper, 1.0, damping_ratio) == pytest.approx(0.0, abs=1e-14)


def test_shaped_step_is_a_staircase():
    signal = make("shaped", {"shaper": "zvd", "frequency": math.pi, "command": {"kind": "step", "start": 1.0}})
    assert signal.breakpoints() == pytest.approx((1.0, 2.0, 3.0))
    assert signal.value(np.array([0.5, 1.0, 1.5, 2.0, 3.0, 9.0])).tolist() == [0, 0.25, 0.25, 0.75, 1, 1]
    assert (signal.end(), signal.final(), signal.degree(), signal.repeats_after()) == (3.0, 1.0, 0, None)


def test_shaped_for_two_modes_has_every_sum_of_their_impulses():
    inner = {"kind": "shaped", "frequency": 2 * math.pi, "command": {"kind": "step"}}
    signal = make("shaped", {"frequency": math.pi, "command": inner})
    assert signal.breakpoints() == pytest.approx((0.0, 0.5, 1.0, 1.5))
    assert signal.value(np.array(signal.breakpoints())) == pytest.approx([0.25, 0.5, 0.75, 1.0])


def test_programmed_delay_is_two_movements():
    move = {"kind": "trapezoid", "max_velocity": 1, "max_acceleration": 4}
    signal = make("programmed_delay", {"delay": 0.5, "share": 0.25, "command": move})
    whole, t = make("trapezoid", {"max_velocity": 1, "max_acceleration": 4}), np.linspace(0, 3, 301)
    later = np.where(t >= 0.5, whole.value(t - 0.5), 0.0)
    np.testing.assert_allclose(signal.value(t), 0.75 * whole.value(t) + 0.25 * later, atol=1e-15)
    assert (signal.end(), signal.final(), signal.degree()) == (pytest.approx(1.75), 1.0, 2)


def test_a_sampled_command_is_at_rest_before_its_copy_begins():
    signal = make(
        "programmed_delay", {"delay": 1.0, "command": {"kind": "sampled", "time": [0.0, 1.0], "values": [2.0, 4.0]}}
    )
    assert signal.value(np.array([0.0, 0.5, 1.0, 2.0])) == pytest.approx([1.0, 1.5, 3.0, 4.0])


def test_commands_without_end_stay_so():
    signal = make("shaped", {"frequency": 1.0, "command": {"kind": "sine", "frequency": 2.0}})
    assert (signal.end(), signal.final(), signal.degree()) == (None, None, None)
    assert signal.repeats_after() == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("kind", "parameters", "at", "message"),
    [
        ("trapezoid", {"max_acceleration": 1}, ("max_velocity",), "max_velocity must be given"),
        ("trapezoid", {"max_velocity": 0, "max_acceleration": 1}, ("max_velocity",), "must be > 0, got 0"),
        ("s_curve", {"max_velocity": 1, "max_acceleration": 1}, ("max_jerk",), "max_jerk must be given"),
        ("multisine", {"fundamental": 1, "harmonics": []}, ("harmonics",), "at least one number"),
        ("multisine", {"fundamental": 1, "harmonics": [1, 2.5]}, ("harmonics", 1), "whole number above the one before"),
        ("multisine", {"fundamental": 1, "harmonics": [2, 2]}, ("harmonics", 1), "above the one before, got 2"),
        ("shaped", {"frequency": 1}, ("command",), "command must be given"),
        ("shaped", {"frequency": 1, "command": 3}, ("command",), "command must be a signal"),
        ("shaped", {"frequency": 1, "command": {"kind": "sawtooth"}}, ("command", "kind"), "kind must be one of"),
        ("shaped", {"frequency": 1, "command": {"start": 1}}, ("command", "kind"), "command must have a kind"),
        ("shaped", {"frequency": 1, "command": {"kind": "step", "start": -1}}, ("command", "start"), "must be >= 0 s"),
        ("shaped", {"frequency": 1, "shaper": "zvddd", "command": {"kind": "step"}}, ("shaper",), "one of zv, zvd"),
        (
            "shaped", {"frequency": 1, "shaper": "ei", "damping_ratio": 0.35, "command": {"kind": "step"}},
            ("damping_ratio",), "must be <= 0.3 for the shaper ei, got 0.35",
        ),
        ("shaped", {"frequency": 1, "damping_ratio": 1, "command": {"kind": "step"}}, ("damping_ratio",), "<= 0.99"),
        ("programmed_delay", {"delay": -1, "command": {"kind": "step"}}, ("delay",), "delay must be >= 0 s, got -1"),
    ],
)  # fmt: skip
def test_refuses(kind, parameters, at, message):
    with pytest.raises(SignalError, match=message) as caught:
        make(kind, parameters)
    assert caught.value.at == at


def test_copies_of_copies_are_limited():
    document = {"kind": "step"}
    for _ in range(3):
        document = {"kind": "shaped", "shaper": "zvdd", "frequency": 1.0, "command": document}
    assert make("shaped", {"frequency": 1.0, "command": document["command"]}).final() == 1.0
    with pytest.raises(SignalError, match="at most 100 times"):
        make("shaped", {"frequency": 1.0, "command": document})
