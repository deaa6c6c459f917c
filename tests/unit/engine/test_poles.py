"""Poles with delays against the Lambert W function; verdicts at and around the stability limit; hidden modes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import lambertw

from engine.analysis.study import MetricRequest, measure
from engine.diagram.diagram import compile_system
from engine.exact.frequency.dc_gain import static_gain
from engine.exact.frequency.path import path
from engine.exact.frequency.poles import poles
from engine.model.linear_system import LaneSystem, LinearSystem
from engine.model.tangent import INFINITESIMAL
from engine.model.verdicts import Verdict
from tests.unit.engine.diagrams import block, document
from tests.unit.engine.test_trajectory import integrator_with_delay


def lanes(*systems: LinearSystem) -> LaneSystem:
    return LaneSystem.of(systems)


@pytest.mark.parametrize("gain", [0.2, 1.0, 1.5, 3.0])
def test_poles_of_a_delay_loop_are_lambert_w(gain: float) -> None:
    # s = -K e^-sτ  <=>  s τ = W_k(-K τ); R. Corless et al., "On the Lambert W function", 1996
    tau = 0.7
    found = poles(lanes(integrator_with_delay(gain, tau))).values[:6]
    branches = np.array([lambertw(-gain * tau, k) / tau for k in (-3, -2, -1, 0, 1, 2)])
    for pole in branches[np.argsort(-branches.real)][:4]:
        assert np.abs(found - pole).min() <= 1e-11 * abs(pole)


def test_stability_changes_at_the_exact_gain() -> None:
    verdicts = {k: poles(lanes(integrator_with_delay(k, 1.0))).verdict for k in (1.57, np.pi / 2, 1.571)}
    assert list(verdicts.values()) == [Verdict.OK, Verdict.MARGINAL, Verdict.UNSTABLE]


def test_a_pole_moves_with_the_delay_as_its_difference_says() -> None:
    motion = poles(lanes(integrator_with_delay(2.0, 1 + 1j * INFINITESIMAL))).motion[0, 0]
    h = 1e-6
    up, down = (poles(lanes(integrator_with_delay(2.0, 1 + s * h))).values[0] for s in (1, -1))
    assert motion == pytest.approx((up - down) / (2 * h), rel=1e-8)


def test_an_undamped_echo_is_unstable() -> None:
    one = np.ones((1, 1))
    echo = LinearSystem(
        a=-one, b1=one, b2=0 * one, c1=one, c2=one, d11=0 * one, d12=0 * one, d21=0 * one, d22=1.02 * one,
        delays=np.array([0.1]), x0=np.zeros(1), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    assert poles(lanes(echo)).verdict is Verdict.UNSTABLE


def test_the_chain_of_fast_poles_behind_a_delay_is_not_taken_for_an_integrator() -> None:
    # a stiff loop: its far poles are badly conditioned, but far
    a = np.array([[-1e3, 0.0, 0.0], [4e4, -60.0, -1.6e3], [0.0, 1.6e3, 0.0]])
    one = np.zeros((1, 1))
    system = LinearSystem(
        a=a, b1=np.zeros((3, 1)), b2=np.array([[1e3], [0.0], [0.0]]), c1=np.array([[0.0, 0.0, 1.0]]),
        c2=np.array([[0.0, 0.0, -1e-3]]), d11=one, d12=one, d21=one + 1, d22=one, delays=np.array([2.6e-3]),
        x0=np.zeros(3), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    found = poles(lanes(system))
    assert found.verdict is Verdict.OK
    assert not found.at_zero.any()


def companion(denominator: list[float], numerator: list[float]) -> LaneSystem:
    n = len(denominator) - 1
    a = np.diag(np.ones(n - 1), 1)
    a[-1] = -np.array(denominator[1:][::-1]) / denominator[0]
    b = np.zeros((n, 1))
    b[-1] = 1 / denominator[0]
    c = np.zeros((1, n))
    c[0, : len(numerator)] = numerator[::-1]
    return lanes(LinearSystem.delay_free(a, b, c, np.zeros((1, 1))))


def test_a_double_integrator_integrates() -> None:
    assert poles(companion([1, 0, 0], [1])).verdict is Verdict.INTEGRATING


def test_a_lightly_damped_pair_is_not_marginal() -> None:
    # damping ratio 1e-6
    assert poles(companion([1, 2e-6, 1], [1])).verdict is Verdict.OK


def test_an_uncancelled_integrator_is_hidden() -> None:
    part = path(companion([1, 1, 1, 0], [1, 0]), [0], [0])
    assert part.n == 2
    assert poles(part).verdict is Verdict.OK
    assert static_gain(part)[0, 0, 0] == pytest.approx(1.0, rel=1e-12)


def test_an_output_that_does_not_see_the_integrator_is_pruned_exactly() -> None:
    # x1' = x2, x2' = -x2 + u: the velocity x2 does not know the position x1
    a = np.array([[0.0, 1.0], [0.0, -1.0]])
    system = lanes(
        LinearSystem.delay_free(a, np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1)), outputs=("x", "v"))
    )
    assert path(system, [0], [1]).n == 1
    assert poles(path(system, [0], [0])).verdict is Verdict.INTEGRATING


@pytest.mark.parametrize("time_constant", [1e-7, 5e-11, 1e-15])
def test_slow_poles_are_known_beside_one_that_is_very_fast(time_constant: float) -> None:
    # p' = v, v' = -4 v + 3 f, T f' = -p - f: s³ T + s² (1 + 4 T) + 4 s + 3, so s = -1 - 1.5 T + O(T²)
    rate = 1 / time_constant
    a = np.array([[0.0, 1, 0], [0, -4, 3], [-rate, 0, -rate]])
    b, c, d = np.array([[0.0], [0], [rate]]), np.array([[1.0, 0, 0]]), np.zeros((1, 1))
    found = poles(lanes(LinearSystem.delay_free(a, b, c, d)))
    assert found.verdict is Verdict.OK
    assert found.values[0].real == pytest.approx(-1 - 1.5 * time_constant, rel=3e-12)
    assert found.uncertainty[0] < 1e-10


def test_an_integrator_beside_a_very_fast_pole_integrates() -> None:
    a = np.array([[0.0, 1, 0], [0, -4, 3], [0, -2e10, -2e10]])
    b, c, d = np.array([[0.0], [0], [2e10]]), np.array([[1.0, 0, 0]]), np.zeros((1, 1))
    assert poles(lanes(LinearSystem.delay_free(a, b, c, d))).verdict is Verdict.INTEGRATING


@pytest.mark.parametrize("delay", [0.0, 1e-6, 1e-3, 0.05])
def test_a_resonance_counts_however_short_the_delay_of_its_loop_is(delay: float) -> None:
    """A pair at 100 rad/s with a damping of 0.04 behind a slow plant, in a loop of gain 0.05: held against Newton on the loop's equation."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "gain": block("gain", gain=0.05),
        "slow": block("transfer_function", numerator=[9.0], denominator=[1.0, 4.8, 9.0]),
        "resonance": block("transfer_function", numerator=[1e4], denominator=[1.0, 8.0, 1e4]),
        "wait": block("delay", time=delay),
    }  # fmt: skip
    wires = ["r -> e.in1", "wait -> e.in2", "e -> gain", "gain -> slow", "slow -> resonance", "resonance -> wait"]
    (found, _), = measure(
        compile_system(document(blocks, wires, {"y": "wait"})), [MetricRequest(metric="damping_ratio")]
    )  # fmt: skip
    s = -4 + 100j
    for _ in range(50):
        slow, fast, echo = s**2 + 4.8 * s + 9, s**2 + 8 * s + 1e4, 0.05 * 9e4 * np.exp(-s * delay)
        slope = (2 * s + 4.8) * fast + slow * (2 * s + 8) - delay * echo
        s -= (slow * fast + echo) / slope
    assert found.value == pytest.approx(-s.real / abs(s), rel=1e-9)


def test_of_the_fast_pairs_behind_a_delay_only_those_count_that_last() -> None:
    """x' = -K x(t - 1): the dominant pair is Lambert's W_0, and the next, which has a smaller damping ratio, loses 5/6 of itself in a delay."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "x": block("integrator", gain=0.5), "wait": block("delay", time=1.0),
    }  # fmt: skip
    wires = ["r -> e.in1", "wait -> e.in2", "e -> x", "x -> wait"]
    (found, _), = measure(
        compile_system(document(blocks, wires, {"y": "wait"})), [MetricRequest(metric="damping_ratio")]
    )  # fmt: skip
    first, second = lambertw(-0.5, 0), lambertw(-0.5, 1)
    assert -second.real / abs(second) < -first.real / abs(first)
    assert found.value == pytest.approx(-first.real / abs(first), rel=1e-9)
