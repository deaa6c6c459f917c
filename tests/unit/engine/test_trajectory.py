"""Exact responses with delays, against solutions by hand, and their derivatives against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import lambertw

from engine.analysis.study import simulate
from engine.diagram.diagram import compile_system
from engine.exact.time.run import Run, Trajectory
from engine.exact.time.trajectory import MAX_STEPS, respond
from engine.model.errors import UnresolvedError
from engine.model.linear_system import LaneSystem, LinearSystem
from engine.model.tangent import INFINITESIMAL, slopes
from engine.model.verdicts import Verdict
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = make("step", {})


def integrator_with_delay(gain: complex, delay: complex) -> LinearSystem:
    """x' = gain (r - x)(t - delay), y = x."""
    one = np.ones((1, 1))
    return LinearSystem(
        a=0 * one, b1=0 * one, b2=gain * one, c1=one, c2=-one, d11=0 * one, d12=0 * one, d21=one, d22=0 * one,
        delays=np.array([delay]), x0=np.zeros(1), inputs=("r",), outputs=("y",),
    )  # fmt: skip


def response(*systems: LinearSystem, signal=STEP, horizon: float = 3.0) -> Trajectory:
    return respond(LaneSystem.of(systems), [signal], horizon)


def test_delay_loop_by_the_method_of_steps() -> None:
    # feedback(2 e^-s / s, 1): y = 0, then 2 (t - 1), then 2 (t - 1) - 2 (t - 2)² (simulation literature, case 10)
    t = np.linspace(0, 3, 1001)
    exact = np.where(t < 1, 0.0, np.where(t < 2, 2 * (t - 1), 2 * (t - 1) - 2 * (t - 2) ** 2))
    y = response(integrator_with_delay(2.0, 1.0)).output(0).sample(t)
    assert np.abs(y - exact).max() <= 1e-13
    assert not y[t < 1].any()


def test_two_delays_of_no_common_measure() -> None:
    # x' = -x(t - 1) - x(t - √2)/2 + 1 from rest: on [0, 1] x = t; on [1, √2] x' = 1 - (t - 1); then one more term
    one = np.ones((1, 1))
    system = LinearSystem(
        a=0 * one, b1=one, b2=np.array([[-1.0, -0.5]]), c1=one, c2=np.ones((2, 1)), d11=0 * one, d12=np.zeros((1, 2)),
        d21=np.zeros((2, 1)), d22=np.zeros((2, 2)), delays=np.array([1.0, np.sqrt(2)]), x0=np.zeros(1),
        inputs=("u",), outputs=("y",),
    )  # fmt: skip
    t = np.linspace(0, 2, 401)
    exact = t - np.where(t > 1, (t - 1) ** 2 / 2, 0) - np.where(t > np.sqrt(2), (t - np.sqrt(2)) ** 2 / 4, 0)
    assert np.abs(response(system, horizon=2.0).output(0).sample(t) - exact).max() <= 1e-13


@pytest.mark.parametrize("parameter", ["gain", "delay"])
def test_derivatives_with_respect_to_gain_and_delay(parameter: str) -> None:
    def at(step: complex) -> LinearSystem:
        return integrator_with_delay(*((2 + step, 0.6) if parameter == "gain" else (2.0, 0.6 + step)))

    h = 1e-5
    value, instant = response(at(1j * INFINITESIMAL), horizon=8.0).output(0).largest()
    up, down = (response(at(sign * h), horizon=8.0).output(0).largest()[0][0] for sign in (1, -1))
    assert slopes(value)[0] == pytest.approx((up - down) / (2 * h), rel=1e-8)
    assert instant == pytest.approx(1.7, abs=1e-9)


