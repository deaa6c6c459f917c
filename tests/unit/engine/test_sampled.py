from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from engine.exact.time.sampled import Drive, simulate_sampled
from engine.exact.time.trajectory import respond
from engine.model.linear_system import LaneSystem, LinearSystem
from engine.model.tangent import INFINITESIMAL
from engine.signals import make


def lag(time_constant, gain=1.0):
    one = np.ones((1, 1))
    return LinearSystem.delay_free(-one / time_constant, one / time_constant, gain * one, 0 * one)


def loop(gain, time_constant, delay):
    """Integrator behind a lag and a delay, closed: z = gain (u - x), lag and integrator driven by the delayed z."""
    kind = np.result_type(gain, time_constant, delay, float)
    return LinearSystem(
        a=np.array([[-1 / time_constant, 0], [1, 0]], kind),
        b1=np.zeros((2, 1), kind),
        b2=np.array([[1 / time_constant], [0]], kind),
        c1=np.array([[0, 1]], kind),
        c2=np.array([[0, -gain]], kind),
        d11=np.zeros((1, 1), kind),
        d12=np.zeros((1, 1), kind),
        d21=np.array([[gain]], kind),
        d22=np.zeros((1, 1), kind),
        delays=np.array([delay], kind),
        x0=np.zeros(2, kind),
        inputs=("u",),
        outputs=("y",),
    )


def recorded(samples=400, seed=3):
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(size=samples))[None] + 5.0


def test_a_lag_follows_the_closed_form_between_samples():
    h, tau, u = 0.01, 0.037, recorded()
    # on a ramp of slope s the lag's output is u - τ s plus what decays with e^{-t/τ}
    y = [u[0, 0]]
    for before, after in zip(u[0, :-1], u[0, 1:], strict=True):
        slope = (after - before) / h
        y.append(after - tau * slope + np.exp(-h / tau) * (y[-1] - before + tau * slope))
    assert simulate_sampled(lag(tau), u, h)[0] == pytest.approx(np.array(y), rel=1e-11, abs=1e-10)


def test_a_lag_much_faster_than_the_samples_is_still_exact():
    # τ = h / 1000: y = u - τ s at every sample but for e^{-1000}
    h, u = 0.01, recorded(50)
    slope = np.diff(u[0], prepend=u[0, 0]) / h
    assert simulate_sampled(lag(1e-5), u, h)[0] == pytest.approx(u[0] - 1e-5 * slope, rel=1e-10)


