"""Interpreted tapes, generated code and the formulas themselves give the same; slopes are derivatives."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from bench import nonlinear_loop
from engine.batch.kernels.compiled import LANES, compiled
from engine.batch.kernels.functions import exp, tanh
from engine.batch.kernels.marching import interpret
from engine.batch.kernels.vector import load, store
from engine.batch.nonlinear.arithmetic import Formulas
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.march import Marcher, Pieces, by_input
from engine.batch.nonlinear.program import Compiled
from engine.batch.nonlinear.signals import SignalGraph, choose, largest, least
from engine.batch.nonlinear.slopes import slopes
from engine.diagram.diagram import compile_system
from engine.signals import make
from tests.unit.engine.diagrams import block, document

STEP = {"reference": make("step", {"amplitude": nonlinear_loop.STEP})}


@pytest.fixture(scope="module")
def loop() -> tuple[Equations, Compiled]:
    equations = Equations.of(nonlinear_loop.diagram(), list(nonlinear_loop.PARAMETERS))
    return equations, Compiled(equations, [0, 1])


def test_both_tapes_are_the_formulas(loop):
    equations, made = loop
    program = made.program
    points = nonlinear_loop.sample(LANES, seed=3)
    chance = np.random.default_rng(1)
    size = np.array([0.02, 0.02, 0.2, 0.2, 0.1, 0.02, 0.3, 1e4, 0.01, 0.005, 0.1])[: program.states, None]
    x, u = size * chance.normal(size=(program.states, LANES)), chance.normal(size=(program.inputs, LANES))
    _, once, *_ = made.start(points)
    signals = [*equations.states, *equations.inputs, *equations.input_slopes]
    parameters = np.zeros((sum(node[0].name == "PARAMETER" for node in equations.graph.nodes), LANES))
    parameters[: points.shape[1]] = points.T
    for signal, values in zip(signals, [*x, *u], strict=True):
        parameters[equations.graph.nodes[signal.node][1]] = values
    expected = Formulas(
        equations.graph,
        [
            *equations.rates,
            equations.outputs[0],
            equations.output_slopes[0],
            equations.outputs[1],
            equations.output_slopes[1],
        ],
    )(parameters)
    for tape, count in ((program.whole, len(expected)), (program.rates_only, program.states)):
        registers = np.full((program.registers, 1, LANES), np.nan)
        registers[: program.states, 0], registers[program.states : program.first_once, 0] = x, u
        registers[program.first_once : program.first_once + program.once, 0] = once
        interpret(tape, registers)
        places = [*program.rates, *program.read[:-1]][:count]
        np.testing.assert_allclose(registers[places, 0], expected[:count], rtol=1e-12, atol=1e-12)


def test_generated_code_repeats_the_interpreted_tapes_bit_for_bit(loop):
    _, made = loop
    start, once, *_ = made.start(nonlinear_loop.sample(20, seed=4))
    pieces = Pieces.of(by_input(("reference",), STEP), 0.1, 500, 1)
    interpreted = Marcher(made, generate=False)(start, once, pieces)
    generated = Marcher(made).prepared()(start, once, pieces)
    assert np.array_equal(interpreted.values, generated.values)
    assert np.array_equal(interpreted.slopes, generated.slopes)
    assert interpreted.covered.all()
    assert generated.covered.all()


@pytest.fixture(scope="module")
def late() -> Compiled:
    """A limited PI loop with two delays, one of them past a law straight into the other."""
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("pi", kp="=kp", ki=2.0), "d": block("delay", time=0.03),
        "s": block("saturation", lower=-2.0, upper=2.0), "f": block("delay", time=0.05),
        "x": block("transfer_function", numerator=[3.0], denominator=[0.2, 1.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "x -> e.in2", "e -> c", "c -> d", "d -> s", "s -> f", "f -> x"]
    return Compiled(Equations.of(compile_system(document(blocks, wires, {"y": "x", "u": "s"}, kp=1.0)), ["kp"]), [0, 1])


def test_delayed_signals_are_the_same_in_tapes_and_code_and_beside_any_neighbours(late):
    start, once, *_ = late.start(np.linspace(0.5, 3.0, 20)[:, None])
    signals = by_input(("r",), {"r": make("step", {"start": 0.1})})
    pieces = Pieces.of(signals, 2.0, 500, 1, delays=(0.03, 0.05), graded=True)
    assert {0.13, 0.15, 0.18} <= set(np.round(pieces.edges, 12))
    interpreted = Marcher(late, generate=False)(start, once, pieces)
    generated = Marcher(late).prepared()(start, once, pieces)
    alone = Marcher(late).prepared()(start[:, 7:8], once[:, 7:8], pieces)
    for name in ("values", "slopes", "states", "heard"):
        assert np.array_equal(getattr(interpreted, name), getattr(generated, name)), name
        assert np.array_equal(getattr(alone, name)[..., 0], getattr(generated, name)[..., 7]), name
    first, second = generated.values[0], generated.values[1]
    assert np.all(first[generated.times < 0.18] == 0.0)
    assert np.all(second[generated.times < 0.13] == 0.0)
    # what comes out is what went in: 50 ms before the end out of the second delay, that is the law's output then
    (place,) = np.flatnonzero(np.isclose(generated.times, 2.0 - 0.05, atol=1e-3))[:1]
    np.testing.assert_allclose(generated.heard[1], second[place], atol=2e-2)


def test_a_candidate_does_not_depend_on_its_neighbours(loop):
    _, made = loop
    points = nonlinear_loop.sample(11, seed=6)
    points[5] *= [1e3, 1, 1, 1, 1, 1, 1, 1]  # one that overflows
    start, once, *_ = made.start(points)
    march, pieces = Marcher(made, generate=False), Pieces.of(by_input(("reference",), STEP), 0.1, 800)
    together, alone = march(start, once, pieces), march(start[:, 7:8], once[:, 7:8], pieces)
    assert np.array_equal(together.values[:, :, 7], alone.values[:, :, 0])


def test_samples_are_those_of_all_steps_thinned_out(loop):
    _, made = loop
    start, once, *_ = made.start(nonlinear_loop.sample(8, seed=7))
    signals = by_input(("reference",), {"reference": make("step", {"amplitude": 0.02, "start": 0.03})})
    march = Marcher(made, generate=False)
    thin, full = Pieces.of(signals, 0.1, 2000, 4), Pieces.of(signals, 0.1, 32000)
    assert (thin.stride, full.stride) == (4, 1)
    assert np.array_equal(thin.edges, [0.0, 0.03, 0.1])
    few, all_ = march(start, once, thin), march(start, once, full)
    assert few.times[-1] == all_.times[-1] == 0.1
    np.testing.assert_allclose(few.values[0, -1], all_.values[0, -1], rtol=1e-12)
    assert np.all(few.values[0, few.times < 0.03] == 0.0)


def test_graded_steps_are_small_behind_every_breakpoint():
    signals = by_input(("r",), {"r": make("step", {"amplitude": 1.0, "start": 0.25})})
    pieces = Pieces.of(signals, 1.0, 4, 1, graded=True)
    assert 0.25 in pieces.edges
    assert pieces.edges[-1] == 1.0
    widths = np.diff(pieces.edges) / (pieces.samples * pieces.stride)
    for start in (0.0, 0.25):
        first = int(np.searchsorted(pieces.edges, start))
        assert widths[first] == pytest.approx(0.25 / 4**7 / 8, rel=1e-6)
        assert np.all(np.diff(widths[first : first + 8]) > 0)
    assert widths.max() == pytest.approx(1 / 8)


def test_slopes_are_derivatives():
    graph = SignalGraph()
    x, y, dx, dy = (graph.signal() for _ in range(4))
    bend = choose(x - 0.3, x * x * y, 1.0 / y)
    formulas = [
        x * y + x / y - 2.0 * y, np.exp(-x) * np.tanh(y), np.sqrt(x) + np.log(y), np.sin(x) * np.cos(y),
        largest([x, y, 0.5]), least([x, y, 0.5]), bend, x**0.25, -(y**3),
    ]  # fmt: skip
    found = slopes(graph, formulas, {x.node: dx, y.node: dy})
    rate = (0.7, -1.3)
    for at in ((0.2, 0.8), (0.9, 0.4)):
        values = Formulas(graph, found)(np.array([*at, *rate]))
        step = 1e-6
        ahead, behind = (
            Formulas(graph, formulas)(np.array([at[0] + s * rate[0], at[1] + s * rate[1], 0.0, 0.0]))
            for s in (step, -step)
        )
        np.testing.assert_allclose(values, (ahead - behind) / (2 * step), rtol=1e-8)


@compiled
def _exp(values: np.ndarray, result: np.ndarray) -> None:
    for k in range(values.shape[0]):
        store(result, exp(load(values, k)), k)


@compiled
def _tanh(values: np.ndarray, result: np.ndarray) -> None:
    for k in range(values.shape[0]):
        store(result, tanh(load(values, k)), k)


@pytest.mark.parametrize(("kernel", "exact", "largest_size"), [(_exp, mpmath.exp, 700.0), (_tanh, mpmath.tanh, 30.0)])
def test_functions_of_vectors_are_exact_to_rounding(kernel, exact, largest_size):
    chance = np.random.default_rng(2)
    values = np.concatenate([
        chance.uniform(-largest_size, largest_size, 500), chance.uniform(-1, 1, 500),
        10.0 ** chance.uniform(-200, 0, 256) * chance.choice([-1, 1], 256), [0.0] * 8, [math.nan] * 8,
    ]).reshape(-1, LANES)  # fmt: skip
    result = np.empty_like(values)
    kernel(values, result)
    expected = np.array([float(exact(value)) for value in values.ravel()[:-8]]).reshape(-1, LANES)
    np.testing.assert_allclose(result[:-1], expected, rtol=1e-15)
    assert np.isnan(result[-1]).all()
