"""A law that remembers its mode: what ends it and what follows, as formulas, is what the law itself says; marches are cut there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from engine.analysis.measuring import MetricRequest, measure
from engine.batch.nonlinear.arithmetic import Formulas
from engine.batch.nonlinear.batch import NonlinearBatch
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.march import Marched, Marcher, Pieces, by_input
from engine.batch.nonlinear.program import Compiled
from engine.diagram.diagram import Diagram, compile_system
from engine.elements._nonlinear import Moment
from engine.model.traced import Op, UnsuitableError
from engine.signals import Signal, make
from tests.unit.engine.batch_nonlinear.test_recording import alone, moments
from tests.unit.engine.diagrams import block, document

REMEMBERING: dict[str, tuple[str, dict[str, Any], list[int]]] = {
    "backlash": ("backlash", {"width": 0.02}, [-1, 0, 1]),
    "rate limiter": ("rate_limiter", {"rising": 2.0, "falling": 3.0}, [-1, 0, 1, 2]),
    "relay": ("relay", {"low": -3.0, "high": 2.0, "hysteresis": 0.4}, [-1, 1]),
    "switch": ("switch", {"threshold": 0.3, "hysteresis": 0.2}, [-1, 1]),
    "friction": ("friction", {"coulomb": 20.0, "viscous": 2.0, "static": 30.0, "stribeck_velocity": 0.5}, [-1, 1, 2, 3]),
    "clamping": (
        "pid", {"kp": 2.0, "ki": 3.0, "kd": 0.1, "filter_frequency": 20.0, "lower": -1.0, "upper": 2.0, "anti_windup": "clamping"},
        [-3, -2, -1, 0, 1, 2, 3],
    ),
}  # fmt: skip
"""Each with the modes it can be in where nothing can hold its input."""


@pytest.mark.parametrize("case", REMEMBERING)
def test_what_ends_a_mode_and_what_follows_is_what_the_law_says(case):
    kind, values, modes = REMEMBERING[case]
    diagram = alone(kind, values)
    equations, law = Equations.of(diagram, ()), diagram.laws().laws[0]
    x, z = moments(diagram, 60)
    slope = np.random.default_rng(8).normal(size=z.shape)
    graph, changes = equations.graph, equations.changes
    changed = 0
    for mode in modes:
        parameters = np.zeros((sum(op is Op.PARAMETER for op, _, _ in graph.nodes), 60))
        signals = [*equations.states, *equations.inputs, *equations.input_slopes, *changes.modes]
        for signal, numbers in zip(signals, [*x, *z, *slope, np.full(60, float(mode))], strict=True):
            parameters[graph.nodes[signal.node][1]] = numbers
        own = dict(changes.switched.pairs)
        after = [own.get(signal, signal) for signal in (*changes.modes, *equations.states)]
        with np.errstate(all="ignore"):
            found = Formulas(graph, [*changes.switched.guards, *after])(parameters)
        for k in range(60):
            at = Moment(
                t=np.zeros((1, 1)), x=[np.full((1, 1), v) for v in x[:, k]], z=[np.full((1, 1), v) for v in z[:, k]],
                slope=[np.full((1, 1), v) for v in slope[:, k]],
            )  # fmt: skip
            at = Moment(t=at.t, x=at.x, z=at.z, slope=at.slope, y=law.element.outputs(at, mode, law.real))
            guards = [float(np.ravel(guard)[0]) for guard in law.element.guards(at, mode, law.real)]
            first = next((number for number, guard in enumerate(guards) if guard > 0), None)
            if first is None:
                assert found[0, k] <= 0
                continue
            assert found[0, k] == pytest.approx(max(guards), rel=1e-12)
            change = law.element.switch(first, at, mode, law.real)
            if law.element.held(change.mode) is not None:
                change = law.element.unheld(at, change.mode, law.real, before=mode)
            assert found[1, k] == change.mode
            states = at.x if change.x is None else change.x
            np.testing.assert_allclose(found[2:, k], [float(np.ravel(v)[0]) for v in states], rtol=1e-12, atol=1e-15)
            changed += 1
    assert changed > 20


def mass(**friction: float) -> Diagram:
    """Return m v' = F - friction, x' = v, of m = 2 kg."""
    blocks = {
        "F": block("input"), "net": block("sum", signs="+-"), "friction": block("friction", **friction),
        "m": block("gain", gain="=push"), "v": block("integrator"), "x": block("integrator"),
    }  # fmt: skip
    wires = ["F -> net.in1", "friction -> net.in2", "net -> m", "m -> v", "v -> friction", "v -> x"]
    return compile_system(document(blocks, wires, {"x": "x", "v": "v", "f": "friction"}, push=0.5))


def marched(
    diagram: Diagram, signals: dict[str, Signal], end: float, steps: int, points: np.ndarray, *varied: str
) -> Marched:
    made = Compiled(Equations.of(diagram, varied), range(len(diagram.outputs)))
    start, once, *_ = made.start(points)
    return Marcher(made, generate=False)(
        start, once, Pieces.of(by_input(diagram.inputs, signals), end, steps, graded=True)
    )


def test_a_mass_breaks_loose_and_comes_to_rest_when_it_should():
    """F = 10 sin(2 t) N against 6 N that stick and 4 N that slide: loose at sin(2 t) = 0.6, then m v = ∫ (F - 4) dt until v = 0; A. in closed form."""
    diagram = mass(coulomb=4.0, static=6.0)
    signals = {"F": make("sine", {"amplitude": 10.0, "frequency": 2.0})}
    loose = 0.5 * np.arcsin(0.6)

    def velocity(t: np.ndarray) -> np.ndarray:
        return 0.5 * (5.0 * (np.cos(2 * loose) - np.cos(2 * t)) - 4.0 * (t - loose))

    found = marched(diagram, signals, 1.4, 300, np.array([[0.5]]), "push")
    slides = found.times >= loose
    expected = np.where(slides, velocity(np.maximum(found.times, loose)), 0.0)
    np.testing.assert_allclose(found.values[1, :, 0], expected, atol=2e-9)
    assert np.all(found.values[1, ~slides, 0] == 0.0)
    held = found.times < 0.99 * loose
    np.testing.assert_allclose(found.values[2, held, 0], 10.0 * np.sin(2 * found.times[held]), atol=1e-12)


def loop(law: dict[str, Any]) -> Diagram:
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("gain", gain="=kp"), "law": block(**law),
        "m": block("transfer_function", numerator=[2.0], denominator=[0.5, 1.0]), "x": block("integrator"),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> c", "c -> law", "law -> m", "m -> x"]
    return compile_system(document(blocks, wires, {"x": "x", "v": "m"}, kp=3.0))


STEP = {"r": make("step", {})}


@pytest.mark.parametrize("kind", ["backlash", "relay", "rate_limiter"])
def test_marches_that_are_cut_where_modes_end_stay_of_fourth_order(kind):
    law = {"backlash": {"width": 0.2}, "relay": {"hysteresis": 0.1}, "rate_limiter": {"rising": 2.0}}[kind]
    ends = [
        marched(loop({"kind": kind, **law}), STEP, 4.0, steps, np.array([[3.0]]), "kp").states[:2, 0]
        for steps in (100, 200, 400, 3200)
    ]
    coarse, middle, fine = (np.abs(end - ends[-1]).max() for end in ends[:-1])
    assert coarse > 9 * middle > 9 * 9 * fine
    assert fine < 1e-6


def test_a_relay_swings_as_its_equations_do():
    """Event by event, by an independent solver."""
    found = marched(loop({"kind": "relay", "hysteresis": 0.1}), STEP, 4.0, 800, np.array([[3.0]]), "kp")
    state, time, sign = np.zeros(2), 0.0, 1.0
    ends = []
    while time < 4.0:

        def leaves(_: float, y: np.ndarray, side: float = sign) -> float:
            return side * 3.0 * (1.0 - y[1]) + 0.05

        leaves.terminal, leaves.direction = True, -1.0  # type: ignore[attr-defined]
        run = solve_ivp(
            lambda _, y, side=sign: [(2.0 * side - y[0]) / 0.5, y[0]], (time, 4.0), state, events=leaves, rtol=1e-12,
            atol=1e-13,
        )  # fmt: skip
        time, state, sign = float(run.t[-1]), run.y[:, -1], -sign
        ends.append(time)
    assert len(ends) > 3
    np.testing.assert_allclose([found.values[0, -1, 0], found.values[1, -1, 0]], state[::-1], atol=1e-8)
    assert found.corners is not None
    cut = found.times[found.corners.before[:, 0]]
    assert all(np.abs(cut - end).min() <= 4.0 / 800 for end in ends[:-1])


@pytest.mark.parametrize("kind", ["backlash", "relay"])
def test_candidates_whose_modes_end_at_other_times_do_not_notice_each_other(kind):
    diagram = loop({"kind": kind, "width" if kind == "backlash" else "hysteresis": 0.1})
    points = np.linspace(0.5, 8.0, 19)[:, None]
    together = marched(diagram, STEP, 3.0, 200, points, "kp")
    for k in (0, 7, 18):
        alone_ = marched(diagram, STEP, 3.0, 200, points[k : k + 1], "kp")
        assert np.array_equal(alone_.values[..., 0], together.values[..., k])
        assert np.array_equal(alone_.modes[:, 0], together.modes[:, k])


def test_a_peak_at_a_corner_between_samples_is_found():
    """The velocity of a mass under a relay is largest where the relay changes its mind."""
    diagram = loop({"kind": "relay", "hysteresis": 0.1})
    asked = [
        MetricRequest(metric=metric, signals=STEP, output="v", duration=4.0) for metric in ("peak", "peak_time", "overshoot")
    ]  # fmt: skip
    found = NonlinearBatch(diagram, ["kp"], asked)(np.array([[3.0]]))
    exact = [measured.value for measured, _ in measure(diagram, asked)]
    assert not found.doubtful[0, 0]
    assert found.values[0, 0] == pytest.approx(exact[0], rel=1e-6)
    assert found.doubtful[0, 1]  # a plateau would begin earlier


def test_what_chatters_is_given_up():
    """A relay without hysteresis that drives its input back through a first-order lag, varied from one with hysteresis."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "relay": block("relay", hysteresis="=h"), "x": block("integrator"),
    }  # fmt: skip
    diagram = compile_system(
        document(blocks, ["r -> e.in1", "x -> e.in2", "e -> relay", "relay -> x"], {"x": "x"}, h=0.1)
    )
    asked = [MetricRequest(metric="peak", signals={"r": make("step", {"amplitude": 0.5})}, output="x", duration=1.0)]
    found = NonlinearBatch(diagram, ["h"], asked)(np.array([[0.1], [0.0], [0.05]]))
    assert found.doubtful[:, 0].tolist() == [False, True, False]
    np.testing.assert_allclose(found.values[[0, 2], 0], [0.55, 0.525], rtol=1e-6)


