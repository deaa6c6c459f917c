"""Curves of many candidates: analytic responses."""

from __future__ import annotations

import numpy as np
import pytest

from engine.exact.time.sampling import frequency_response, step_response
from engine.model.linear_system import LinearSystem


def lag(tau: float) -> LinearSystem:
    return LinearSystem.delay_free(np.array([[-1 / tau]]), np.array([[1 / tau]]), np.array([[1.0]]), np.array([[0.0]]))


def delayed_integrator(delay: float) -> LinearSystem:
    """x' = w, w(t) = u(t - delay), y = x."""
    return LinearSystem(
        a=np.zeros((1, 1)), b1=np.zeros((1, 1)), b2=np.ones((1, 1)), c1=np.ones((1, 1)), c2=np.zeros((1, 1)),
        d11=np.zeros((1, 1)), d12=np.zeros((1, 1)), d21=np.ones((1, 1)), d22=np.zeros((1, 1)),
        delays=np.array([delay]), x0=np.zeros(1), inputs=("u",), outputs=("y",),
    )  # fmt: skip


def test_the_step_response_of_a_lag() -> None:
    found = step_response(lag(0.2), {0: 3.0}, 1.0, 777)
    assert found[0] == pytest.approx(3 * (1 - np.exp(-np.linspace(0, 1, 777) / 0.2)), rel=1e-13, abs=1e-15)


def test_states_of_very_different_size_lose_no_digits() -> None:
    # A mass on a spring, position in 1e-9 and velocity in 1e6 of their units: x(t) = 1 - cos t for k = m = 1.
    scale = np.array([1e-9, 1e6])
    a = np.array([[0.0, 1.0], [-1.0, 0.0]]) * scale / scale[:, None]
    b = np.array([[0.0], [1.0]]) / scale[:, None]
    system = LinearSystem.delay_free(a, b, np.array([[1.0, 0.0]]) * scale, np.zeros((1, 1)))
    time = np.linspace(0, 10, 1000)
    assert step_response(system, {0: 1.0}, 10.0, 1000)[0] == pytest.approx(1 - np.cos(time), abs=1e-12)


def test_an_initial_state_and_a_direct_way_are_seen_at_once() -> None:
    system = LinearSystem.delay_free(np.array([[-1.0]]), np.array([[0.0]]), np.array([[2.0]]), np.array([[5.0]]))
    moved = LinearSystem(**{**vars(system), "x0": np.array([1.0])})
    # y = 2 exp(-t) + 5
    assert step_response(moved, {0: 1.0}, 1.0, 2)[0] == pytest.approx([7.0, 2 * np.exp(-1) + 5], rel=1e-14)


def test_a_double_pole_at_zero_has_its_frequency_response() -> None:
    # No eigenvectors span the states of 1/s^2.
    system = LinearSystem.delay_free(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
    )
    w = np.geomspace(0.1, 100, 50)
    assert frequency_response(system, 0, 0, w) == pytest.approx(-1 / w**2, rel=1e-13)


def test_a_delay_is_exact_in_frequency_and_refused_in_time() -> None:
    w = np.geomspace(0.1, 100, 50)
    assert frequency_response(delayed_integrator(0.3), 0, 0, w) == pytest.approx(
        np.exp(-0.3j * w) / (1j * w), rel=1e-13
    )
    with pytest.raises(ValueError, match="the system must be without delays, got 1"):
        step_response(delayed_integrator(0.3), {0: 1.0}, 1.0, 10)


def test_what_grows_leaves_the_numbers_without_a_warning() -> None:
    assert not np.isfinite(step_response(lag(-0.001), {0: 1.0}, 10.0, 100)).all()
