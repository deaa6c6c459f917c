"""What the operations of a tape mean, in numpy: for what is computed once for a candidate, and as the reference of the kernels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.model.traced import Graph, Op, nodes_of

Real = npt.NDArray[np.float64]


class Code(IntEnum):
    """Operations of a tape: those of the graph, and some that do two at once."""

    ADD = Op.ADD
    SUB = Op.SUB
    MUL = Op.MUL
    DIV = Op.DIV
    NEG = Op.NEG
    SQRT = Op.SQRT
    EXP = Op.EXP
    LOG = Op.LOG
    SIN = Op.SIN
    COS = Op.COS
    IS_ZERO = Op.IS_ZERO
    TANH = Op.TANH
    LARGER = Op.LARGER
    SMALLER = Op.SMALLER
    CHOOSE = Op.CHOOSE
    MULTIPLY_ADD = 15
    """a b + c"""
    MULTIPLY_SUBTRACT = 16
    """a b - c"""
    SUBTRACT_PRODUCT = 17
    """c - a b"""
    COPY = 18


MEANING: Final[Mapping[Code, Callable[..., Any]]] = {
    Code.ADD: np.add,
    Code.SUB: np.subtract,
    Code.MUL: np.multiply,
    Code.DIV: np.true_divide,
    Code.NEG: np.negative,
    Code.SQRT: np.sqrt,
    Code.EXP: np.exp,
    Code.LOG: np.log,
    Code.SIN: np.sin,
    Code.COS: np.cos,
    Code.IS_ZERO: lambda a: np.where(a == 0, 1.0, 0.0),
    Code.TANH: np.tanh,
    Code.LARGER: np.maximum,
    Code.SMALLER: np.minimum,
    Code.CHOOSE: lambda decider, a, b: np.where(decider > 0, a, b),
    Code.MULTIPLY_ADD: lambda a, b, c: a * b + c,
    Code.MULTIPLY_SUBTRACT: lambda a, b, c: a * b - c,
    Code.SUBTRACT_PRODUCT: lambda a, b, c: c - a * b,
    Code.COPY: np.positive,
}


def operands(graph: Graph, wanted: Sequence[int]) -> set[int]:
    """Return all nodes that some nodes are made of, themselves included."""
    needed: set[int] = set()
    pending = list(wanted)
    while pending:
        node = pending.pop()
        if node in needed or node < 0:
            continue
        needed.add(node)
        op, first, second = graph.nodes[node]
        if op not in {Op.CONSTANT, Op.PARAMETER}:
            pending += (first, second)
    return needed


class Formulas:
    """Numbers of a graph, to be computed again and again.

    Parameters
    ----------
    graph : Graph
    wanted : sequence
        Numbers of the graph, or floats.
    """

    def __init__(self, graph: Graph, wanted: Sequence[Any]) -> None:
        self._targets = nodes_of(graph, wanted)
        self._known: dict[int, Any] = {}
        self._given: list[tuple[int, int]] = []
        self._rows: list[tuple[int, Callable[..., Any], tuple[int, ...]]] = []
        for node in sorted(operands(graph, self._targets)):
            op, first, second = graph.nodes[node]
            if op is Op.CONSTANT:
                self._known[node] = graph.values[node]
            elif op is Op.PARAMETER:
                self._given.append((node, first))
            elif op is Op.CHOOSE:
                self._rows.append((node, MEANING[Code.CHOOSE], (first, *graph.nodes[second][1:])))
            elif op is not Op.PAIR:
                self._rows.append((node, MEANING[Code(int(op))], (first, second) if second >= 0 else (first,)))

    def __call__(self, parameters: Any) -> Real:
        """Return the numbers (wanted, ...) where the graph's parameters are ``parameters``, (parameters, ...)."""
        found = self._known | {node: parameters[place] for node, place in self._given}
        for node, meaning, places in self._rows:
            found[node] = meaning(*[found[place] for place in places])
        result = np.empty((len(self._targets), *np.shape(parameters)[1:]))
        for row, node in enumerate(self._targets):
            result[row] = found[node]
        return result
