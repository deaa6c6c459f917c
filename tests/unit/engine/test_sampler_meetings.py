"""Slopes by the times of a limited sampler whose samples meet those of a recording, the steps of a command, or another sampler's.

The references are recursions from instant to instant, written here, and differences of them that converge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from engine.analysis.measuring import MetricRequest, measure
from engine.diagram.diagram import Diagram, compile_system
from engine.exact.nonlinear.recorded import simulate_recorded
from engine.exact.sampled_data import recorded
from engine.model.between_samples import BetweenSamples
from engine.model.tangent import INFINITESIMAL
from engine.signals import make
from tests.unit.engine.diagrams import block, document

Real = npt.NDArray[np.float64]

H, W, KP, KI = 0.02, 8.0, 1.5, 2.0
U = np.concatenate([[0.0], np.random.default_rng(5).normal(size=27)])
TIMES = [
    {"sample_time": 0.05, "offset": 0.0, "delay": 0.0},
    {"sample_time": 0.04, "offset": 0.02, "delay": 0.0},
    {"sample_time": 0.04, "offset": 0.01, "delay": 0.01},
    {"sample_time": 0.06, "offset": 0.02, "delay": 0.03},
    {"sample_time": 0.04, "offset": 0.0, "delay": 0.04},
]


def looped(limit: float | None, *, load: bool, **times: float) -> Diagram:
    limits = {} if limit is None else {"lower": -limit, "upper": limit}
    blocks = {
        "u": block("input"), "e": block("sum", signs="-" if load else "+-"), "n": block("sum", signs="++" if load else "+"),
        "c": block("sampled_pid", kp=KP, ki=KI, **limits, **times),
        "p": block("transfer_function", numerator=[W], denominator=[1.0, W]),
    }  # fmt: skip
    wires = ["u -> n.in2", "p -> e", "c -> n.in1"] if load else ["u -> e.in1", "p -> e.in2", "c -> n"]
    return compile_system(document(blocks, [*wires, "e -> c", "n -> p"], {"y": "p", "c": "c"}))


def followed(times: Mapping[str, float], limit: float, way: BetweenSamples, *, load: bool) -> Real:
    """Return y and c at the records, from instant to instant: y' = w (c + load - y), solved between any two of them."""
    span, count = times["sample_time"], len(U)
    # what happens: 0 a record is passed, 1 the output is updated, 2 a sample is taken
    events = [(k * H, 0, k) for k in range(count)]
    for k in range(math.ceil(count * H / span)):
        taken = times["offset"] + k * span
        events += [(taken, 2, k), (taken + times["delay"], 3 if times["delay"] == 0 else 1, k)]
    events = sorted((round(t, 13), what, k) for t, what, k in events if t < (count - 1) * H + H / 2)
    y = held = integral = now = start = value = slope = 0.0
    computed: dict[int, float] = {}
    found = np.zeros((2, count))
    for place, (t, what, k) in enumerate(events):
        drive, ramp = (value + slope * (now - start), slope) if load else (0.0, 0.0)
        steady = held + drive - ramp / W
        y = steady + ramp * (t - now) + (y - steady) * math.exp(-W * (t - now))
        now = t
        if what == 0:
            start, value = t, float(U[k])
            slope = 0.0 if way is BetweenSamples.HOLD or k + 1 == count else float(U[k + 1] - U[k]) / H
        elif what == 2:
            error = (0.0 if load else value + slope * (t - start)) - y
            wound = integral + KI * span * error
            asked = KP * error + wound
            computed[k] = min(max(asked, -limit), limit)
            if computed[k] == asked or (asked > limit) != (wound > integral):
                integral = wound
        else:
            held = computed[k]
        if place + 1 == len(events) or events[place + 1][0] > t + 1e-11:
            found[:, [round(t / H)] if abs(t / H - round(t / H)) < 1e-9 else []] = [[y], [held]]
    return found


def slope_beside(f: Callable[[float], Real], at: float, side: int = 1, step: float = 1e-6) -> Real:
    """Return the slope towards larger values (1) or smaller ones (-1), from three of them."""
    one, two, three = (f(at + side * k * step) for k in (1, 2, 3))
    return np.asarray(side * (-5 * one + 8 * two - 3 * three) / (2 * step))


def side_of(name: str, times: Mapping[str, float]) -> int:
    """Return on which side samplers come later; a delay of a whole sample time lets the next sample come later where it falls."""
    return -1 if name == "delay" and times["delay"] == times["sample_time"] else 1


