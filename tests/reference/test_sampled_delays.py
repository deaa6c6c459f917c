"""Loops of samplers with pure delays, against maps of the test's own and python-control.

A delay behind a hold and one in front of a sampler are computing times and offsets of a loop without them; longer ones are
values under way in a difference equation that is written here by hand.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import control
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from engine.analysis.evaluation import Evaluation
from engine.analysis.measuring import MetricRequest, measure
from engine.analysis.study import frequency_response
from engine.diagram.diagram import Diagram, compile_system
from engine.model.verdicts import Verdict
from optimizers.problem import Goal, Problem, Sense, Uncertain, Variable
from optimizers.solving.solve import solve
from tests.reference.test_sampled_loops import AXES, MS, Axis, bounds
from tests.unit.engine.diagrams import block, document

MARGINS = ("gain_margin_up", "phase_margin", "delay_margin")
KP, KI, PERIOD = 0.15, 0.02, 0.05


def asked(place: str) -> list[MetricRequest]:
    return [MetricRequest(metric=metric, open_at=place) for metric in MARGINS]


def with_delays(axis: Axis, sensor: Fraction = Fraction(0)) -> Diagram:
    """Return an axis whose computing times are blocks behind its controllers, its position measured later by ``sensor`` ms."""
    slow = {"sample_time": float(axis.slow * MS), "offset": float(axis.slow_offset * MS)}
    fast = {"sample_time": float(axis.fast * MS), "offset": float(axis.fast_offset * MS)}
    inertias = {"motor_inertia": axis.motor, "load_inertia": axis.load}
    blocks = {
        "r": block("input"),
        "e": block("sum", signs="+-"),
        "position": block("sampled_pid", kp=axis.kv, **slow),
        "slow_way": block("delay", time=float(axis.slow_delay * MS)),
        "f": block("sum", signs="+-"),
        "speed": block("sampled_pid", kp=axis.kp, ki=axis.ki, **fast),
        "fast_way": block("delay", time=float(axis.fast_delay * MS)),
        "axis": block("two_inertia", **inertias, stiffness=axis.stiffness, damping=axis.damping),
    }
    wires = [
        "r -> e.in1", "e -> position", "position -> slow_way", "slow_way -> f.in1", "axis.motor_speed -> f.in2",
        "f -> speed", "speed -> fast_way", "fast_way -> axis.motor_torque",
    ]  # fmt: skip
    if sensor:
        blocks["sensor"] = block("delay", time=float(sensor * MS))
        wires += ["axis.load_angle -> sensor", "sensor -> e.in2"]
    else:
        wires.append("axis.load_angle -> e.in2")
    return compile_system(document(blocks, wires, {"y": "axis.load_angle"}))


@pytest.mark.parametrize("axis", [AXES[3], AXES[6]])
@pytest.mark.parametrize(
    ("places", "factor"),
    [(("e", "position", "slow_way"), "k_position"), (("f", "speed", "fast_way"), "k_speed")],
)
def test_a_delay_behind_a_hold_is_a_computing_time(axis, places, factor):
    made = with_delays(axis)
    edge = bounds(lambda g: axis.radius(**{factor: np.exp(g)}), np.linspace(0, np.log(500), 60))
    ahead = bounds(lambda q: axis.radius(**{factor: np.exp(-1j * q)}), np.linspace(0, np.pi, 80))
    for place in places:
        (up, _), (phase, _) = measure(made, asked(place)[:2])
        assert up.value == pytest.approx(np.exp(edge[0]), rel=1e-9)
        assert abs(phase.value) == pytest.approx(ahead[0], rel=1e-9)
    (delay, _), (same, _) = (measure(one, asked(places[1])[2:])[0] for one in (made, axis.diagram))
    assert delay.value == pytest.approx(same.value, rel=1e-9)
    poles = np.sort_complex(np.exp(Evaluation(made).poles.values * float(max(axis.slow, axis.fast) * MS)))
    if axis is AXES[6]:
        expected = np.linalg.eigvals(axis.map())
        for value in expected[np.abs(expected) > 1e-9]:
            assert np.abs(poles - value).min() < 1e-8


@pytest.mark.parametrize("axis", [AXES[2]])
def test_a_delay_in_front_of_a_sampler_is_an_earlier_sample(axis):
    sensor = Fraction(3, 10) * axis.slow
    same = replace(axis, slow_offset=(axis.slow_offset - sensor) % axis.slow, slow_delay=axis.slow_delay + sensor)
    made = with_delays(axis, sensor)
    for place, factor in (
        ("e", "k_position"),
        ("sensor", "k_position"),
        ("axis.load_angle", "k_position"),
        ("f", "k_speed"),
    ):
        (up, _), (phase, _) = measure(made, asked(place)[:2])
        edge = bounds(lambda g: same.radius(**{factor: np.exp(g)}), np.linspace(0, np.log(500), 60))  # noqa: B023
        ahead = bounds(lambda q: same.radius(**{factor: np.exp(-1j * q)}), np.linspace(0, np.pi, 80))  # noqa: B023
        assert up.value == pytest.approx(np.exp(edge[0]), rel=1e-9)
        assert abs(phase.value) == pytest.approx(ahead[0], rel=1e-9)
    (delay, _), (expected, _) = (
        measure(one, asked(place)[2:])[0] for one, place in ((made, "sensor"), (same.diagram, "e"))
    )
    assert delay.value == pytest.approx(expected.value, rel=1e-9)


def single(delay: float, *, sensor: bool, legs: int = 1) -> Diagram:
    """Return a loop of one rate with its delay in ``legs`` blocks behind the hold or in front of the sampler."""
    ways = [f"way{k}" for k in range(legs)]
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("sampled_pid", kp=KP, ki=KI, sample_time=PERIOD),
        "p": block("transfer_function", numerator=[2.0], denominator=[1.0, 1.2, 1.0, 0.0]),
    } | {way: block("delay", time=delay / legs) for way in ways}  # fmt: skip
    path = ["c", "p", *ways, "e.in2"] if sensor else ["c", *ways, "p", "e.in2"]
    wires = ["r -> e.in1", "e -> c", *(f"{a} -> {b}" for a, b in pairwise(path))]
    return compile_system(document(blocks, wires, {"y": "p"}))


def radius(delay: float, gain: float, kp: float = KP) -> float:
    """x' = A x + B u(t - m T - ρ): the state, the integral and m + 1 values of u that are under way."""
    m, rho = int(delay / PERIOD + 1e-12), max(delay - PERIOD * int(delay / PERIOD + 1e-12), 0.0)
    flow = np.zeros((4, 4))
    flow[:3, :3] = [[0, 1, 0], [0, 0, 1], [0, -1, -1.2]]
    flow[2, 3] = 1
    early, late = expm(flow * rho), expm(flow * (PERIOD - rho))
    size = 4 + m + 1
    whole, output = np.zeros((size, size)), np.zeros(size)
    output[0], output[3] = -2 * gain * (kp + KI * PERIOD), 1.0
    under_way = np.vstack([output, np.eye(size)[4:]])
    first = early[:3, :3] @ np.eye(size)[:3] + np.outer(early[:3, 3], under_way[m + 1])
    whole[:3] = late[:3, :3] @ first + np.outer(late[:3, 3], under_way[m])
    whole[3, 3], whole[3, 0] = 1.0, -2 * gain * KI * PERIOD
    whole[4:] = under_way[:-1]
    return float(np.abs(np.linalg.eigvals(whole)).max())