@pytest.mark.parametrize("delay", [0.0005, 0.023, 0.05, 1.7])
def test_a_delay_of_any_length_shifts_the_line_between_the_samples(delay):
    zero, one, none = np.zeros((1, 1)), np.ones((1, 1)), np.zeros((0, 0))
    system = LinearSystem(
        a=none, b1=np.zeros((0, 1)), b2=np.zeros((0, 1)), c1=np.zeros((1, 0)), c2=np.zeros((1, 0)),
        d11=zero, d12=one, d21=one, d22=zero, delays=np.array([delay]), x0=np.zeros(0), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    h, u = 0.01, recorded(300)
    time = h * np.arange(300)
    assert simulate_sampled(system, u, h)[0] == pytest.approx(np.interp(time - delay, time, u[0]), rel=1e-11)


def test_a_delay_in_a_loop_agrees_with_the_continuous_response_to_the_same_polyline():
    h, system = 0.01, loop(30.0, 0.012, 0.0137)
    u = recorded(60)
    u -= u[0, 0]
    signal = make("sampled", {"time": (h * np.arange(60)).tolist(), "values": u[0].tolist()})
    curve = respond(LaneSystem.of([system]), [signal], 0.59).output(0)
    assert simulate_sampled(system, u, h)[0] == pytest.approx(curve.sample(h * np.arange(60)), abs=1e-10)


def test_a_constant_input_finds_the_system_at_rest():
    y = simulate_sampled(loop(30.0, 0.012, 0.0137), np.full((1, 200), 2.5), 0.01)
    assert y == pytest.approx(np.full((1, 200), 2.5), rel=1e-12)


def test_an_integrator_starts_from_its_initial_state():
    one = np.ones((1, 1))
    system = replace(LinearSystem.delay_free(0 * one, 2 * one, one, 0 * one), x0=np.array([7.0]))
    h, u = 0.01, recorded(200)
    area = np.concatenate([[0.0], np.cumsum((u[0, 1:] + u[0, :-1]) / 2 * h)])
    assert simulate_sampled(system, u, h)[0] == pytest.approx(7 + 2 * area, rel=1e-11)


def test_an_unstable_system_is_simulated_until_it_leaves_what_numbers_can_say():
    one = np.ones((1, 1))
    u = np.ones((1, 101))
    grows = LinearSystem.delay_free(2 * one, one, one, 0 * one)
    time = 0.01 * np.arange(101)
    assert simulate_sampled(grows, u, 0.01)[0] == pytest.approx((np.exp(2 * time) - 1) / 2, rel=1e-10, abs=1e-12)
    explodes = LinearSystem.delay_free(1000 * one, one, one, 0 * one)
    assert np.isposinf(simulate_sampled(explodes, u, 0.01)).all()


def test_several_inputs_superpose_and_direct_gains_pass_at_once():
    a, b = -np.eye(2), np.eye(2)
    system = LinearSystem.delay_free(
        a, b, np.array([[1.0, 2.0]]), np.array([[0.0, 3.0]]), inputs=("u", "v"), outputs=("y",)
    )
    u = np.vstack([recorded(100, 4), recorded(100, 5)])
    alone = simulate_sampled(lag(1.0), u[:1], 0.1) + 2 * simulate_sampled(lag(1.0), u[1:], 0.1) + 3 * u[1:]
    assert simulate_sampled(system, u, 0.1) == pytest.approx(alone, rel=1e-10)


def test_outputs_are_chosen_by_name_and_silent_inputs_drive_nothing():
    a = -np.diag([1.0, 2.0])
    system = LinearSystem.delay_free(a, np.eye(2), np.eye(2), np.zeros((2, 2)), inputs=("u", "v"), outputs=("x", "y"))
    u = np.vstack([recorded(100, 4), np.zeros(100)])
    both = simulate_sampled(system, u, 0.1)
    assert both[0] == pytest.approx(simulate_sampled(lag(1.0), u[:1], 0.1)[0])
    assert not both[1].any()
    assert simulate_sampled(system, u, 0.1, outputs=("y", "x")).tolist() == both[::-1].tolist()


def test_tangents_are_the_converged_differences():
    point, u = np.array([30.0, 0.012, 0.0137]), recorded()
    lanes = LaneSystem.of([loop(*(point + 1j * INFINITESIMAL * unit)) for unit in np.eye(3)])
    drive = Drive(u, 0.01)
    values, tangents = drive.respond(lanes)
    # rounding is that of the largest value, also where the response passes 0
    assert values == pytest.approx(simulate_sampled(loop(*point), u, 0.01), abs=1e-13 * np.abs(values).max())
    for k, unit in enumerate(np.eye(3)):
        step = 1e-4 * point[k]
        up, down = (simulate_sampled(loop(*(point + sign * step * unit)), u, 0.01)[0] for sign in (1, -1))
        difference = (up - down) / (2 * step)
        assert tangents[k, 0] == pytest.approx(difference, abs=1e-5 * np.abs(difference).max())


def test_a_drive_gives_the_same_again_for_a_slower_system():
    u = recorded(2000)
    drive = Drive(u, 0.01)
    drive.respond(LaneSystem.of([loop(30.0, 0.012, 0.0137)]))
    slow = loop(2.0, 0.012, 0.0137)
    assert drive.respond(LaneSystem.of([slow]))[0] == pytest.approx(simulate_sampled(slow, u, 0.01), abs=1e-8)


@pytest.mark.parametrize("delay", [0.0137, 1.2e-3, 1e-5])
def test_the_samples_are_those_of_the_method_of_steps(delay):
    u = recorded(40) - recorded(40)[:, :1]
    command = make("sampled", {"time": 0.01 * np.arange(40), "values": u[0]})
    follow = respond(LaneSystem.of([loop(30.0, 0.012, delay)]), [command], 0.39).output(0)
    assert simulate_sampled(loop(30.0, 0.012, delay), u, 0.01)[0] == pytest.approx(
        follow.sample(0.01 * np.arange(40)), abs=1e-8
    )


def test_a_vanishing_delay_goes_over_into_none():
    u = recorded()
    closed = LinearSystem.delay_free(
        np.array([[-1 / 0.012, -30 / 0.012], [1, 0]]),
        np.array([[30 / 0.012], [0]]),
        np.array([[0.0, 1.0]]),
        np.zeros((1, 1)),
    )
    none = simulate_sampled(closed, u, 0.01)
    for delay in (1e-7, 1e-9, 1e-13):
        assert simulate_sampled(loop(30.0, 0.012, delay), u, 0.01) == pytest.approx(none, abs=1e-7 + 120 * delay)


def test_a_transient_may_be_a_million_delays_long():
    # a loop of 1e-3 1/s behind a delay of 13.7 ms follows like its one slow pole
    u = np.ones((1, 20_000))
    u[0, 0] = 0.0
    y = simulate_sampled(loop(1e-3, 0.012, 0.0137), u, 0.1)[0]
    assert y[10_000] == pytest.approx(1 - np.exp(-1e-3 * 1000), abs=5e-5)


@pytest.mark.parametrize(
    ("inputs", "sample_time", "message"),
    [
        (np.zeros(5), 0.1, "rows of samples"),
        (np.zeros((2, 5)), 0.1, "1 rows"),
        (np.zeros((1, 0)), 0.1, "rows of samples"),
        (np.array([[0.0, np.nan]]), 0.1, "finite"),
        (np.zeros((1, 5)), 0.0, "sample_time must be > 0 s"),
    ],
)
def test_inputs_that_are_no_recording_are_refused(inputs, sample_time, message):
    with pytest.raises(ValueError, match=message):
        simulate_sampled(lag(1.0), inputs, sample_time)
