"""Derivatives, written into the graph: the rules of differentiation for every operation; and formulas with other numbers put in.

(a b)' = a' b + a b',   (a/b)' = (a' - (a/b) b')/b,   choose(d, a, b)' = choose(d, a', b')
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from engine.batch.nonlinear.signals import SignalGraph, choose
from engine.model.traced import Op, Traced


def slopes(graph: SignalGraph, entries: Sequence[Any], seeds: Mapping[int, Any]) -> list[Any]:
    """Return the time derivative of numbers.

    Parameters
    ----------
    graph : SignalGraph
    entries : sequence
        Numbers of the graph, or floats.
    seeds : mapping of int to number
        The time derivative of each signal, by its node; what is no signal does not move.
    """
    known: dict[int, Any] = {}
    for node in _order(graph, [entry.node for entry in entries if isinstance(entry, Traced)], seeds):
        op, first, second = graph.nodes[node]
        if node in seeds:
            known[node] = seeds[node]
        elif op in {Op.PAIR, Op.PARAMETER} or not graph.moves(node):
            known[node] = 0.0
        elif op is Op.CHOOSE:
            _, yes, no = graph.nodes[second]
            known[node] = choose(graph.number(first), known[yes], known[no])
        else:
            operands = [k for k in (first, second) if k >= 0]
            partials = _PARTIALS[op](graph.number(node), *(graph.number(k) for k in operands))
            total: Any = 0.0
            for partial, operand in zip(partials, operands, strict=True):
                total = partial * known[operand] + total
            known[node] = total
    return [known[entry.node] if isinstance(entry, Traced) else 0.0 for entry in entries]


def substituted(graph: SignalGraph, entries: Sequence[Any], given: Mapping[int, Any]) -> list[Any]:
    """Return numbers of a graph with other numbers in place of the nodes ``given``."""
    known: dict[int, Any] = {}
    for node in _order(graph, [entry.node for entry in entries if isinstance(entry, Traced)], given):
        op, first, second = graph.nodes[node]
        if node in given:
            known[node] = given[node]
        elif op is Op.CHOOSE:
            _, yes, no = graph.nodes[second]
            known[node] = choose(known[first], known[yes], known[no])
        elif op in _ARITHMETIC and any(not isinstance(known[k], Traced) for k in (first, second) if k >= 0):
            known[node] = _ARITHMETIC[op](*(known[k] for k in (first, second) if k >= 0))
        elif op in {Op.PARAMETER, Op.PAIR}:
            known[node] = graph.number(node)
        elif op is Op.CONSTANT:
            known[node] = graph.values[node]
        else:
            known[node] = graph.apply(op, *(known[k] for k in (first, second) if k >= 0))
    return [known[entry.node] if isinstance(entry, Traced) else entry for entry in entries]


def _order(graph: SignalGraph, targets: Sequence[int], seeds: Mapping[int, Any]) -> list[int]:
    """Return the nodes that the targets are made of, operands first."""
    needed: set[int] = set()
    pending = list(targets)
    while pending:
        node = pending.pop()
        if node in needed or node < 0:
            continue
        needed.add(node)
        op, first, second = graph.nodes[node]
        if node not in seeds and op not in {Op.CONSTANT, Op.PARAMETER}:
            pending += (first, second)
    return sorted(needed)


_ARITHMETIC: Final[Mapping[Op, Callable[..., Any]]] = {
    Op.ADD: operator.add, Op.SUB: operator.sub, Op.MUL: operator.mul, Op.DIV: operator.truediv, Op.NEG: operator.neg,
}  # fmt: skip
"""Operations that are simpler where an operand is a plain number."""
_PARTIALS: Final[Mapping[Op, Callable[..., tuple[Any, ...]]]] = {
    Op.ADD: lambda *_: (1.0, 1.0),
    Op.SUB: lambda *_: (1.0, -1.0),
    Op.MUL: lambda _, a, b: (b, a),
    Op.DIV: lambda y, _, b: (1.0 / b, -y / b),
    Op.NEG: lambda *_: (-1.0,),
    Op.SQRT: lambda y, _: (0.5 / y,),
    Op.EXP: lambda y, _: (y,),
    Op.LOG: lambda _, a: (1.0 / a,),
    Op.SIN: lambda _, a: (a.apply(Op.COS),),
    Op.COS: lambda _, a: (-a.apply(Op.SIN),),
    Op.TANH: lambda y, _: (1.0 - y * y,),
    Op.LARGER: lambda _, a, b: (choose(a - b, 1.0, 0.0), choose(a - b, 0.0, 1.0)),
    Op.SMALLER: lambda _, a, b: (choose(a - b, 0.0, 1.0), choose(a - b, 1.0, 0.0)),
    Op.IS_ZERO: lambda *_: (0.0,),
}
"""Slopes of each operation by its operands, from its result and them."""