def alone(times: Mapping[str, float]) -> npt.NDArray[np.bool_]:
    """Return which records meet neither a sample nor an update: there outputs jump or bend with the sign of a change."""
    k = np.arange(len(U))
    after = [(k * H - times["offset"] - late) / times["sample_time"] for late in (0.0, times["delay"])]
    return np.asarray(np.all([np.abs(part - np.round(part)) > 1e-6 for part in after], axis=0))


@pytest.mark.parametrize("load", [False, True])
@pytest.mark.parametrize("way", [BetweenSamples.HOLD, BetweenSamples.LINEAR])
@pytest.mark.parametrize("limit", [100.0, 0.8])
@pytest.mark.parametrize("times", TIMES)
def test_slopes_where_samples_meet_records(
    times: dict[str, float], limit: float, way: BetweenSamples, *, load: bool
) -> None:
    made, apart = looped(limit, load=load, **times), alone(times)
    moving = [name for name, value in times.items() if value > 0]
    laws = made.laws(None, {f"c.{name}": INFINITESIMAL for name in moving})
    values, found = simulate_recorded(laws, U[None], H, between=way)
    assert values == pytest.approx(followed(times, limit, way, load=load), abs=1e-7)
    for lane, name in enumerate(moving):

        def outputs(value: float, name: str = name) -> Real:
            return followed({**times, name: value}, limit, way, load=load)

        expected = slope_beside(outputs, times[name], side_of(name, times))
        assert found[lane][:, apart] == pytest.approx(
            expected[:, apart], rel=1e-5, abs=1e-5 * np.abs(expected[:, apart]).max()
        )


@pytest.mark.parametrize("way", [BetweenSamples.HOLD, BetweenSamples.LINEAR])
@pytest.mark.parametrize("limit", [100.0, 0.8])
@pytest.mark.parametrize("late", [0.03, 0.04])
def test_slopes_where_what_comes_out_of_a_delay_meets_samples(late: float, limit: float, way: BetweenSamples) -> None:
    """A dead time behind a sampler does what the sampler's own delay does."""
    times = {"sample_time": 0.04, "offset": 0.0, "delay": late}
    blocks = {
        "u": block("input"), "e": block("sum", signs="+-"), "d": block("delay", time=late),
        "c": block("sampled_pid", kp=KP, ki=KI, lower=-limit, upper=limit, sample_time=0.04),
        "p": block("transfer_function", numerator=[W], denominator=[1.0, W]),
    }  # fmt: skip
    made = compile_system(document(blocks, ["u -> e.in1", "p -> e.in2", "e -> c", "c -> d", "d -> p"], {"y": "p"}))
    names, apart = {"sample_time": "c.sample_time", "delay": "d.time"}, alone(times)
    laws = made.laws(None, dict.fromkeys(names.values(), INFINITESIMAL))
    values, found = simulate_recorded(laws, U[None], H, between=way)
    assert values[0] == pytest.approx(followed(times, limit, way, load=False)[0], abs=1e-7)
    for lane, name in enumerate(names):

        def output(value: float, name: str = name) -> Real:
            return np.asarray(followed({**times, name: value}, limit, way, load=False)[0])

        expected = slope_beside(output, times[name], side_of(name, times))
        assert found[lane, 0][apart] == pytest.approx(expected[apart], rel=1e-5, abs=1e-5 * np.abs(expected).max())


