"""Metrics of sampled curves against the closed form of a second-order step response, and what leaves them in doubt."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from engine.batch.nonlinear.curves import Curves, middle_of
from engine.batch.nonlinear.readings import read

DAMPING = np.array([0.2, 0.5, 0.7])
FREQUENCY = 3.0
START = 0.5
END = 40.0


def response(t: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Return y and y' of ω²/(s² + 2ζωs + ω²), K. Ogata, Modern Control Engineering, eq. (5-12)."""
    turn = FREQUENCY * math.sqrt(1 - damping**2)
    t = np.maximum(t - START, 0.0)
    decay = np.exp(-damping * FREQUENCY * t)
    y = 1 - decay * (np.cos(turn * t) + damping * FREQUENCY / turn * np.sin(turn * t))
    return y, FREQUENCY**2 / turn * decay * np.sin(turn * t)


def curves(samples: int, *, duration: float | None = None, end: float = END) -> Curves:
    """Return the three responses, sampled before and after the step."""
    times = np.concatenate([np.linspace(0.0, START, 9), np.linspace(START, end, samples)])
    values, slopes = (np.stack(part, axis=1) for part in zip(*(response(times, d) for d in DAMPING), strict=True))
    made = Curves(
        times=times, values=values, slopes=slopes, errors=np.empty((0, 2, 0)), start=START, last=START,
        initial=np.zeros(3), constant=True, target=1.0, duration=duration,
    )  # fmt: skip
    command = np.stack([times >= START, times >= START], axis=1)[:, :, None].astype(float)
    command[8] = 0.0
    return Curves(**{**vars(made), "errors": command - np.stack([values, middle_of(made)], axis=1)})


def crossing(damping: float, level: float, low: float, high: float) -> float:
    return float(brentq(lambda t: response(np.array(t), damping)[0] - level, low, high, xtol=1e-14))


def settled(damping: float, band: float) -> float:
    """Return when |y - 1| was band for the last time."""
    t = np.linspace(START, 20.0, 400001)
    away = np.abs(response(t, damping)[0] - 1) > band
    last = int(np.flatnonzero(away)[-1])
    level = 1 + band if response(t[last], damping)[0] > 1 else 1 - band
    return crossing(damping, level, t[last], t[last + 1]) - START


TURN = FREQUENCY * np.sqrt(1 - DAMPING**2)
OVERSHOOT = np.exp(-math.pi * DAMPING / np.sqrt(1 - DAMPING**2))
EXPECTED = {
    "overshoot": OVERSHOOT,
    "peak": 1 + OVERSHOOT,
    "peak_time": math.pi / TURN,
    "rise_time": np.array([crossing(d, 0.9, START, START + 1.0) - crossing(d, 0.1, START, START + 1.0) for d in DAMPING]),
    "settling_time": np.array([settled(d, 0.02) for d in DAMPING]),
    "response_time": np.array([settled(d, 0.05) for d in DAMPING]),
    "undershoot": np.zeros(3),
    "steady_state_error": np.zeros(3),
    "ise": (1 + 4 * DAMPING**2) / (4 * DAMPING * FREQUENCY),
    "iae": np.array([quad(lambda t, d=d: abs(1 - response(np.array(t), d)[0]), START, END, limit=500)[0] for d in DAMPING]),
    "itae": np.array([
        quad(lambda t, d=d: (t - START) * abs(1 - response(np.array(t), d)[0]), START, END, limit=500)[0] for d in DAMPING
    ]),
}  # fmt: skip


@pytest.mark.parametrize("metric", EXPECTED)
def test_a_metric_of_samples_is_that_of_the_curve(metric):
    value, doubt = read(metric, curves(4001))
    rounded = 1e-5 if metric in {"iae", "itae"} else 1e-6  # the corners of |e| lie between samples
    np.testing.assert_allclose(value, EXPECTED[metric], rtol=rounded, atol=1e-7)
    assert not doubt.any()


def test_what_has_not_settled_is_doubtful_or_absent_where_the_time_was_given():
    value, doubt = read("settling_time", curves(400, end=4.0))
    assert np.isnan(value).all()
    assert doubt.all()
    value, doubt = read("settling_time", curves(400, end=4.0, duration=4.0), unsettled=False)
    assert np.isnan(value[0])
    assert not doubt[0]  # it swings by more than the exact path would call settled
    value, doubt = read("settling_time", curves(400, end=4.0, duration=4.0))
    assert 0 < value[0] < 4.0
    assert not doubt[0]  # its last value counts
    peak, unsure = read("peak", curves(4000, end=4.0, duration=4.0))
    np.testing.assert_allclose(peak, 1 + OVERSHOOT, rtol=1e-6)
    assert not unsure.any()


def test_a_tip_between_the_samples_leaves_doubt_about_the_instant():
    made = curves(201)
    top = made.extremes[0]
    assert np.all(made.values.max(axis=0) < top - 1e-5)
    time, doubt = made.first_passage(top - 1e-6, np.ones(3))
    assert np.isnan(time).all()
    assert doubt.all()


def test_a_kink_between_samples_is_doubted_as_far_as_it_can_reach():
    times = np.linspace(0.0, 1.0, 11)
    tent = np.minimum(times, 0.95 - times)[:, None] + 0.55  # its top, 1.025, lies between the samples 0.4 and 0.5
    slopes = np.where(times < 0.475, 1.0, -1.0)[:, None]
    made = Curves(
        times=times, values=tent, slopes=slopes, errors=np.empty((0, 2, 0)), start=0.0, last=0.0, initial=np.zeros(1),
        constant=False, target=None, duration=1.0,
    )  # fmt: skip
    value, doubt = read("peak", made)
    assert doubt.all()
    assert abs(value[0] - 1.025) <= made.bend[0]