def test_a_jump_through_the_delay_moves_with_it() -> None:
    # y = u(t - τ) / (s + 1): y(t) = 1 - e^-(t - τ), so dy/dτ = -e^-(t - τ) after the delay
    one = np.ones((1, 1))
    system = LinearSystem(
        a=-one, b1=0 * one, b2=one, c1=one, c2=0 * one, d11=0 * one, d12=0 * one, d21=one, d22=0 * one,
        delays=np.array([0.5 + 1j * INFINITESIMAL]), x0=np.zeros(1), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    trajectory = response(system)
    k = int(np.searchsorted(trajectory.output(0).times, 2.0) - 1)
    curve = trajectory.output(0)
    theta = (2.0 - curve.times[k]) / (curve.times[k + 1] - curve.times[k])
    assert slopes(curve.at(k, float(theta)))[0] == pytest.approx(-np.exp(-1.5), rel=1e-11)


def test_stiff_modes_six_decades_apart() -> None:
    # 1 / ((s + 1)(s / 1e6 + 1))
    a = np.array([[-1e6, 0.0], [1.0, -1.0]])
    system = LinearSystem.delay_free(a, np.array([[1e6], [0.0]]), np.array([[0.0, 1.0]]), np.zeros((1, 1)))
    t = np.array([1e-7, 1e-6, 1e-3, 1.0, 10.0])
    fast, slow = 1e6, 1.0
    exact = 1 - (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (fast - slow)
    assert response(system, horizon=40.0).output(0).sample(t) == pytest.approx(exact, abs=1e-13)


def test_chirp_through_a_lag_against_quadrature() -> None:
    signal = make("chirp", {"amplitude": 1.0, "start_frequency": 1.0, "end_frequency": 30.0, "duration": 4.0})
    system = LinearSystem.delay_free(-5 * np.ones((1, 1)), 5 * np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    got = response(system, signal=signal, horizon=4.0).output(0).sample(np.array([3.9]))[0]
    nodes, weights = np.polynomial.legendre.leggauss(400)
    times = 3.9 * (nodes + 1) / 2
    assert got == pytest.approx(
        float(3.9 / 2 * weights @ (5 * np.exp(-5 * (3.9 - times)) * signal.value(times))), abs=1e-12
    )


@pytest.mark.parametrize("delay", [1e-12, 1e-9, 1e-4])
def test_a_delay_far_shorter_than_the_response(delay: float) -> None:
    # y = 1 - e^{pt} / (1 + pτ) + faster modes, p = W0(-τ) / τ (residue of e^{-sτ} / (s (s + e^{-sτ})) with e^{-pτ} = -p)
    t = np.linspace(0.01, 20, 200)
    pole = float(lambertw(-delay).real) / delay
    exact = 1 - np.exp(pole * t) / (1 + pole * delay)
    trajectory = response(integrator_with_delay(1.0, delay), horizon=36.0)
    assert len(trajectory.plan) < 200
    assert np.abs(trajectory.output(0).sample(t) - exact).max() <= 1e-10


def test_an_echo_without_any_lag_jumps_for_ever() -> None:
    # y = u + y(t - 1)/2: 1, 3/2, 7/4, ...
    one = np.ones((1, 1))
    empty = np.zeros((0, 1))
    echo = LinearSystem(
        a=np.zeros((0, 0)), b1=empty, b2=empty, c1=empty.T, c2=empty.T, d11=one, d12=0.5 * one, d21=one, d22=0.5 * one,
        delays=np.array([1.0]), x0=np.zeros(0), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    t = np.arange(30) + 0.5
    assert response(echo, horizon=60.0).output(0).sample(t) == pytest.approx(2 - 0.5 ** np.arange(30), rel=1e-13)


def test_lanes_replay_the_segments_of_the_value() -> None:
    system = integrator_with_delay(2.0, 0.6)
    lanes = response(
        replace(system, b2=system.b2 + 1j * INFINITESIMAL), replace(system, a=system.a + 1j * INFINITESIMAL)
    )
    alone = response(system)
    assert np.array_equal(lanes.edges[:, 0].real, alone.edges[:, 0])
    assert lanes.y[..., 0, 0].real == pytest.approx(alone.y[..., 0, 0], abs=1e-14)


def test_integrators_alone_have_no_dynamics_to_be_scaled_by() -> None:
    # x' = u: t after a step, t²/2 after a ramp; x'' = 1e-9 u likewise, whatever the unit
    one, t = np.ones((1, 1)), np.linspace(0, 3, 31)
    single = LinearSystem.delay_free(0 * one, one, one, 0 * one)
    np.testing.assert_allclose(response(single).output(0).sample(t), t, atol=3e-13)
    np.testing.assert_allclose(response(single, signal=make("ramp")).output(0).sample(t), t**2 / 2, atol=5e-13)
    chain = np.array([[0.0, 1.0], [0.0, 0.0]])
    double = LinearSystem.delay_free(chain, np.array([[0.0], [1e-9]]), np.array([[1.0, 0.0]]), 0 * one)
    np.testing.assert_allclose(response(double).output(0).sample(t), 1e-9 * t**2 / 2, atol=5e-22)


def hydraulic_loop(*, kp: float, kd: float) -> LinearSystem:
    """A PID law with an integral time of 0.2 s, a delay of 3 ms, a valve and a cylinder: a fast loop with a slow tail."""
    blocks = {
        "r": block("input"), "late": block("delay", time=0.003),
        "pid": block("pid", kp=kp, integral_time=0.2, kd=kd, filter_frequency=1000.0, setpoint_weight_p=0.9),
        "valve": block("proportional_valve", flow_gain=2.4e-4, time_constant=1e-3),
        "axis": block(
            "linear_hydraulic_motor", area=1.26e-3, volume=2.5e-4, bulk_modulus=1e9, leakage=2.3e-11, mass=10.0,
            viscous_friction=1000.0,
        ),
    }  # fmt: skip
    wires = [
        "r -> pid.reference",
        "axis.position -> pid.measurement",
        "pid -> late",
        "late -> valve",
        "valve -> axis.flow",
    ]
    outputs = {"position": "axis.position", "acceleration": "axis.acceleration", "control": "pid"}
    return compile_system(document(blocks, wires, outputs)).realize()


@pytest.mark.parametrize(("kp", "kd"), [(300.0, 0.0), (300.0, 0.45), (450.0, 0.2), (450.0, 0.45)])
def test_a_slow_tail_behind_a_fast_loop_takes_few_segments_and_ends_at_rest(kp: float, kd: float) -> None:
    # rounding of what is solved for a long segment must not look like something that moves: it took a thousand segments
    system = LaneSystem.of([hydraulic_loop(kp=kp, kd=kd)]).balanced()
    found = respond(system, [STEP], 7.0)
    assert len(found.plan) < 150
    assert found.output(0).sample(np.array([6.9])) == pytest.approx([1.0], abs=1e-12)
    assert np.abs(found.output(1).sample(np.array([6.9]))) <= 1e-13 * np.abs(found.y[..., 1]).max()


def test_what_is_counted_from_rest_goes_on_as_it_was() -> None:
    # s + k e^(-s τ) has its slowest root at W(-k τ)/τ, and what is left of a step decays with it alone
    gain, delay = 0.3, 1.0
    root = float(lambertw(-gain * delay).real) / delay
    late = np.linspace(30.0, 60.0, 7)
    y = response(integrator_with_delay(gain, delay), horizon=100.0).output(0).sample(late)
    assert 1.0 - y == pytest.approx(np.exp(root * late) / (1 + root * delay), rel=1e-9, abs=1e-15)


EDGE = np.pi / 2
"""Gain times delay of an integrator behind a delay at which it swings for ever: e^(-jπ/2) = -j."""


@pytest.mark.parametrize("short", [1e-2, 1e-3])
def test_what_swings_for_long_behind_a_delay_is_followed_many_segments_at_once(short: float) -> None:
    # s + k e^(-s τ) has roots at W(-k τ)/τ; those of the two middle branches are all that is left after a while
    gain = EDGE * (1 - short)
    roots = np.array([lambertw(-gain, branch) for branch in (0, -1)])
    late = np.linspace(1.0 / short, 40.0 / short, 300)
    found = response(integrator_with_delay(gain, 1.0), horizon=50.0 / short)
    assert len(found.plan) < 300 < len(found.edges) / 7
    left = (np.exp(roots * late[:, None]) / (1 + roots)).sum(axis=1).real
    assert 1.0 - found.output(0).sample(late) == pytest.approx(left, rel=1e-9, abs=2e-12)


@pytest.mark.parametrize("short", [1e-6, 1e-8])
def test_what_swings_for_too_long_is_given_up_early(short: float, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = []
    step = Run.step
    monkeypatch.setattr(Run, "step", lambda *given: taken.append(1) or step(*given))
    with pytest.raises(UnresolvedError, match="too lightly damped"):
        response(integrator_with_delay(EDGE * (1 - short), 1.0), horizon=50.0 / short)
    assert len(taken) < MAX_STEPS / 10


@pytest.mark.parametrize("beyond", [1e-2, 1e-4, 1e-8])
def test_a_loop_that_is_unstable_by_little_is_shown_for_some_periods(beyond: float) -> None:
    diagram = compile_system(
        document(
            {
                "r": block("input"), "e": block("sum", signs="+-"), "late": block("delay", time=1.0),
                "axis": block("transfer_function", numerator=[EDGE * (1 + beyond)], denominator=[1.0, 0.0]),
            },
            ["r -> e.in1", "e -> late", "late -> axis", "axis -> e.in2"],
            {"y": "axis"},
        )
    )  # fmt: skip
    found = simulate(diagram, signals={"r": STEP}, outputs=["y"], metrics=["overshoot"])
    assert found.metrics["y"]["overshoot"].verdict is Verdict.UNSTABLE
    assert found.time[-1] == pytest.approx(30 * 4.0, rel=0.05)  # a period is four delays


def side_by_side(first: complex, second: complex) -> LinearSystem:
    """x' = -4 x + u(t - first) + u(t - second) with u = 3 (r - x): what goes into two delays jumps with the command."""
    return LinearSystem(
        a=np.array([[-4.0]]), b1=np.zeros((1, 1)), b2=np.ones((1, 2)), c1=np.ones((1, 1)), c2=np.full((2, 1), -3.0),
        d11=np.zeros((1, 1)), d12=np.zeros((1, 2)), d21=np.full((2, 1), 3.0), d22=np.zeros((2, 2)),
        delays=np.array([first, second]), x0=np.zeros(1), inputs=("r",), outputs=("y",),
    )  # fmt: skip


@pytest.mark.parametrize("apart", [0.0, 1e-12])
def test_delays_that_are_equal_move_by_themselves(apart: float) -> None:
    # two jumps at one instant: each belongs to its own delay, and by symmetry each moves the response by half of both
    late = np.array([0.15, 0.25, 0.4, 1.0])
    delays = (0.1, 0.1 + apart)
    moved = [
        side_by_side(delays[0] + 1j * INFINITESIMAL, delays[1]),
        side_by_side(delays[0], delays[1] + 1j * INFINITESIMAL),
    ]
    curve = respond(LaneSystem.of(moved), [STEP], 2.0).output(0)
    pieces = np.searchsorted(curve.times, late, side="right") - 1
    slopes_of = [curve.at(int(k), 0.0, float(t)).imag / INFINITESIMAL for k, t in zip(pieces, late, strict=True)]
    h = 2e-6
    above, below = (response(side_by_side(0.1 + d, 0.1), horizon=2.0).output(0).sample(late) for d in (h, -h))
    for own, expected in zip(slopes_of, (above - below) / (2 * h), strict=True):
        assert own == pytest.approx([expected, expected], rel=1e-6, abs=1e-9)


def behind_two(first: complex, second: complex, weights: tuple[float, float]) -> LinearSystem:
    """x' = -4 x + w(t - 0.2), w the weighted sum of two delayed commands: jumps of two delays meet in a third."""
    d22 = np.zeros((3, 3))
    d22[2, :2] = weights
    return LinearSystem(
        a=np.array([[-4.0]]), b1=np.zeros((1, 1)), b2=np.array([[0.0, 0.0, 1.0]]), c1=np.ones((1, 1)), c2=np.zeros((3, 1)),
        d11=np.zeros((1, 1)), d12=np.zeros((1, 3)), d21=np.array([[1.0], [1.0], [0.0]]), d22=d22,
        delays=np.array([first, second, 0.2]), x0=np.zeros(1), inputs=("r",), outputs=("y",),
    )  # fmt: skip


@pytest.mark.parametrize("weights", [(2.0, 1.0), (1.0, -1.0)])
def test_jumps_of_equal_delays_that_meet_in_a_third_move_by_themselves(weights: tuple[float, float]) -> None:
    late = np.array([0.35, 0.5, 1.0])
    moved = [behind_two(0.1 + 1j * INFINITESIMAL, 0.1, weights), behind_two(0.1, 0.1 + 1j * INFINITESIMAL, weights)]
    curve = respond(LaneSystem.of(moved), [STEP], 2.0).output(0)
    pieces = np.searchsorted(curve.times, late, side="right") - 1
    found = np.array([curve.at(int(k), 0.0, float(t)).imag / INFINITESIMAL for k, t in zip(pieces, late, strict=True)])
    # y = Σ weight (1 - exp(-4 (t - τ - 0.2))) / 4
    expected = -np.exp(-4.0 * (late - 0.3))[:, None] * np.array(weights)
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("damping", "end"), [(0.02, 200.0), (0.005, 700.0)])
def test_integrals_over_a_long_ringing_tail(damping: float, end: float) -> None:
    omega, delay = 20.0, 0.05
    system = LinearSystem(
        a=np.array([[0.0, 1.0], [-(omega**2), -2 * damping * omega]]), b1=np.zeros((2, 1)), b2=np.array([[0.0], [omega**2]]),
        c1=np.array([[1.0, 0.0]]), c2=np.zeros((1, 2)), d11=np.zeros((1, 1)), d12=np.zeros((1, 1)), d21=np.ones((1, 1)),
        d22=np.zeros((1, 1)), delays=np.array([delay]), x0=np.zeros(2), inputs=("r",), outputs=("y",),
    )  # fmt: skip
    found = respond(LaneSystem.of([system]).balanced(), [STEP], end)
    edges = found.edges[:, 0]
    # the integral of e itself over whole time is 2ζ/ω + τ, to which a tail that is not held would add its rounding
    nodes, weights = np.polynomial.legendre.leggauss(24)
    times = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    error = 1.0 - found.output(0).sample(times.ravel()).reshape(times.shape)
    total = float((error @ weights / 2) @ np.diff(edges))
    weighted = float(((error * times) @ weights / 2) @ np.diff(edges))
    assert total == pytest.approx(2 * damping / omega + delay, rel=1e-11)
    # ∫ t e dt = (4ζ² - 1)/ω² of the lag, then moved by τ
    lag = (4 * damping**2 - 1) / omega**2
    assert weighted == pytest.approx(delay**2 / 2 + delay * 2 * damping / omega + lag, abs=3e-15 * end**2)