def test_what_jumps_into_a_delay_is_left_to_the_exact_path():
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "relay": block("relay", hysteresis=0.1), "late": block("delay", time=0.1),
        "x": block("integrator"),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> relay", "relay -> late", "late -> x"]
    with pytest.raises(UnsuitableError, match="relay: it jumps, and that goes into a delay"):
        Equations.of(compile_system(document(blocks, wires, {"x": "x"})), ())


def test_two_laws_that_hold_the_same_are_left_to_the_exact_path():
    blocks = {
        "F": block("input"), "net": block("sum", signs="+--"), "one": block("friction", coulomb=1.0),
        "two": block("friction", coulomb=2.0), "v": block("integrator"),
    }  # fmt: skip
    wires = ["F -> net.in1", "one -> net.in2", "two -> net.in3", "net -> v", "v -> one", "v -> two"]
    with pytest.raises(UnsuitableError, match="another law holds what moves with it"):
        Equations.of(compile_system(document(blocks, wires, {"v": "v"})), ())


def test_what_is_still_under_way_through_a_delay_has_not_settled():
    """The last tenth alone is near to rest; with the echo before it, it is not: the end is then the last sample, as on the exact path."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "late": block("delay", time=0.25),
        "c": block("transfer_function", numerator=["=0.1*k", "=k"], denominator=[0.01, 1.0]),
        "slew": block("rate_limiter", rising=2.0625),
        "x": block("transfer_function", numerator=[1.5], denominator=[1.0, 12.0, 47.0, 60.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "late -> e.in2", "e -> c", "c -> slew", "slew -> x", "x -> late"]
    diagram = compile_system(document(blocks, wires, {"y": "x"}, k=3.0))
    signals = {"r": make("step", {"amplitude": 1.25})}
    asked = [MetricRequest(metric="rise_time", signals=signals, output="y", duration=4.0)]
    found = NonlinearBatch(diagram, ["k"], asked)(np.array([[3.0]]))
    assert not found.doubtful[0, 0]
    assert found.values[0, 0] == pytest.approx(measure(diagram, asked)[0][0].value, rel=1e-5)