@pytest.mark.parametrize("samples", [0.4, 1.0, 2.3, 3.0, 7.9])
@pytest.mark.parametrize(("sensor", "legs"), [(False, 1), (True, 1), (False, 2), (True, 2)])
def test_a_delay_of_many_samples_holds_as_many_values(samples, sensor, legs):
    delay = samples * PERIOD
    made = single(delay, sensor=sensor, legs=legs)
    edge = brentq(lambda k: radius(delay, k) - 1, 1.0, 50.0, xtol=1e-14, rtol=1e-14)
    for place in ("e", "c", "p", *(f"way{k}" for k in range(legs))):
        up = measure(made, asked(place)[:1])[0][0].value
        assert up == pytest.approx(edge, rel=1e-9)
    for part, verdict in ((0.99, Verdict.OK), (1.01, Verdict.UNSTABLE)):
        moved = {"c.kp": part * edge * KP, "c.ki": part * edge * KI}
        assert Evaluation(made, moved).poles.verdict is verdict


@pytest.mark.parametrize("sensor", [False, True])
def test_whole_samples_are_powers_of_z_in_python_control(sensor):
    made, omega = single(3 * PERIOD, sensor=sensor), np.linspace(0.05, 0.98 * np.pi / PERIOD, 25)
    plant = control.ss([[0, 1, 0], [0, 0, 1], [0, -1, -1.2]], [[0], [0], [1]], [[2, 0, 0]], 0)
    law = control.ss([[1.0]], [[KI * PERIOD]], [[1.0]], [[KP + KI * PERIOD]], PERIOD)
    loop = law * control.c2d(plant, PERIOD, "zoh")
    z = np.exp(1j * omega * PERIOD)
    exact = np.array([complex(loop(one)) for one in z]) / z**3
    for place in ("e", "c"):
        found = frequency_response(made, open_at=place, frequencies=omega, metrics=())
        np.testing.assert_allclose(found.response, exact, rtol=1e-9, atol=1e-13)


