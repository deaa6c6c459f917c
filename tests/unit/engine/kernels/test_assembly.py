"""The sparse formulas of a diagram are its state space, at values it was not traced at, too."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from engine.batch.kernels.assembly import Assembly, solve
from engine.batch.kernels.compiled import LANES
from engine.batch.kernels.tape import Registers, run
from engine.diagram.diagram import Diagram
from tests.reference.systems import block, pneumatic_loop, system


def algebraic() -> Diagram:
    """Two algebraic loops, one inside the other, round a lag with a direct term: the loop gains are parameters."""
    return system(
        {
            "r": block("input"),
            "outer": block("sum", signs="+-"),
            "inner": block("sum", signs="+-"),
            "k": block("gain", gain="=k"),
            "g": block("gain", gain="=g/(1+a**2)"),
            "plant": block("transfer_function", numerator=["=b", 1.0], denominator=["=a", 1.0]),
        },
        [
            "r -> outer.in1", "plant -> outer.in2", "outer -> inner.in1", "g -> inner.in2", "inner -> k", "k -> g",
            "k -> plant",
        ],
        {"y": "plant", "e": "outer", "u": "k"},
        {"k": 2.0, "g": 0.5, "a": 0.3, "b": 0.1},
    )  # fmt: skip


def scattered(diagram: Diagram, points: Mapping[str, np.ndarray], open_at: str | None = None) -> list[np.ndarray]:
    """Return A, B, C, D of LANES candidates as the tape of the assembly gives them."""
    traced, wiring = diagram.trace(tuple(points)), diagram.wiring(open_at)
    made = Assembly.of(traced, wiring)
    rows = [*made.flow, *made.reads]
    registers = Registers(traced.graph, [value for row in rows for value in row.values()], len(points))
    table = np.full((registers.count, LANES), np.nan)
    table[: len(points)] = list(points.values())
    run(registers.tape, table)
    whole = np.zeros((LANES, len(rows), made.states + made.externals))
    for i, row in enumerate(rows):
        for j, value in row.items():
            whole[:, i, j] = table[registers.of(value)]
    n = made.states
    return [whole[:, :n, :n], whole[:, :n, n:], whole[:, n:, :n], whole[:, n:, n:]]


def responses(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return C (s - A)^-1 B + D at points in the right half plane."""
    return np.array([c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d for s in (0.1 + 0.2j, 3.0, 40.0 + 70.0j)])


@pytest.mark.parametrize(
    ("diagram", "cut"),
    [(pneumatic_loop(), None), (pneumatic_loop(), "error"), (algebraic(), None), (algebraic(), "plant")],
    ids=["loop", "loop cut", "algebraic", "algebraic cut"],
)
def test_the_formulas_are_the_state_space(diagram: Diagram, cut: str | None) -> None:
    rng = np.random.default_rng(5)
    points = {
        name: info.value * np.exp(rng.uniform(-2, 2, LANES))
        for name, info in diagram.parameters.items()
        if "." not in name
    }
    assert len(points) >= 3
    found = scattered(diagram, points, cut)
    for lane in range(LANES):
        exact = diagram.realize({name: float(values[lane]) for name, values in points.items()}, open_at=cut)
        a, b, c, d = (matrix[lane] for matrix in found)
        # An element may scale its states by powers of two that depend on its values: compared is what does not change by it.
        np.testing.assert_allclose(a * a.T, exact.a * exact.a.T, rtol=1e-12)
        np.testing.assert_allclose(d, exact.d11, rtol=1e-12)
        expected = responses(exact.a, exact.b1, exact.c1, exact.d11)
        np.testing.assert_allclose(responses(a, b, c, d), expected, rtol=1e-9, atol=1e-14 * np.abs(expected).max())


def test_elimination_solves_sparse_equations() -> None:
    rng = np.random.default_rng(0)
    dense = np.where(rng.uniform(size=(7, 7)) < 0.4, rng.standard_normal((7, 7)), 0.0) + 2.0 * np.eye(7)
    right = rng.standard_normal((7, 2))
    pivots: list[float] = []
    rows = [{j: float(v) for j, v in enumerate(row) if v} for row in dense]
    found = solve(rows, [dict(enumerate(row.tolist())) for row in right], lambda value: -abs(value), pivots.append)
    solution = np.array([[row.get(0, 0.0), row.get(1, 0.0)] for row in found])
    np.testing.assert_allclose(solution, np.linalg.solve(dense, right), rtol=1e-11)
    assert abs(np.prod(pivots)) == pytest.approx(abs(np.linalg.det(dense)), rel=1e-11)


def test_equations_without_a_pivot_are_refused() -> None:
    with pytest.raises(ZeroDivisionError):
        solve([{0: 1.0}, {0: 2.0}], [{0: 1.0}, {0: 1.0}], abs, lambda _: None)
