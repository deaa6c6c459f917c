"""Delays of any length, anywhere, are exact: in time against the sum of echoes, in frequency and stability by closed forms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import lambertw

from engine.analysis.study import MetricRequest, frequency_response, measure, simulate
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict
from tests.reference import echo_oracle
from tests.reference.echo_oracle import Delayed, mp
from tests.reference.measuring import expect, step
from tests.reference.systems import block, system

PRECISE = 1e-12
"""Relative to the largest value; 1e-7 is asked of a response with delays, 1e-6 of an acceleration."""


def loop(delay: Any, numerator: Sequence[Any], denominator: Sequence[Any], **parameters: float) -> Diagram:
    """r -> e -> e^{-s delay} -> num/den -> y with unity negative feedback, cut at e."""
    return system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "late": block("delay", time=delay),
            "plant": block("transfer_function", numerator=[*numerator], denominator=[*denominator]),
        },
        ["r -> e.in1", "plant -> e.in2", "e -> late", "late -> plant"],
        {"y": "plant"},
        parameters,
    )


def check(diagram: Diagram, output: str, *, forward: Sequence[Delayed], around: Sequence[Delayed], end: float) -> None:
    done = simulate(diagram, signals={"r": step()}, outputs=[output], duration=end, samples=13, metrics=[])
    exact = np.array([echo_oracle.step_response(forward, around, float(t)) for t in done.time])
    assert np.abs(done.curves[output] - exact).max() <= PRECISE * np.abs(exact).max()
    first = min(delay for _, delay in forward)
    assert not done.curves[output][done.time < first].any()  # exactly 0.0 before anything can arrive


def test_two_delays_of_different_length_in_one_loop() -> None:
    diagram = system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "transport": block("delay", time=0.31),
            "plant": block("transfer_function", numerator=[1], denominator=[1, 1, 0]),
            "bus": block("delay", time=0.17),
            "sensor": block("transfer_function", numerator=[1], denominator=[0.2, 1]),
        },
        ["r -> e.in1", "e -> transport", "transport -> plant", "plant -> bus", "bus -> sensor", "sensor -> e.in2"],
        {"y": "plant"},
    )

    def plant(s: Any) -> Any:
        return 1 / (s * (s + 1))

    def around(s: Any) -> Any:
        return plant(s) / (s * mp.mpf(0.2) + 1)

    check(diagram, "y", forward=[(plant, 0.31)], around=[(around, mp.mpf(0.31) + mp.mpf(0.17))], end=5.0)


def test_two_loops_with_delays_of_no_common_measure() -> None:
    # position loop over a bus of 0.31 s, velocity loop of 0.123 s inside: 1 + e^{-0.31 s}/(s(s+1)) + e^{-0.123 s} 0.4/(s+1)
    diagram = system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "bus": block("delay", time=0.31),
            "inner": block("sum", signs="+-"),
            "mass": block("transfer_function", numerator=[1], denominator=[1, 1]),
            "sensor": block("delay", time=0.123),
            "gain": block("gain", gain=0.4),
            "way": block("integrator"),
        },
        [
            "r -> e.in1",
            "e -> bus",
            "bus -> inner.in1",
            "inner -> mass",
            "mass -> sensor",
            "sensor -> gain",
            "gain -> inner.in2",
            "mass -> way",
            "way -> e.in2",
        ],
        {"y": "way", "velocity": "mass"},
    )
    around: list[Delayed] = [(lambda s: 1 / (s * (s + 1)), 0.31), (lambda s: mp.mpf(0.4) / (s + 1), 0.123)]
    check(diagram, "y", forward=[(lambda s: 1 / (s * (s + 1)), 0.31)], around=around, end=1.8)
    check(diagram, "velocity", forward=[(lambda s: 1 / (s + 1), 0.31)], around=around, end=1.8)


@pytest.mark.parametrize(("output", "power"), [("y", 0), ("v", 1), ("a", 2)])
def test_acceleration_behind_a_delay(output: str, power: int) -> None:
    # a lightly damped servo axis: e^{-0.05 s} 1200/(s (s^2 + 12 s + 400))
    diagram = system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "late": block("delay", time=0.05),
            "axis": block(
                "state_space", A=[[0, 1, 0], [0, 0, 1], [0, -400, -12]], B=[[0], [0], [1200]], C=np.eye(3).tolist(),
                D=[[0], [0], [0]],
            ),
        },
        ["r -> e.in1", "axis.out1 -> e.in2", "e -> late", "late -> axis"],
        {"y": "axis.out1", "v": "axis.out2", "a": "axis.out3"},
    )  # fmt: skip

    def axis(s: Any) -> Any:
        return 1200 / (s * (s * s + 12 * s + 400))

    check(diagram, output, forward=[(lambda s: s**power * axis(s), 0.05)], around=[(axis, 0.05)], end=0.7)


def test_echoes_that_jump_for_ever() -> None:
    # e^{-0.3 s} (s/2 + 1)/(s + 1): neutral, every echo of the step is a jump half as high
    def around(s: Any) -> Any:
        return (s / 2 + 1) / (s + 1)

    diagram = loop(0.3, [0.5, 1], [1, 1])
    done = simulate(diagram, signals={"r": step()}, duration=2.3, samples=24, metrics=[])
    away = np.abs(done.time / 0.3 - np.round(done.time / 0.3)) > 1e-3  # at a jump both values are right
    exact = [echo_oracle.step_response([(around, 0.3)], [(around, 0.3)], float(t)) for t in done.time[away]]
    assert done.curves["y"][away] == pytest.approx(exact, abs=1e-12)
    assert done.verdict is Verdict.OK


def test_a_path_beside_the_delay_answers_at_once() -> None:
    diagram = system(
        {
            "r": block("input"),
            "late": block("delay", time=1.0),
            "both": block("sum", signs="++"),
            "lag": block("transfer_function", numerator=[1], denominator=[1, 1]),
        },
        ["r -> late", "late -> both.in1", "r -> both.in2", "both -> lag"],
        {"y": "lag", "late": "late"},
    )
    done = simulate(diagram, signals={"r": step()}, duration=2.0, samples=21, metrics=[])
    exact = -np.expm1(-done.time) + np.where(done.time > 1, -np.expm1(-(done.time - 1)), 0.0)
    assert done.curves["y"] == pytest.approx(exact, abs=1e-13)
    assert not done.curves["late"][done.time < 1 - 1e-9].any()


def test_nothing_comes_before_the_delay_even_where_a_mode_is_hidden() -> None:
    # a lag, then a delay, then s/(s (s+1)): the integrator cancels, and the states are turned to leave it out
    diagram = system(
        {
            "r": block("input"),
            "filter": block("transfer_function", numerator=[1], denominator=[0.1, 1]),
            "late": block("delay", time=1.0),
            "plant": block("transfer_function", numerator=[1, 0], denominator=[1, 1, 0]),
        },
        ["r -> filter", "filter -> late", "late -> plant"],
        {"y": "plant"},
    )
    done = simulate(diagram, signals={"r": step()}, outputs=["y"], duration=3.0, samples=61, metrics=[])
    assert (done.curves["y"][done.time < 1] == 0.0).all()
    late = np.maximum(done.time - 1, 0)
    assert done.curves["y"] == pytest.approx(1 - (np.exp(-late) - 0.1 * np.exp(-10 * late)) / 0.9, abs=1e-12)


@pytest.mark.parametrize("delay", [1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3])
def test_a_delay_of_any_length_before_a_lag_only_shifts(delay: float) -> None:
    diagram = system(
        {
            "r": block("input"),
            "late": block("delay", time=delay),
            "lag": block("transfer_function", numerator=[1], denominator=[1, 1]),
        },
        ["r -> late", "late -> lag"],
        {"y": "lag"},
    )
    got = simulate(diagram, signals={"r": step()}, outputs=["y"]).metrics["y"]
    expect(got["rise_time"], math.log(9))
    expect(got["settling_time"], delay + math.log(50))
    expect(got["iae"], delay + 1)
    expect(got["overshoot"], 0.0)


@pytest.mark.parametrize("delay", [1e-15, 1e-12, 1e-9, 1e-6])
def test_a_very_short_delay_in_a_loop_changes_next_to_nothing(delay: float) -> None:
    # s^2 + s + 1/2: damping ratio 1/sqrt 2, overshoot e^-pi; d overshoot / d delay is of the order of 1
    got = simulate(loop(delay, [0.5], [1, 1, 0]), signals={"r": step()}, outputs=["y"])
    assert got.verdict is Verdict.OK
    expect(got.metrics["y"]["overshoot"], math.exp(-math.pi), relative=1e-9 + 10 * delay)
    study = frequency_response(loop(delay, [0.5], [1, 1, 0]), open_at="e")
    expect(study.metrics["damping_ratio"], math.sqrt(0.5), relative=1e-9 + 10 * delay)
    expect(study.metrics["critical_frequency"], math.sqrt(0.5), relative=1e-9 + 10 * delay)


def test_fifty_delays_in_one_loop_are_one_of_their_sum() -> None:
    times = [0.01 * (1 + 0.1 * math.sin(i)) for i in range(50)]
    blocks = {"r": block("input"), "e": block("sum", signs="+-"), "plant": block("transfer_function", numerator=[0.5], denominator=[1, 1, 0])}  # fmt: skip
    blocks |= {f"d{i}": block("delay", time=time) for i, time in enumerate(times)}
    chain = ["e", *(f"d{i}" for i in range(50)), "plant"]
    wires = ["r -> e.in1", "plant -> e.in2", *(f"{a} -> {b}" for a, b in itertools.pairwise(chain))]
    many = simulate(system(blocks, wires, {"y": "plant"}), signals={"r": step()}, outputs=["y"], duration=20.0)
    one = simulate(loop(math.fsum(times), [0.5], [1, 1, 0]), signals={"r": step()}, outputs=["y"], duration=20.0)
    assert many.curves["y"] == pytest.approx(one.curves["y"], abs=1e-12)
    for metric, value in one.metrics["y"].items():
        if value.value is not None:
            expect(many.metrics["y"][metric], value.value)


def crossings(delay: float, gain: float) -> list[tuple[float, float]]:
    """All (ω, gain margin) of gain e^{-s delay}/(s (s+1)) with |L| >= 1e-3: ω delay + atan ω = π/2 + 2πk."""
    found = []
    for k in range(100_000):
        turn = mpmath.pi / 2 + 2 * mpmath.pi * k
        w = mpmath.findroot(lambda x: x * mpmath.mpf(delay) + mpmath.atan(x) - turn, turn / delay - 0.5 / delay)  # noqa: B023 - solved at once
        size = gain / (w * mpmath.sqrt(1 + w * w))
        if size < mpmath.mpf("1e-3"):
            return found
        found.append((float(w), float(1 / size)))
    raise AssertionError


@pytest.mark.parametrize("delay", [0.3, 10.0, 100.0])
def test_every_crossing_down_to_the_cut_is_listed(delay: float) -> None:
    study = frequency_response(loop(delay, [0.5], [1, 1, 0]), open_at="e")
    assert study.margins is not None
    assert study.margins.smallest_loop_gain == 1e-3
    expected = crossings(delay, 0.5)
    assert len(study.margins.gain) == len(expected)
    for (at, value), (w, margin) in zip(sorted(study.margins.gain), expected, strict=True):
        assert at == pytest.approx(w, rel=1e-9)
        assert value == pytest.approx(margin, rel=1e-9)


def test_a_faint_crossing_gives_the_margin() -> None:
    # e^{-1e-4 s}/(2 s (s+1)) crosses -180 degrees where atan(w) + 1e-4 w = pi/2; |L| is 5e-5 there
    omega = brentq(lambda w: math.atan(w) + 1e-4 * w - math.pi / 2, 1.0, 1e3, xtol=1e-14, rtol=1e-15)
    margin = frequency_response(loop(1e-4, [0.5], [1, 1, 0]), open_at="e").metrics["gain_margin"]
    assert margin.value == pytest.approx(2 * omega * math.hypot(1.0, omega), rel=1e-9)


def test_a_margin_beyond_the_cut_is_not_called_infinite() -> None:
    # with a delay of 1e-12 s the crossing lies near 1e6 rad/s, where |L| is 5e-13
    margin = frequency_response(loop(1e-12, [0.5], [1, 1, 0]), open_at="e").metrics["gain_margin"]
    assert (margin.value, margin.verdict) == (None, Verdict.NEVER_CROSSES)
    assert "1e-09" in margin.advice
    assert "infinite" not in margin.advice


def test_the_delay_margin_is_the_delay_that_brings_the_limit() -> None:
    margin = frequency_response(loop(0.2, [1.0], [1, 1, 0]), open_at="e").metrics["delay_margin"].value
    # |L| = 1 where w^2 (1 + w^2) = 1; phase margin pi/2 - atan w - 0.2 w
    w = math.sqrt((math.sqrt(5) - 1) / 2)
    assert margin == pytest.approx((math.pi / 2 - math.atan(w)) / w - 0.2, rel=1e-10)
    verdicts = [
        frequency_response(loop(0.2 + margin * factor, [1.0], [1, 1, 0]), open_at="e").verdict
        for factor in (0.9999, 1.0, 1.0001)
    ]
    assert verdicts == [Verdict.OK, Verdict.MARGINAL, Verdict.UNSTABLE]


@pytest.mark.parametrize("gain", [0.5, 1.5, 1.6, 7.0, 8.0, 30.0, 60.0])
def test_nyquist_counts_the_unstable_poles_of_a_delay_loop(gain: float) -> None:
    # s = -K e^{-s}: s = W_k(-K) on every branch k; a pair becomes unstable at K = pi/2 + 2 pi k
    study = frequency_response(loop(1.0, [gain], [1, 0]), open_at="e")
    unstable = sum(lambertw(-gain, k).real > 0 for k in range(-60, 60))
    assert study.nyquist is not None
    assert (study.nyquist.open_loop, study.nyquist.closed_loop) == (0, unstable)
    assert study.nyquist.encirclements == -unstable
    assert (study.verdict is Verdict.UNSTABLE) == (unstable > 0)


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([25], [1, 10, 10, 10]),
        ([1, 0.5, 0.05], [1, 0, 0, 0]),  # conditionally stable, three integrators
        ([0.05, 0.025, 0.0025], [1, 0, 0, 0]),
        ([10], [1, 2, 1, 0]),
        ([3, 6], [1, -1]),  # an unstable plant made stable
        ([0.5], [1, -1]),
        ([1], [1, 1, 1, 1, 0]),  # poles at 0 and at +-j
        ([1, 1], [1, 0.5, 1, 0.5]),
        ([-3, 1], [1, 1]),  # direct feed-through beyond -1
        ([1], [1, 0, 0, 0]),
    ],
)
def test_nyquist_counts_what_the_polynomial_says(numerator: list[float], denominator: list[float]) -> None:
    diagram = system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "plant": block("transfer_function", numerator=numerator, denominator=denominator),
        },
        ["r -> e.in1", "plant -> e.in2", "e -> plant"],
        {"y": "plant"},
    )
    closed = np.roots(np.polyadd(numerator, denominator))
    opened = np.roots(denominator)
    study = frequency_response(diagram, open_at="e")
    assert study.nyquist is not None
    assert study.nyquist.closed_loop == np.count_nonzero(closed.real > 0)
    assert study.nyquist.open_loop == np.count_nonzero(opened.real > 1e-9)
    assert not study.warnings


@pytest.mark.parametrize(
    ("gain", "verdict"),
    [(0.95, Verdict.OK), (1.0, Verdict.UNSTABLE), (1.01, Verdict.UNSTABLE), (-1.0, Verdict.UNSTABLE)],
)
def test_a_neutral_loop_is_stable_only_below_a_direct_gain_of_one(gain: float, verdict: Verdict) -> None:
    # e^{-0.3 s} (gain s + 0.9)/(s + 1): |L(j inf)| = |gain|; Hale and Verduyn Lunel 2002
    diagram = loop(0.3, [gain, 0.9], [1, 1])
    done = simulate(diagram, signals={"r": step()}, outputs=["y"])
    assert done.verdict is verdict
    assert np.isfinite(done.curves["y"]).all()
    study = frequency_response(diagram, open_at="e")
    assert study.verdict is verdict
    assert any("no end" in remark.detail for remark in study.warnings)


def test_how_a_delay_moves_the_metrics_of_its_loop() -> None:
    # K e^{-s T}/s: gain margin pi/(2 K T), phase margin pi/2 - K T, delay margin (pi/2 - K T)/K, iae 1/K + ... for small K T
    diagram = loop("=lateness", ["=gain"], [1, 0], lateness=0.3, gain=0.9)
    requests = [MetricRequest(metric=name, open_at="e") for name in ("gain_margin", "phase_margin", "delay_margin")]
    found = measure(diagram, requests, gradient=["lateness", "gain"])
    k, tau = 0.9, 0.3
    values = [math.pi / (2 * k * tau), math.pi / 2 - k * tau, (math.pi / 2 - k * tau) / k]
    slopes = [
        (-math.pi / (2 * k * tau**2), -math.pi / (2 * k**2 * tau)),
        (-k, -tau),
        (-1.0, -math.pi / (2 * k**2)),
    ]
    for (measured, gradient), value, slope in zip(found, values, slopes, strict=True):
        expect(measured, value)
        assert gradient is not None
        assert gradient.values == pytest.approx(slope, rel=1e-9)


def late_integrator(**approximation: Any) -> Diagram:
    """e^{-0.1 s}/s in unity feedback."""
    return system(
        {
            "r": block("input"),
            "e": block("sum", signs="+-"),
            "late": block("delay", time="=lateness", **approximation),
            "plant": block("integrator"),
        },
        ["r -> e.in1", "plant -> e.in2", "e -> late", "late -> plant"],
        {"y": "plant", "late": "late"},
        {"lateness": 0.1},
    )


@pytest.mark.parametrize(("order", "margin"), [(1, 20.0), (2, 15.826), (3, 15.7101)])
def test_pade_where_it_is_asked_for_and_only_there(order: int, margin: float) -> None:
    # the gain margins that python-control 0.10.2 gives with pade(0.1, n); exact is 5 pi = 15.70796
    approximate = late_integrator(approximation="pade", order=order)
    got = frequency_response(approximate, open_at="e").metrics["gain_margin"]
    assert got.value == pytest.approx(margin, rel=3e-5)
    expect(frequency_response(late_integrator(), open_at="e").metrics["gain_margin"], 5 * math.pi)
    # it answers before the delay, which is why it is not the default
    curves = simulate(approximate, signals={"r": step()}, duration=0.2, samples=21, metrics=[]).curves
    assert curves["late"][0] == pytest.approx((-1) ** order, abs=1e-12)


@pytest.mark.parametrize("order", [1, 2, 4, 7, 10])
def test_pade_is_the_quotient_of_its_definition(order: int) -> None:
    frequency = np.geomspace(0.1, 100 * order, 40)
    diagram = system(
        {"u": block("input"), "late": block("delay", time=0.1, approximation="pade", order=order)},
        ["u -> late"],
        {"y": "late"},
    )
    got = frequency_response(diagram, source="u", target="y", frequencies=frequency, metrics=[]).response
    for w, value in zip(frequency, got, strict=True):
        with mpmath.workdps(40):  # its linear system is badly conditioned
            top, bottom = mpmath.pade(mpmath.taylor(mpmath.exp, 0, 2 * order), order, order)
        x = mpmath.mpc(0, -0.1 * w)
        assert value == pytest.approx(
            complex(mpmath.polyval(top, x, asc=True) / mpmath.polyval(bottom, x, asc=True)), abs=1e-9
        )


def test_how_the_approximant_moves_with_the_delay() -> None:
    # order 1: (1 - sT/2)/(1 + sT/2)/s has its phase crossing at 2/T, where |L| = T/2
    request = MetricRequest(metric="gain_margin", open_at="e")
    ((measured, gradient),) = measure(late_integrator(approximation="pade", order=1), [request], gradient=["lateness"])
    expect(measured, 20.0)
    assert gradient is not None
    assert gradient.values == pytest.approx([-200.0], rel=1e-9)
