"""A tape computes what the traced arithmetic says, for every lane, and its tangents are the derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from engine.batch.kernels.compiled import LANES
from engine.batch.kernels.tangents import run_tangents
from engine.batch.kernels.tape import Registers, run
from engine.model.traced import Graph, Op

# What each operation is, of two numbers; analytic in both, so that a complex step differentiates it.
OPERATIONS: dict[Op, Any] = {
    Op.ADD: lambda x, y: x + y, Op.SUB: lambda x, y: x - y, Op.MUL: lambda x, y: x * y, Op.DIV: lambda x, y: x / y,
    Op.NEG: lambda x, _: -x, Op.SQRT: lambda x, _: np.sqrt(x), Op.EXP: lambda x, _: np.exp(x),
    Op.LOG: lambda x, _: np.log(x), Op.SIN: lambda x, _: np.sin(x), Op.COS: lambda x, _: np.cos(x),
}  # fmt: skip
TRACED_AT = (1.3, 0.7)
POINTS = np.random.default_rng(1).uniform(0.2, 4.0, (LANES, 2))


def formula(apply: Any, x: Any, y: Any) -> Any:
    """Return all operations in one formula, with a shared part, constants and powers; ``apply`` is a function of one argument."""
    shared = x * y + 2.5
    return (
        apply(Op.SQRT, shared) / (x + y)
        + apply(Op.EXP, -(x - y)) * apply(Op.LOG, shared)
        - apply(Op.SIN, x) * apply(Op.COS, shared)
        + x**3
        - 1.0 / y**2
        + shared
    )


def numeric(op: Op, value: Any) -> Any:
    return OPERATIONS[op](value, None)


def table(registers: Registers, points: np.ndarray) -> np.ndarray:
    """Return the registers of candidates (LANES, parameters) once the tape has run."""
    made = np.full((registers.count, LANES), np.nan)
    made[: points.shape[1]] = points.T
    run(registers.tape, made)
    return made


@pytest.mark.parametrize("op", OPERATIONS, ids=lambda op: op.name)
def test_every_operation_and_its_tangent(op: Op) -> None:
    graph = Graph()
    x, y = (graph.parameter(value) for value in TRACED_AT)
    operands = (x, y) if op in {Op.ADD, Op.SUB, Op.MUL, Op.DIV} else (x,)
    result = graph.apply(op, *operands)
    registers = Registers(graph, [result], 2)
    found = table(registers, POINTS)[registers.of(result)]
    assert found == pytest.approx(OPERATIONS[op](POINTS[:, 0], POINTS[:, 1]), rel=1e-14)
    values, tangents = np.full((2, registers.count, LANES), np.nan)
    values[:2], tangents[:2] = POINTS[0][:, None], 0.0
    tangents[0, 0] = tangents[1, 1] = 1.0
    run_tangents(registers.tape, values, tangents)
    for direction in range(2):
        moved = POINTS[0] + 1e-30j * np.eye(2)[direction]
        derivative = np.imag(OPERATIONS[op](moved[0], moved[1])) / 1e-30
        assert tangents[registers.of(result), direction] == pytest.approx(derivative, rel=1e-14)


def test_a_formula_at_values_it_was_not_traced_at() -> None:
    graph = Graph()
    x, y = (graph.parameter(value) for value in TRACED_AT)
    result = formula(lambda op, value: value.apply(op), x, y)
    registers = Registers(graph, [result], 2)
    found = table(registers, POINTS)[registers.of(result)]
    assert found == pytest.approx(formula(numeric, POINTS[:, 0], POINTS[:, 1]), rel=1e-13)


def test_the_tangents_of_a_formula_are_its_complex_steps() -> None:
    graph = Graph()
    x, y = (graph.parameter(value) for value in TRACED_AT)
    result = formula(lambda op, value: value.apply(op), x, y)
    registers = Registers(graph, [result], 2)
    directions = np.zeros((2, LANES))
    directions[0, 0] = directions[1, 1] = directions[0, 2] = 1.0
    directions[1, 2] = -3.0
    for point in POINTS[:3]:
        values, tangents = np.full((2, registers.count, LANES), np.nan)
        values[:2], tangents[:2] = point[:, None], directions
        run_tangents(registers.tape, values, tangents)
        assert values[registers.of(result)] == pytest.approx(formula(numeric, *point), rel=1e-13)
        for lane in range(3):
            moved = point + 1e-30j * directions[:, lane]
            derivative = np.imag(formula(numeric, *moved)) / 1e-30
            assert tangents[registers.of(result), lane] == pytest.approx(derivative, rel=1e-12)


def test_whether_a_number_is_zero_is_decided_for_every_lane() -> None:
    graph = Graph()
    x = graph.parameter(1.0)
    registers = Registers(graph, [result := x.apply(Op.IS_ZERO)], 1)
    points = np.array([0.0, 1.0, -0.0, 1e-300, -2.0, 0.0, 5.0, np.inf])[:, None]
    assert table(registers, points)[registers.of(result)].tolist() == [1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0]


def test_what_does_not_exist_stays_in_its_lane() -> None:
    graph = Graph()
    x = graph.parameter(1.0)
    wanted = [x.apply(Op.SQRT), x.apply(Op.LOG), 1.0 / x]
    registers = Registers(graph, wanted, 1)
    points = np.array([-1.0, 4.0, 0.0, 4.0, np.nan, 4.0, np.inf, 4.0])[:, None]
    with np.errstate(all="ignore"):
        expected = np.array([np.sqrt(points[:, 0]), np.log(points[:, 0]), 1.0 / points[:, 0]])
    made = table(registers, points)
    found = np.array([made[registers.of(number)] for number in wanted])
    np.testing.assert_allclose(found, expected, rtol=1e-15)


def test_numbers_asked_for_twice_and_constants_have_a_register() -> None:
    graph = Graph()
    x = graph.parameter(3.0)
    registers = Registers(graph, [x, 2.5, x * x, x * x], 1)
    made = table(registers, np.arange(1.0, 9.0)[:, None])
    assert made[registers.of(x)] == pytest.approx(np.arange(1.0, 9.0))
    assert made[registers.of(2.5)] == pytest.approx(np.full(LANES, 2.5))
    assert made[registers.of(x * x)] == pytest.approx(np.arange(1.0, 9.0) ** 2)
    assert len(registers.tape.operations) == 1
