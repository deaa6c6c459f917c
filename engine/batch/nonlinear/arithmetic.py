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


def evaluated(graph: Graph, wanted: Sequence[Any], parameters: Any) -> Real:
    """Return numbers of a graph, (wanted, ...), where its parameters are ``parameters``, (parameters, ...)."""
    targets = nodes_of(graph, wanted)
    needed = operands(graph, targets)
    shape = np.shape(parameters)[1:]
    found: dict[int, Any] = {}
    for node in sorted(needed):
        op, first, second = graph.nodes[node]
        if op is Op.CONSTANT:
            found[node] = graph.values[node]
        elif op is Op.PARAMETER:
            found[node] = parameters[first]
        elif op is Op.CHOOSE:
            _, yes, no = graph.nodes[second]
            found[node] = MEANING[Code.CHOOSE](found[first], found[yes], found[no])
        elif op is not Op.PAIR:
            found[node] = MEANING[Code(int(op))](*(found[k] for k in (first, second) if k >= 0))
    return np.array([np.broadcast_to(found[node], shape) for node in targets], dtype=float).reshape(
        len(targets), *shape
    )
