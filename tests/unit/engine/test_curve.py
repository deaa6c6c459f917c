"""A curve is continuous: crossings, extrema and integrals do not know a grid."""

from __future__ import annotations

import numpy as np
import pytest

from engine.exact.time.chebyshev import NODES
from engine.exact.time.curve import Curve
from engine.model.tangent import INFINITESIMAL, slopes


def curve_of(function, edges: list[float], step: complex = 0.0) -> Curve:
    """Return t -> function(t, p = 1 + step) on the given edges."""
    ends = np.array(edges, dtype=complex if step else float)
    times = ends[:-1, None] + NODES * np.diff(ends)[:, None]
    return Curve(edges=ends[:, None], values=function(times, 1 + step)[..., None])


def sine(t: np.ndarray, p: complex) -> np.ndarray:
    return np.sin(p * t)


EDGES = [0.0, 0.7, 2.0, 3.0, 4.5, 6.0]


def test_all_crossings_in_order() -> None:
    found = [float(t[0]) for t, _ in curve_of(sine, EDGES).crossings(np.array(0.5))]
    assert found == pytest.approx([np.pi / 6, 5 * np.pi / 6], abs=1e-13)


def test_crossings_backwards_begin_with_the_last() -> None:
    last, _ = next(curve_of(sine, EDGES).crossings(np.array(0.0), backwards=True))
    assert last[0] == pytest.approx(np.pi, abs=1e-13)


def test_two_crossings_between_neighbouring_nodes_are_both_found() -> None:
    # the parabola dips below zero on an interval of 2e-4, far less than the distance of nodes
    found = [
        float(t[0]) for t, _ in curve_of(lambda t, p: (t - 0.123) ** 2 - 1e-8, [0.0, 1.0]).crossings(np.array(0.0))
    ]
    assert found == pytest.approx([0.1229, 0.1231], abs=1e-12)


def test_a_jump_across_the_level_is_a_crossing_at_its_edge() -> None:
    values = np.stack([np.zeros(17), np.ones(17)])[..., None]
    step = Curve(edges=np.array([[0.0], [2.0], [3.0]]), values=values)
    assert [float(t[0]) for t, _ in step.crossings(np.array(0.5))] == [2.0]


def test_an_instant_carries_its_derivative() -> None:
    # sin(p t) = 1/2 at t = asin(1/2) / p, so dt/dp = -t / p
    instant, _ = next(curve_of(sine, EDGES, step=1j * INFINITESIMAL).crossings(np.array(0.5)))
    assert slopes(instant)[0] == pytest.approx(-np.pi / 6, rel=1e-12)


def test_the_largest_value_is_found_between_nodes() -> None:
    value, at = curve_of(sine, EDGES).largest()
    assert value[0] == pytest.approx(1.0, abs=1e-14)
    assert at == pytest.approx(np.pi / 2, abs=1e-7)


def test_the_instant_of_the_peak_carries_its_derivative() -> None:
    # the peak of sin(p t) is at π / (2 p)
    curve = curve_of(sine, EDGES, step=1j * INFINITESIMAL)
    assert slopes(curve.turning(np.pi / 2))[0] == pytest.approx(-np.pi / 2, rel=1e-9)


def test_integrals_of_the_curve_its_magnitude_its_square_and_its_moment() -> None:
    # over [0, 6]: ∫sin, ∫|sin|, ∫sin², ∫t sin
    curve = curve_of(sine, EDGES)
    assert curve.integral()[0] == pytest.approx(1 - np.cos(6.0), abs=1e-13)
    assert curve.absolute().integral()[0] == pytest.approx(3 + np.cos(6.0), abs=1e-13)
    assert curve.squared().integral()[0] == pytest.approx(3 - np.sin(12.0) / 4, abs=1e-13)
    assert curve.times_time().integral()[0] == pytest.approx(np.sin(6.0) - 6 * np.cos(6.0), abs=1e-12)


def test_parts_before_and_after_an_instant_make_the_whole() -> None:
    curve = curve_of(sine, EDGES)
    parts = curve.until(2.5).integral() + curve.since(2.5).integral()
    assert parts[0] == pytest.approx(curve.integral()[0], abs=1e-14)


def test_samples_are_right_continuous_and_held_beyond_the_end() -> None:
    values = np.stack([np.zeros(17), np.ones(17)])[..., None]
    step = Curve(edges=np.array([[0.0], [2.0], [3.0]]), values=values)
    assert step.sample(np.array([1.9, 2.0, 5.0])).tolist() == pytest.approx([0.0, 1.0, 1.0], abs=1e-14)


def test_absolute_value_of_a_piece_that_ends_at_its_root() -> None:
    # by rounding the piece [0, 1] changes sign at its very end, where no cut is possible
    curve = curve_of(lambda t, p: 0.3 * p * (1 - t) - 2e-16, [0.0, 1.0, 2.0])
    assert curve.absolute().integral()[0] == pytest.approx(0.3, abs=1e-14)


def test_a_plateau_is_reached_where_it_begins() -> None:
    """What stands still rounds in its own way on every piece: a mass at the end of its stroke."""
    heights = (0.3, 0.3 - 3e-16, 0.3 - 5e-16, 0.3, 0.3 + 3e-16, 0.3)
    climb = 0.3 * np.sin(0.5 * np.pi * NODES) - 6e-16
    values = np.stack([0.5 * climb, climb, *(np.full_like(NODES, height) for height in heights)])
    curve = Curve(edges=np.arange(len(values) + 1.0)[:, None], values=values[..., None])
    assert curve.largest()[1] == 2.0
    assert (curve * -1.0).smallest()[1] == 2.0
