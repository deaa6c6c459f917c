"""Formulas of cases joined into one: the same numbers, with fewer operations; what no case covers is told."""

from __future__ import annotations

import numpy as np
import pytest

from engine.batch.nonlinear.arithmetic import Formulas
from engine.batch.nonlinear.choices import Case, beyond, joined, selected
from engine.batch.nonlinear.signals import SignalGraph
from engine.model.traced import Op, Traced

SIZES = np.random.default_rng(5).normal(size=(3, 50))


def operations(graph: SignalGraph, entry: Traced) -> int:
    """Return how many operations a formula takes."""
    found: set[int] = set()
    pending = [entry.node]
    while pending:
        node = pending.pop()
        op, first, second = graph.nodes[node]
        if op not in {Op.CONSTANT, Op.PARAMETER}:
            pending += [k for k in (first, second) if k >= 0 and k not in found]
            found.add(node)
    return sum(graph.nodes[node][0] is not Op.PAIR for node in found)


@pytest.fixture
def graph():
    return SignalGraph()


def test_what_two_formulas_have_in_common_is_computed_once(graph):
    x, y, d = (graph.signal() for _ in range(3))
    positive, otherwise = np.exp(x * y) * 3.0 + np.tanh(-y), np.exp(x * y) * 3.0 + np.tanh(y)
    found = joined(graph, d, positive, otherwise)
    assert operations(graph, found) == 7  # x y, exp, 3 exp, -y, the choice, tanh, the sum
    a, b, decider = SIZES
    expected = 3.0 * np.exp(a * b) + np.tanh(np.where(decider > 0, -b, b))
    np.testing.assert_array_equal(Formulas(graph, [found])(SIZES)[0], expected)


def test_formulas_that_have_nothing_in_common_are_chosen_as_they_are(graph):
    x, y, d = (graph.signal() for _ in range(3))
    found = joined(graph, d, np.exp(x), y / x)
    assert operations(graph, found) == 3
    a, b, decider = SIZES
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(Formulas(graph, [found])(SIZES)[0], np.where(decider > 0, np.exp(a), b / a))


def test_four_cases_told_apart_by_two_signs_need_one_choice_for_each(graph):
    """|x| y |y|, written with a sign for each direction as a hysteresis is."""
    x, y = (graph.signal() for _ in range(2))
    cases = [
        Case(guards=[-x if s > 0 else x, -y if r > 0 else y], says=(x if s > 0 else -x) * y * (y if r > 0 else -y))
        for s in (1, -1)
        for r in (1, -1)
    ]
    found = selected(graph, cases)
    assert operations(graph, found) == 6  # two signs, two choices, two products
    np.testing.assert_allclose(Formulas(graph, [found])(SIZES[:2])[0], np.abs(SIZES[0]) * SIZES[1] * np.abs(SIZES[1]))
    assert beyond(graph, cases) is None  # one of them is always true


def test_zones_follow_each_other(graph):
    x = graph.signal()
    cases = [
        Case(guards=[x - 1.0, -1.0 - x], says=x), Case(guards=[1.0 - x], says=1.0), Case(guards=[x + 1.0], says=-1.0),
    ]  # fmt: skip
    sizes = np.array([[-3.0, -1.5, -0.5, 0.5, 1.5]])
    np.testing.assert_array_equal(Formulas(graph, [selected(graph, cases)])(sizes)[0], np.clip(sizes[0], -1.0, 1.0))
    gap = Formulas(graph, [beyond(graph, cases[:2])])(sizes)[0]
    assert (gap > 0).tolist() == [True, True, False, False, False]


def test_cases_that_say_the_same_are_no_choice(graph):
    x = graph.signal()
    assert selected(graph, [Case(guards=[x], says=2.0), Case(guards=[-x], says=2.0)]) == 2.0


@pytest.mark.parametrize("seed", range(20))
def test_random_formulas_keep_their_values(graph, seed):
    chance = np.random.default_rng(seed)
    signals = [graph.signal() for _ in range(3)]

    def formula(depth: int) -> Traced:
        if depth == 0:
            return signals[chance.integers(2)]
        a = formula(depth - 1)
        kind = chance.integers(5)
        if kind == 0:
            return -a
        if kind == 1:
            return np.tanh(a)
        b = formula(depth - 1)
        return (a * b, a - b * 0.5, a + 0.3 * b)[kind - 2]

    positive, otherwise = formula(4), formula(4)
    found = joined(graph, signals[2], positive, otherwise)
    yes, no = Formulas(graph, [positive, otherwise])(SIZES)
    np.testing.assert_allclose(Formulas(graph, [found])(SIZES)[0], np.where(SIZES[2] > 0, yes, no), rtol=1e-12)
