"""Candidates of a batch do not know of each other: neither of their number, nor of the threads, nor of a neighbour that fails."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine.analysis.study import MetricRequest, measure
from engine.batch.kernels.batch import Batch, Results, UnsuitableError
from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system
from engine.signals import make
from tests.reference.systems import block, pneumatic_loop, system, transfer_function

STEP = {"r": make("step", {})}
GAINS = ("kp", "ki", "kd")
UNSTABLE = (5e-2, 2.0, 0.0)
REQUESTS = [
    *(
        MetricRequest(metric=metric, signals={"reference": make("step", {})}, output="position")
        for metric in ("rise_time", "settling_time", "overshoot", "peak_time", "max_velocity", "steady_state_error")
    ),
    *(MetricRequest(metric=metric, open_at="error") for metric in ("gain_margin", "phase_margin", "sensitivity_peak")),
    MetricRequest(metric="bandwidth", source="reference", target="position"),
]


@pytest.fixture(scope="module")
def batch() -> Batch:
    return Batch(pneumatic_loop(), GAINS, REQUESTS)


def candidates(count: int, seed: int = 0) -> np.ndarray:
    return np.array([1e-2, 2e-3, 5e-4]) * np.random.default_rng(seed).uniform(0.5, 2.0, (count, 3))


def same(found: Results, expected: Results, rtol: float = 0.0) -> None:
    assert_array_equal(found.valid, expected.valid)
    assert_array_equal(found.doubtful, expected.doubtful)
    assert_allclose(found.growth, expected.growth, rtol=rtol)
    assert_allclose(found.values, expected.values, rtol=rtol, atol=rtol)


def rows(results: Results, chosen: list[int]) -> Results:
    return Results(
        values=results.values[chosen], doubtful=results.doubtful[chosen], growth=results.growth[chosen],
        valid=results.valid[chosen],
    )  # fmt: skip


@pytest.mark.parametrize("count", [1, 7, 8, 9, 17])
def test_a_candidate_is_the_same_alone_and_in_any_company(batch: Batch, count: int) -> None:
    points = candidates(count)
    together = batch(points)
    assert together.values.shape == (count, len(REQUESTS))
    for k in range(count):
        same(rows(together, [k]), batch(points[k : k + 1]), rtol=1e-12)


@pytest.mark.parametrize("place", [0, 3, 7])
def test_an_unstable_neighbour_changes_nothing(batch: Batch, place: int) -> None:
    points = candidates(8, seed=4)
    calm = batch(points)
    assert (calm.growth < 0).all()
    points[place] = UNSTABLE
    mixed = batch(points)
    assert mixed.growth[place] > 0
    assert mixed.valid[place]
    assert np.isnan(mixed.values[place]).all()
    others = [k for k in range(8) if k != place]
    same(rows(mixed, others), rows(calm, others), rtol=1e-12)


def test_stable_and_unstable_in_turn(batch: Batch) -> None:
    points = np.repeat(candidates(12, seed=5), 2, axis=0)
    points[1::2] = UNSTABLE
    mixed = batch(points)
    assert (mixed.growth[1::2] > 0).all()
    same(rows(mixed, list(range(0, 24, 2))), batch(points[::2]), rtol=1e-12)


def test_more_than_a_block_on_one_thread_and_on_two(batch: Batch) -> None:
    points = candidates(2049)
    one, two = batch(points, threads=1), batch(points, threads=2)
    same(one, two)
    assert (one.growth < 0).all()
    few = [0, 1023, 2047, 2048]
    same(rows(one, few), batch(points[few]), rtol=1e-12)


def test_twice_the_same_call_is_twice_the_same_answer(batch: Batch) -> None:
    points = candidates(9, seed=6)
    same(batch(points), batch(points))


def test_no_candidates_no_results(batch: Batch) -> None:
    assert batch(np.empty((0, 3))).values.shape == (0, len(REQUESTS))


def test_a_bound_broken_by_one_candidate_is_a_verdict_for_it_alone() -> None:
    diagram = pneumatic_loop()
    names = ("kp", "motor.mass", "motor.pressure")
    requests = REQUESTS[:3]
    nominal = np.array([diagram.parameters[name].value for name in names])
    points = np.tile(nominal, (9, 1))
    points[1, 1], points[3, 2], points[5, 1], points[8, 0] = -1.0, 0.0, np.nan, np.inf
    found = Batch(diagram, names, requests)(points)
    good = [0, 2, 4, 6, 7]
    assert_array_equal(np.flatnonzero(found.valid), good)
    assert np.isnan(np.delete(found.values, good, axis=0)).all()
    exact = [measured.value for measured, _ in measure(diagram, requests)]
    for k in good:
        assert found.values[k] == pytest.approx(exact, rel=1e-7)


def algebraic() -> Diagram:
    """y = k e, e = r - y, then a lag: the loop through k has no solution at k = -1."""
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "k": block("gain", gain="=k"),
            "lag": block("transfer_function", numerator=[1.0], denominator=[0.5, 1.0]),
        },
        ["r -> error.in1", "k -> error.in2", "error -> k", "k -> lag"],
        {"y": "lag"},
        {"k": 1.0},
    )


def test_an_algebraic_loop_without_a_solution_is_no_number_and_no_neighbours_trouble() -> None:
    requests = [MetricRequest(metric=metric, signals=STEP, output="y") for metric in ("rise_time", "peak")]
    found = Batch(algebraic(), ("k",), requests)(np.array([1.0, -1.0, 3.0, -1.0 + 1e-9, -3.0])[:, None])
    for k in (1, 3):  # the first has no solution, the second none that can be vouched for
        assert not found.valid[k] or found.doubtful[k].all()
        assert np.isnan(found.growth[k]) or not found.valid[k]
    # k/(1 + k) of a lag of 0.5 s: rises in ln 9 time constants, to k/(1 + k)
    for k, gain in ((0, 1.0), (2, 3.0), (4, -3.0)):
        assert found.values[k] == pytest.approx([0.5 * np.log(9.0), abs(gain / (1 + gain))], rel=1e-12)


def test_coefficients_that_overflow_harm_nobody() -> None:
    diagram = transfer_function(["=k"], ["=a*a", "=2*a", 1.0], k=1.0, a=0.1)
    requests = [MetricRequest(metric="peak", signals={"u": make("step", {})}, output="y")]
    points = np.array([[1.0, 0.1], [1.0, 1e-200], [1e200, 0.1], [2.0, 0.3], [1.0, 1e200], [1.0, 0.0], [-3.0, 7.0]])
    found = Batch(diagram, ("k", "a"), requests)(points)
    # double pole: no overshoot, the peak is the final value
    for k, gain in ((0, 1.0), (3, 2.0), (6, 3.0)):
        assert found.valid[k]
        assert found.values[k, 0] == pytest.approx(gain, rel=1e-9)
    assert not found.valid[[1, 5]].any()


def test_candidates_far_from_where_the_diagram_was_traced() -> None:
    # ω² / (s² + 2 ζ ω s + ω²): overshoot exp(-π ζ / √(1 - ζ²)), at π / (ω √(1 - ζ²)), whatever the scale of time
    diagram = transfer_function(["=w**2"], [1.0, "=2*z*w", "=w**2"], w=1.0, z=0.5)
    step = {"u": make("step", {})}
    requests = [MetricRequest(metric=metric, signals=step, output="y") for metric in ("overshoot", "peak_time")]
    w, z = (grid.ravel() for grid in np.meshgrid(10.0 ** np.arange(-4.0, 5.0), [0.05, 0.2, 0.6, 0.8]))
    found = Batch(diagram, ("w", "z"), requests)(np.stack([w, z], axis=1))
    root = np.sqrt(1 - z**2)
    sure = ~found.doubtful
    assert sure.mean() > 0.9
    over, when = np.exp(-np.pi * z / root), np.pi / (w * root)
    assert found.values[sure[:, 0], 0] == pytest.approx(over[sure[:, 0]], abs=1e-7)
    assert found.values[sure[:, 1], 1] == pytest.approx(when[sure[:, 1]], rel=1e-6)


def test_what_is_no_metric_of_the_kernels_is_left_doubtful() -> None:
    requests = [*REQUESTS[:1], MetricRequest(metric="damping_ratio")]
    batch = Batch(pneumatic_loop(), GAINS, requests)
    assert batch.measured == (True, False)
    found = batch(candidates(3))
    assert found.doubtful.tolist() == [[False, True]] * 3
    assert np.isnan(found.values[:, 1]).all()


def static() -> Diagram:
    """A path without dynamics."""
    return system({"r": block("input"), "k": block("gain", gain="=k")}, ["r -> k"], {"y": "k"}, {"k": 2.0})


def delayed() -> Diagram:
    return compile_system(
        System(
            parameters={"k": Parameter(value=0.5)},
            blocks={
                "r": Block(kind="input"),
                "error": Block(kind="sum", values={"signs": "+-"}),
                "k": Block(kind="gain", values={"gain": "=k"}),
                "i": Block(kind="integrator"),
                "dead": Block(kind="delay", values={"time": 0.5}),
            },
            connections=tuple(
                Connection(source=a, target=b)
                for a, b in (("r", "error.in1"), ("dead", "error.in2"), ("error", "k"), ("k", "i"), ("i", "dead"))
            ),
            outputs={"y": "i"},
        )
    )


@pytest.mark.parametrize("diagram", [static(), delayed()], ids=["no dynamics", "delays"])
def test_what_the_kernels_do_not_cover_is_refused_beforehand(diagram: Diagram) -> None:
    with pytest.raises(UnsuitableError):
        Batch(diagram, ("k",), [MetricRequest(metric="peak", signals=STEP, output="y")])


def test_gain_margins_of_about_a_thousand_are_there_or_doubtful() -> None:
    """L = k/(s + 1)³ has the margin 8/k; crossings below 1e-3 belong to the exact path, wherever the table's cell begins."""
    lag = block("transfer_function", numerator=["=k"], denominator=[1.0, 3.0, 3.0, 1.0])
    made = system(
        {"r": block("input"), "e": block("sum", signs="+-"), "g": lag},
        ["r -> e.in1", "g -> e.in2", "e -> g"],
        {"y": "g"},
        {"k": 1.0},
    )
    margins = np.geomspace(300.0, 3000.0, 400)
    found = Batch(made, ["k"], [MetricRequest(metric="gain_margin", open_at="e")])(8.0 / margins[:, None])
    values, doubtful = found.values[:, 0], found.doubtful[:, 0]
    assert_allclose(values[~doubtful], margins[~doubtful], rtol=1e-9)
    assert np.isnan(values[doubtful]).all()
    assert not doubtful[margins < 990.0].any()