@pytest.mark.parametrize("sensor", [False, True])
def test_slopes_by_a_delay_are_exact(sensor):
    delay, h = 2.3 * PERIOD, 1e-6
    names = ["way0.time"]
    for place in ("e", "c"):
        found = measure(single(delay, sensor=sensor), asked(place), gradient=names)
        sides = [measure(single(delay * (1 + s * h), sensor=sensor), asked(place)) for s in (1, -1)]
        for row, (_, slopes) in enumerate(found):
            difference = (sides[0][row][0].value - sides[1][row][0].value) / (2 * h * delay)
            assert slopes.values[0] == pytest.approx(difference, rel=1e-5, abs=1e-7)


def test_a_computing_time_that_jitters_is_an_uncertain_delay():
    """The greatest bandwidth on a grid of kp whose gain margin is 2 for every computing time up to 40 ms."""
    made = compile_system(
        document(
            {
                "r": block("input"), "e": block("sum", signs="+-"),
                "c": block("sampled_pid", kp=KP, ki=KI, sample_time=PERIOD),
                "p": block("transfer_function", numerator=[2.0], denominator=[1.0, 1.2, 1.0, 0.0]),
            },
            ["r -> e.in1", "p -> e.in2", "e -> c", "c -> p"], {"y": "p"},
        )
    )  # fmt: skip
    problem = Problem(
        diagram=made,
        variables=(Variable(parameter="c.kp", lower=0.05, upper=0.6),),
        goals=(
            Goal(metric="gain_margin_up", open_at="e", lower=2.0),
            Goal(metric="bandwidth", source="r", target="y", sense=Sense.MAXIMIZE),
        ),
        uncertain=(Uncertain(parameter="c.delay", lower=0.0, upper=0.04),),
    )
    found = solve("grid", problem, {"points": 6})
    assert found.certificate.valid
    tried = np.geomspace(0.05, 0.6, 6)
    margins = [
        [brentq(lambda g: radius(delay, g, kp) - 1, 1e-2, 1e2, xtol=1e-14) for delay in (0.0, 0.01, 0.02, 0.03, 0.04)]  # noqa: B023
        for kp in tried
    ]
    allowed = [k for k, own in enumerate(margins) if min(own) >= 2]
    assert 0 < len(allowed) < 6
    assert found.best["c.kp"] == pytest.approx(tried[allowed[-1]], rel=1e-12)
    assert found.goals[0].after.value == pytest.approx(min(margins[allowed[-1]]), rel=1e-8)


def integrating(period: float, late: float, offset: float, delay: float, *, sensor: bool) -> Diagram:
    """Return y' = u from e = -y by a hold: what arrives at the instant of a sample is there before it."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("gain", gain=0.1 / period),
        "h": block("zero_order_hold", sample_time=period, delay=late, offset=offset), "p": block("integrator"),
    }  # fmt: skip
    path = ["h", "p", "e.in2"]
    if delay:
        blocks["way"] = block("delay", time=delay)
        path = ["h", "p", "way", "e.in2"] if sensor else ["h", "way", "p", "e.in2"]
    wires = ["r -> e.in1", "e -> c", "c -> h", *(f"{a} -> {b}" for a, b in pairwise(path))]
    return compile_system(document(blocks, wires, {"y": "p"}))


@pytest.mark.parametrize("period", [1.0, 0.01, 0.25e-3])
@pytest.mark.parametrize(
    ("late", "offset", "samples", "sensor"),
    [
        (0.1, 0.0, 1, False), (0.1, 0.0, 2, False), (0.1, 0.3, 3, False), (1.0, 0.6, 0, False), (1.0, 0.2, 0, False),
        (0.0, 0.2, 2, True), (1.0, 0.2, 1, True), (0.3, 0.7, 1, True), (0.5, 0.0, 1, False), (1.0, 0.7, 2, False),
    ],
)  # fmt: skip
def test_what_arrives_with_a_sample_counts_whatever_rounding_says(period, late, offset, samples, sensor):
    """y_k+1 = y_k + (1 - f) k u_k-n + f k u_k-n-1, where late + samples is n + f."""
    total = late + samples
    n, f = int(total + 1e-9), (total + 1e-9) % 1 - 1e-9

    def edge(gain: float) -> float:
        size = n + 2
        whole = np.eye(size, k=-1)
        whole[1, 0] = -0.1 * gain
        row = np.zeros(size)
        row[0] = 1.0
        if n:
            row[n] += 1 - f
        else:
            row[0] -= 0.1 * gain * (1 - f)
        row[n + 1] += f
        whole[0] = row
        return float(np.abs(np.linalg.eigvals(whole)).max()) - 1

    made = integrating(period, late * period, offset * period, samples * period, sensor=sensor)
    expected = brentq(edge, 1.0, 1e3, xtol=1e-13)
    for place in ("h", "e"):
        assert measure(made, asked(place)[:1])[0][0].value == pytest.approx(expected, rel=1e-9)
