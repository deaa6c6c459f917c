"""Formulas and linear equations in many digits, against mpmath."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pytest

from engine.exact.frequency.elimination import Elimination
from engine.model.errors import UnresolvedError
from engine.model.many_digits import CONTEXT, Formulas
from engine.model.traced import Graph, Op
from tests.reference.mpmath_oracle import mp


def test_functions_and_their_slopes() -> None:
    graph = Graph()
    x, y = graph.parameter(0.7), graph.parameter(-3e11)
    entries = [
        x + y, x - y, x * y, x / y, -x, x.sqrt(), x.exp(), x.log(), x.tanh(), (-x).tanh(), x.sin(), x.cos(),
        graph.apply(Op.LARGER, x, y), graph.apply(Op.SMALLER, x, y), graph.choose(x, x * 2.0, y), graph.choose(y, x, y),
    ]  # fmt: skip
    laws: list[Callable[[Any, Any], Any]] = [
        lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / b, lambda a, b: -a,
        lambda a, b: mp.sqrt(a), lambda a, b: mp.exp(a), lambda a, b: mp.log(a), lambda a, b: mp.tanh(a),
        lambda a, b: -mp.tanh(a), lambda a, b: mp.sin(a), lambda a, b: mp.cos(a),
        lambda a, b: a, lambda a, b: b, lambda a, b: 2 * a, lambda a, b: b,
    ]  # fmt: skip
    formulas = Formulas(graph, [0.7, -3e11], {0: 0, 1: 1})
    with mp.workdps(120):
        at = [mp.mpf(0.7), mp.mpf(-3e11)]
        for entry, law in zip(entries, laws, strict=True):
            value, slopes = formulas.of(entry)
            digits = 1e-15 if law(*at) in (mp.sin(at[0]), mp.cos(at[0])) else mp.mpf("1e-100")
            assert abs(mp.mpf(str(value)) - law(*at)) <= digits * abs(law(*at))
            for lane in (0, 1):
                expected = mp.diff(law, at, (1 - lane, lane))
                assert float(slopes.get(lane, 0)) == pytest.approx(float(expected), rel=1e-14, abs=1e-30)


def test_what_is_not_finite_is_told() -> None:
    graph = Graph()
    x = graph.parameter(0.0)
    graph.apply(Op.DIV, 1.0, x)
    with pytest.raises(UnresolvedError, match="must be finite"):
        Formulas(graph, [0.0], {})


def test_equations_and_the_weights_of_their_right_hand_sides() -> None:
    rng = np.random.default_rng(3)
    size = 9
    matrix = rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-12, 12, (size, size))
    matrix[rng.uniform(size=matrix.shape) < 0.5] = 0.0
    matrix += np.diag(10.0 ** rng.uniform(-12, 12, size))
    right = rng.normal(size=size)
    with localcontext(CONTEXT), mp.workdps(100):
        rows = [{j: Decimal(float(entry)) for j, entry in enumerate(row)} for row in matrix]
        elimination = Elimination(rows)
        found = elimination.solve([Decimal(float(entry)) for entry in right])
        expected = mp.lu_solve(mp.matrix(matrix.tolist()), mp.matrix(right.tolist()))
        for unknown in range(size):
            assert abs(mp.mpf(str(found[unknown])) / expected[unknown] - 1) <= mp.mpf("1e-60")
            weighed = sum(
                weight * Decimal(float(entry))
                for weight, entry in zip(elimination.weights(unknown), right, strict=True)
            )
            assert abs(weighed / found[unknown] - 1) < Decimal("1e-300")


def test_singular_equations_are_told() -> None:
    half, third = Decimal("0.5"), Decimal(1) / Decimal(3)
    with localcontext(CONTEXT), pytest.raises(UnresolvedError, match="singular"):
        Elimination([{0: half, 1: third}, {0: 2 * half, 1: 2 * third}])
