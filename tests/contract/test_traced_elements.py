"""The formula that an element leaves behind when it is traced is the element itself, at other values, too."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import engine.elements
from engine.elements import Element
from engine.elements._nonlinear import NonlinearElement
from engine.model.parameters import Param
from engine.model.traced import Graph, Op, Traced

LINEAR = {
    kind: element for kind, element in engine.elements.catalogue().items() if not issubclass(element, NonlinearElement)
}
ARRAYS = ("a", "b", "c", "d", "delays", "d12", "d21", "initial")
FUNCTIONS = {
    Op.SQRT: math.sqrt, Op.EXP: math.exp, Op.LOG: math.log, Op.SIN: math.sin, Op.COS: math.cos,
    Op.NEG: lambda a: -a, Op.IS_ZERO: lambda a: float(a == 0), Op.ADD: lambda a, b: a + b, Op.SUB: lambda a, b: a - b,
    Op.MUL: lambda a, b: a * b, Op.DIV: lambda a, b: a / b,
}  # fmt: skip


def mapped(value: Any, param: Param, change: Callable[[float], Any]) -> Any:
    """Apply ``change`` to every number of a parameter that may vary."""
    if param.shape in {"text", "integer", "names"} or value is None:
        return value
    if isinstance(value, list | tuple):
        return [mapped(item, param, change) for item in value]
    return change(float(value))


def values(element: type[Element], change: Callable[[float], Any]) -> dict[str, Any]:
    """Return the example with every number changed."""
    example = {param.name: param.default for param in element.parameters} | dict(element.example)
    return {param.name: mapped(example[param.name], param, change) for param in element.parameters}


def evaluated(graph: Graph, parameters: list[float]) -> list[float]:
    """Return the values of all nodes at other parameters."""
    found: list[float] = []
    for (op, first, second), known in zip(graph.nodes, graph.values, strict=True):
        if op is Op.CONSTANT:
            found.append(known)
        elif op is Op.PARAMETER:
            found.append(parameters[first])
        else:
            found.append(FUNCTIONS[op](*(found[operand] for operand in (first, second) if operand >= 0)))
    return found


@pytest.mark.parametrize("element", LINEAR.values(), ids=LINEAR)
def test_a_traced_element_is_the_element_at_all_values(element: type[Element]):
    graph, elsewhere = Graph(), []

    def trace(number: float) -> Traced:
        elsewhere.append(1.1 * number)
        return graph.parameter(number)

    traced = element.realize(values(element, trace))
    nodes = evaluated(graph, elsewhere)
    plain = element.realize(values(element, lambda number: 1.1 * number))
    for name in ARRAYS:
        formula, expected = getattr(traced, name), getattr(plain, name)
        if expected is None:
            assert formula is None
            continue
        found = [nodes[entry.node] if isinstance(entry, Traced) else float(entry) for entry in formula.ravel()]
        np.testing.assert_allclose(np.reshape(found, formula.shape), expected, rtol=1e-12, err_msg=name)
