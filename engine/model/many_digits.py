"""Formulas in many digits, with their slopes: what double precision loses of a sum of parts that are decades apart is kept.

A parameter is the binary number that it is, exactly; from there on arithmetic has `DIGITS` decimal digits, which no
quantity of a drive is apart. Sines and cosines, which no coefficient at rest is a small rest of, keep double precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from decimal import Context, Decimal, DecimalException, DivisionByZero, InvalidOperation, Overflow, localcontext
from typing import TYPE_CHECKING, Any, Final

from engine.model.errors import UnresolvedError
from engine.model.traced import Op, Traced

if TYPE_CHECKING:
    from engine.model.traced import Graph

DIGITS: Final = 450

CONTEXT: Final = Context(prec=DIGITS, traps=[DivisionByZero, InvalidOperation, Overflow])
"""All arithmetic on such numbers is done within it."""

Slopes = Mapping[int, Decimal]
"""Derivative along each lane that moves a number; none where no lane does."""

_STILL: Final[Slopes] = {}
_ZERO, _ONE = Decimal(0), Decimal(1)


class Formulas:
    """All nodes of a graph at the values of its parameters.

    Parameters
    ----------
    graph : Graph
    parameters : sequence of float
        In the order in which they were traced.
    lanes : mapping of int to int, optional
        The lane of each parameter that moves, by its number. Without it all move, each along a lane of its own, and by its
        own size: slopes are then those by the logarithms.

    Raises
    ------
    UnresolvedError
        If a node has no finite value.
    """

    def __init__(self, graph: Graph, parameters: Sequence[float], lanes: Mapping[int, int] | None) -> None:
        self._values: list[Decimal] = []
        self._slopes: list[Slopes] = []
        try:
            with localcontext(CONTEXT):
                for number in range(len(graph.nodes)):
                    value, slopes = self._node(graph, number, parameters, lanes)
                    self._values.append(value)
                    self._slopes.append(slopes)
        except (DecimalException, OverflowError):
            raise UnresolvedError("a coefficient must be finite, but in many digits it is not") from None

    def _node(
        self, graph: Graph, number: int, parameters: Sequence[float], lanes: Mapping[int, int] | None
    ) -> tuple[Decimal, Slopes]:
        op, first, second = graph.nodes[number]
        if op is Op.PARAMETER:
            return _moved(_exactly(parameters[first]), first, lanes)
        if op in (Op.CONSTANT, Op.PAIR):
            return (_ZERO if op is Op.PAIR else _exactly(graph.values[number])), _STILL
        if op is Op.CHOOSE:
            _, yes, no = graph.nodes[second]
            taken = yes if self._values[first] > 0 else no
            return self._values[taken], self._slopes[taken]
        if second < 0:
            value, slope = _FUNCTIONS[op](self._values[first])
            return value, times(slope, self._slopes[first])
        value, to_first, to_second = _of_two(op, self._values[first], self._values[second])
        return value, _sum(times(to_first, self._slopes[first]), times(to_second, self._slopes[second]))

    def of(self, entry: Any) -> tuple[Decimal, Slopes]:
        """Return the value of a coefficient, a formula or a plain number, and its slopes."""
        if isinstance(entry, Traced):
            return self._values[entry.node], self._slopes[entry.node]
        return _exactly(float(entry)), _STILL


def _exactly(value: float) -> Decimal:
    if not math.isfinite(value):
        raise OverflowError
    return Decimal(value)


def _moved(value: Decimal, number: int, lanes: Mapping[int, int] | None) -> tuple[Decimal, Slopes]:
    """Return a parameter with its slope."""
    if lanes is None:
        return value, {number: value}
    return value, {lanes[number]: _ONE} if number in lanes else _STILL


def times(factor: Decimal, slopes: Slopes) -> Slopes:
    """Return the slopes of a number times a factor."""
    return {lane: factor * slope for lane, slope in slopes.items()} if slopes and factor else _STILL


def _sum(first: Slopes, second: Slopes) -> Slopes:
    if not first or not second:
        return first or second
    return {lane: first.get(lane, _ZERO) + second.get(lane, _ZERO) for lane in first.keys() | second.keys()}


def _root(a: Decimal) -> tuple[Decimal, Decimal]:
    root = a.sqrt()
    return root, 1 / (2 * root) if root else _ZERO


def _power(a: Decimal) -> tuple[Decimal, Decimal]:
    value = a.exp()
    return value, value


def _bent(a: Decimal) -> tuple[Decimal, Decimal]:
    left = (-2 * abs(a)).exp()
    size = (1 - left) / (1 + left)
    return size.copy_sign(a), 1 - size * size


_FUNCTIONS: Final[Mapping[Op, Callable[[Decimal], tuple[Decimal, Decimal]]]] = {
    Op.NEG: lambda a: (-a, -_ONE),
    Op.SQRT: _root,
    Op.EXP: _power,
    Op.LOG: lambda a: (a.ln(), 1 / a),
    Op.TANH: _bent,
    Op.IS_ZERO: lambda a: (Decimal(int(a == 0)), _ZERO),
    Op.SIN: lambda a: (Decimal(math.sin(a)), Decimal(math.cos(a))),
    Op.COS: lambda a: (Decimal(math.cos(a)), -Decimal(math.sin(a))),
}
"""A function of one number and its slope."""


def _of_two(op: Op, a: Decimal, b: Decimal) -> tuple[Decimal, Decimal, Decimal]:
    """Return a function of two numbers and its slope in either."""
    if op is Op.ADD:
        return a + b, _ONE, _ONE
    if op is Op.SUB:
        return a - b, _ONE, -_ONE
    if op is Op.MUL:
        return a * b, b, a
    if op is Op.DIV:
        value = a / b
        return value, 1 / b, -value / b
    first = a >= b if op is Op.LARGER else a <= b
    return (a, _ONE, _ZERO) if first else (b, _ZERO, _ONE)