def test_slopes_where_what_comes_out_of_a_delay_meets_a_step_before_a_limit() -> None:
    """y' = w (sat(u(t) + u(t - T)) - y) with T two records: a limit lies between what either step alone does and what both do."""
    blocks = {
        "u": block("input"), "d": block("delay", time=2 * H), "n": block("sum", signs="++"),
        "s": block("saturation", lower=-0.9, upper=0.9), "p": block("transfer_function", numerator=[W], denominator=[1.0, W]),
    }  # fmt: skip
    made = compile_system(document(blocks, ["u -> n.in1", "u -> d", "d -> n.in2", "n -> s", "s -> p"], {"y": "p"}))
    given = np.repeat(U[:14], 2)
    laws = made.laws(None, {"d.time": INFINITESIMAL})
    _, found = simulate_recorded(laws, given[None], H, between=BetweenSamples.HOLD)

    def output(late: float) -> Real:
        breaks = sorted({*(k * H for k in range(len(given))), *(k * H + late for k in range(len(given)))})
        y, now, shown = 0.0, 0.0, {0: 0.0}
        for t in breaks[1:]:
            middle = (t + now) / 2
            u, before = (given[int(s / H)] if 0 <= s < H * len(given) else 0.0 for s in (middle, middle - late))
            held = min(max(u + before, -0.9), 0.9)
            y = held + (y - held) * math.exp(-W * (t - now))
            now = t
            shown[round(t / H)] = y if abs(t / H - round(t / H)) < 1e-9 else shown.get(round(t / H), y)
        return np.array([shown[k] for k in range(len(given))])

    expected = slope_beside(output, 2 * H)
    assert found[0, 0, 1::2] == pytest.approx(expected[1::2], abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("way", BetweenSamples)
@pytest.mark.parametrize("times", TIMES)
def test_slopes_are_those_by_matrices(times: dict[str, float], way: BetweenSamples) -> None:
    made = looped(None, load=False, **times)
    moving = {f"c.{name}": INFINITESIMAL for name, value in times.items() if value > 0}
    asked: dict[str, Any] = {"outputs": ("y", "c"), "between": way}
    laws = made.laws(None, moving)
    values, slopes = simulate_recorded(laws, U[None], H, **asked)
    found = recorded.simulate_recorded(laws, U[None], H, **asked)
    assert found is not None
    assert found[0] == pytest.approx(values, abs=1e-11)
    assert found[1] == pytest.approx(slopes, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize(
    ("entry", "order", "one_sided"), [("r", 1, True), ("d", 1, True), ("d", 2, False)]
)  # fmt: skip
def test_a_step_at_a_sample_has_two_slopes_where_the_controller_sees_it_at_once(
    entry: str, order: int, *, one_sided: bool
) -> None:
    """A reference jumps in the error, a load bends it behind one lag; behind two it does neither."""
    plant = block("transfer_function", numerator=[64.0], denominator=[1.0, 9.0, 64.0] if order == 2 else [8.0, 64.0])
    blocks = {
        "r": block("input"), "d": block("input"), "e": block("sum", signs="+-"), "n": block("sum", signs="++"), "p": plant,
        "c": block("sampled_pid", kp=1.5, ki=2.0, lower=-1.2, upper=1.2, sample_time=0.05),
    }  # fmt: skip
    wires = ["r -> e.in1", "p -> e.in2", "e -> c", "c -> n.in1", "d -> n.in2", "n -> p"]
    made = compile_system(document(blocks, wires, {"y": "p", "c": "c"}))
    signals = {entry: make("step", {"amplitude": 1.0, "start": 0.2})}
    requests = [
        MetricRequest(metric=name, signals=signals, output="y", duration=1.0) for name in ("iae", "ise", "itae")
    ]

    def values(sample_time: float) -> Real:
        found = measure(made, requests, overrides={"c.sample_time": sample_time})
        return np.array([measured.value for measured, _ in found])

    expected = slope_beside(values, 0.05, step=1e-5)
    for (_, gradient), slope in zip(measure(made, requests, gradient=["c.sample_time"]), expected, strict=True):
        assert gradient is not None
        assert gradient.one_sided is one_sided
        assert gradient.values[0] == pytest.approx(slope, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize(("name", "side"), [("c.sample_time", 1), ("z.sample_time", -1)])
def test_two_samplers_that_meet_have_the_slopes_of_their_order(name: str, side: int) -> None:
    """The measurement is held before the controller reads it: a controller that comes sooner reads the one before."""
    blocks = {
        "u": block("input"), "e": block("sum", signs="+-"), "z": block("zero_order_hold", sample_time=0.08),
        "c": block("sampled_pid", kp=KP, ki=KI, lower=-1.0, upper=1.0, sample_time=0.04),
        "p": block("transfer_function", numerator=[64.0], denominator=[1.0, 9.0, 64.0]),
    }  # fmt: skip
    made = compile_system(document(blocks, ["u -> e.in1", "z -> e.in2", "e -> c", "c -> p", "p -> z"], {"y": "p"}))
    _, found = simulate_recorded(made.laws(None, {name: INFINITESIMAL}), U[None], H, between=BetweenSamples.HOLD)

    def output(value: float) -> Real:
        return np.asarray(simulate_recorded(made.laws({name: value}), U[None], H, between=BetweenSamples.HOLD)[0][0])

    expected = slope_beside(output, made.parameters[name].value, side)
    assert found[0, 0, 1::2] == pytest.approx(expected[1::2], abs=1e-5 * np.abs(expected).max())
    signals = {"u": make("step", {"amplitude": 1.0})}
    request = MetricRequest(metric="iae", signals=signals, output="y", duration=1.01)
    ((_, gradient),) = measure(made, [request], gradient=[name])
    assert gradient is not None
    assert gradient.one_sided
