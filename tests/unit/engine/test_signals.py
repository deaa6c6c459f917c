"""Signals: values, breakpoints, ends, and parameters that are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engine.model.errors import SignalError
from engine.signals import make

T = np.array([0.0, 0.5, 1.0, 1.5, 2.0])


def test_step_is_right_continuous():
    step = make("step", {"amplitude": 3, "start": 1})
    assert step.value(T).tolist() == [0, 0, 3, 3, 3]
    assert step.value(np.array([np.nextafter(1.0, 0.0)])).tolist() == [0]
    assert (step.breakpoints(), step.final(), step.end(), step.degree()) == ((1.0,), 3.0, 1.0, 0)


def test_step_has_amplitude_1_at_time_0_unless_told():
    assert make("step").value(T).tolist() == [1, 1, 1, 1, 1]


def test_ramp():
    ramp = make("ramp", {"slope": 2, "start": 0.5})
    assert ramp.value(T).tolist() == [0, 0, 1, 2, 3]
    assert (ramp.breakpoints(), ramp.final(), ramp.end(), ramp.degree()) == ((0.5,), None, None, 1)


def test_sine():
    sine = make("sine", {"amplitude": 2, "frequency": math.pi, "phase": math.pi / 2})
    np.testing.assert_allclose(sine.value(T), [2, 0, -2, 0, 2], atol=1e-15)
    assert (sine.breakpoints(), sine.final(), sine.end(), sine.degree()) == ((0.0,), None, None, None)


def test_chirp_sweeps_linearly_and_ends_in_0():
    chirp = make("chirp", {"start_frequency": 2, "end_frequency": 6, "duration": 2})
    # phase(t) = 2 t + (6 - 2) t²/(2·2) = 2 t + t², whose derivative runs from 2 to 6 rad/s
    np.testing.assert_allclose(chirp.value(T), np.where(T < 2, np.sin(2 * T + T**2), 0.0), rtol=1e-15)
    assert (chirp.breakpoints(), chirp.final(), chirp.end(), chirp.degree()) == ((0.0, 2.0), 0.0, 2.0, None)


def test_sampled_interpolates_and_holds_its_ends():
    sampled = make("sampled", {"time": [0.5, 1.0, 2.0], "values": [1, 3, -1]})
    assert sampled.value(T).tolist() == [1, 1, 3, 1, -1]
    assert sampled.value(np.array([9.0])).tolist() == [-1]
    assert (sampled.breakpoints(), sampled.final(), sampled.end()) == ((0.0, 0.5, 1.0, 2.0), -1.0, 2.0)
    assert sampled.degree() == 1


def test_impulse_is_over_at_once():
    blow = make("impulse", {"area": 3})
    assert blow.impulse() == 3
    assert blow.value(T).tolist() == [0, 0, 0, 0, 0]
    assert (blow.breakpoints(), blow.final(), blow.end(), blow.degree()) == ((0.0,), 0.0, 0.0, None)
    assert make("step").impulse() == 0


def test_pulse_is_right_continuous():
    pulse = make("pulse", {"start": 0.5, "width": 1.0, "amplitude": 2})
    assert pulse.value(T).tolist() == [0, 2, 2, 0, 0]
    assert (pulse.breakpoints(), pulse.final(), pulse.end(), pulse.degree()) == ((0.5, 1.5), 0.0, 1.5, 0)


def test_square_jumps_where_it_says():
    """Multiples of a half period that is no binary number: the value changes exactly at the instants listed."""
    square = make("square", {"period": 0.2, "amplitude": 3})
    breaks = np.array(square.breaks(50.0))
    assert len(breaks) == 501
    signs = np.where(np.arange(501) % 2 == 0, 3.0, -3.0)
    np.testing.assert_array_equal(square.value(breaks), signs)
    np.testing.assert_array_equal(square.value(np.nextafter(breaks[1:], 0.0)), signs[:-1])
    assert (square.breakpoints(), square.final(), square.end()) == ((0.0, 0.1), None, None)
    assert (square.degree(), square.repeats_after()) == (0, 0.2)


def test_copies_of_a_square_break_in_every_period():
    command = make("square", {"period": 1.0})
    shaped = make("shaped", {"frequency": 10.0, "command": command})
    shift = np.pi / 10.0
    expected = sorted([*(0.5 * k for k in range(7)), *(shift + 0.5 * k for k in range(7))])
    np.testing.assert_allclose(shaped.breaks(3.0), expected, rtol=1e-15)


def test_piecewise_linear_jumps_at_an_instant_given_twice():
    lines = make("piecewise_linear", {"time": [0.5, 1.0, 1.0, 2.0], "values": [1, 3, -1, 0]})
    assert lines.value(np.array([0.0, 0.5, 0.75, 1.0, 1.5, 2.0, 9.0])).tolist() == [1, 1, 2, -1, -0.5, 0, 0]
    assert lines.value(np.array([np.nextafter(1.0, 0.0)]))[0] == pytest.approx(3.0)
    assert (lines.breakpoints(), lines.final(), lines.end(), lines.degree()) == ((0.0, 0.5, 1.0, 2.0), 0.0, 2.0, 1)


def test_sampled_takes_arrays_and_keeps_its_own_copy():
    values = np.array([1.0, 2.0])
    sampled = make("sampled", {"time": np.array([0.0, 1.0]), "values": values})
    values[1] = 99.0
    assert sampled.final() == 2.0


@pytest.mark.parametrize(
    ("kind", "parameters", "at", "message"),
    [
        ("sawtooth", {}, ("kind",), "kind must be one of .*step"),
        ("step", {"height": 1}, ("height",), "parameter of step must be one of amplitude, start, got 'height'"),
        ("step", {"start": -1}, ("start",), "start must be >= 0 s, got -1"),
        ("step", {"amplitude": math.nan}, ("amplitude",), "amplitude must be finite, got nan"),
        ("step", {"amplitude": 10**400}, ("amplitude",), "amplitude must be finite, got inf"),
        ("step", {"amplitude": "2"}, ("amplitude",), "amplitude must be a number, got '2'"),
        ("step", {"amplitude": True}, ("amplitude",), "amplitude must be a number"),
        ("sine", {}, ("frequency",), "frequency must be given"),
        ("sine", {"frequency": 0}, ("frequency",), "frequency must be > 0 rad/s, got 0"),
        ("chirp", {"start_frequency": 1, "end_frequency": 2, "duration": 0}, ("duration",), "duration must be > 0 s"),
        ("pulse", {}, ("width",), "width must be given"),
        ("pulse", {"width": 0}, ("width",), "width must be > 0 s, got 0"),
        ("square", {"period": 0}, ("period",), "period must be > 0 s, got 0"),
        ("noise", {"band": [1]}, ("band",), "band must be .low, high. with 0 <= low < high rad/s, got .1."),
        ("noise", {"band": [3, 2]}, ("band",), "got .3, 2."),
        ("noise", {"band": [1, 2], "seed": 1.5}, ("seed",), "seed must be a whole number, got 1.5"),
        ("noise", {"band": [1, 2], "rms": -1}, ("rms",), "rms must be >= 0"),
        ("piecewise_linear", {"time": [0, 1, 1, 1], "values": [1, 2, 3, 4]}, ("time", 3), "at most twice, got 1"),
        ("piecewise_linear", {"time": [1, 0], "values": [1, 2]}, ("time", 1), "must be >= 1 s"),
        ("piecewise_linear", {"time": [1, 2], "values": [1]}, ("values",), "as many as time \\(2\\), got 1"),
        ("sampled", {"time": [], "values": []}, ("time",), "at least one point"),
        ("sampled", {"time": [0, 1], "values": [1]}, ("values",), "as many as time \\(2\\), got 1"),
        ("sampled", {"time": [0, 1, 1], "values": [1, 2, 3]}, ("time", 2), "time\\[2\\] must be > 1 s"),
        ("sampled", {"time": [-1, 1], "values": [1, 2]}, ("time", 0), "time\\[0\\] must be >= 0 s, got -1"),
        ("sampled", {"time": [0, 1], "values": [1, math.inf]}, ("values", 1), "values\\[1\\] must be finite, got inf"),
        ("sampled", {"time": [0, 1], "values": "ab"}, ("values",), "values must be a list of numbers"),
        ("sampled", {"time": [[0, 1]], "values": [1]}, ("time",), "got 2 dimensions"),
    ],
)
def test_refuses(kind, parameters, at, message):
    with pytest.raises(SignalError, match=message) as caught:
        make(kind, parameters)
    assert caught.value.at == at
