"""Numbers that remember how they were made: arithmetic on them writes an expression graph, once for all parameter values.

An element's `realize` and a document's expressions are plain arithmetic. Given traced numbers in place of floats they leave
behind the formula of every coefficient, which the compiled kernels then evaluate for thousands of parameter sets without
running any Python. Equal formulas are one node; what depends on no parameter stays an ordinary float and is folded at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Any, Final

import numpy as np
import numpy.typing as npt


class UnsuitableError(Exception):
    """The diagram, or a law of it, is no formula of its states and inputs; the message says why."""


class Op(IntEnum):
    """Operations of the graph; the numbers are those that the kernels interpret."""

    ADD = 0
    SUB = 1
    MUL = 2
    DIV = 3
    NEG = 4
    SQRT = 5
    EXP = 6
    LOG = 7
    SIN = 8
    COS = 9
    IS_ZERO = 10
    TANH = 11
    LARGER = 12
    SMALLER = 13
    CHOOSE = 14
    CONSTANT = 100
    PARAMETER = 101
    PAIR = 102


_NUMERIC: Final[Mapping[Op, Callable[..., float]]] = {
    Op.ADD: lambda a, b: a + b,
    Op.SUB: lambda a, b: a - b,
    Op.MUL: lambda a, b: a * b,
    Op.DIV: lambda a, b: a / b if b else math.nan,
    Op.NEG: lambda a: -a,
    Op.SQRT: lambda a: math.sqrt(a) if a >= 0 else math.nan,
    Op.EXP: lambda a: float(np.exp(a)),
    Op.LOG: lambda a: math.log(a) if a > 0 else math.nan,
    Op.SIN: lambda a: math.sin(a) if math.isfinite(a) else math.nan,
    Op.COS: lambda a: math.cos(a) if math.isfinite(a) else math.nan,
    Op.IS_ZERO: lambda a: float(a == 0),
    Op.TANH: math.tanh,
    Op.LARGER: max,
    Op.SMALLER: min,
}
_COMMUTES: Final = frozenset({Op.ADD, Op.MUL, Op.LARGER, Op.SMALLER})


class Graph:
    """Nodes in the order in which they were made, so that operands always come first.

    Attributes
    ----------
    nodes : list of (operation, first operand, second operand)
        Operands are node numbers, -1 where there is none; that of a parameter is its number among the parameters. A choice
        has what decides, and a pair: the number taken where that is positive, and the other.
    values : list of float
        What each node is at the values that the graph was traced at.
    """

    def __init__(self) -> None:
        self.nodes: list[tuple[Op, int, int]] = []
        self.values: list[float] = []
        self._known: dict[tuple[Op, int, int] | float | str, int] = {}
        self._parameters = 0

    def parameter(self, value: float) -> Traced:
        """Return the next parameter, traced at ``value``."""
        self._parameters += 1
        return self._node((Op.PARAMETER, self._parameters - 1, -1), value)

    def constant(self, value: float) -> int:
        """Return the node number of a constant."""
        # 0.0 == -0.0 and nan != nan, as keys of a dictionary too: these are known by their digits
        key = value.hex() if value == 0 or math.isnan(value) else value
        number = self._known.get(key)
        if number is None:
            number = self._known[key] = len(self.nodes)
            self.nodes.append((Op.CONSTANT, -1, -1))
            self.values.append(value)
        return number

    def apply(self, op: Op, *operands: Any) -> Traced:
        """Return the result of an operation."""
        numbers = nodes_of(self, operands)
        if len(numbers) == 1:
            (number,) = numbers
            return self._node((op, number, -1), _NUMERIC[op](self.values[number]))
        first, second = numbers
        value = _NUMERIC[op](self.values[first], self.values[second])
        if first > second and op in _COMMUTES:
            first, second = second, first
        return self._node((op, first, second), value)

    def choose(self, decider: Traced, positive: Any, otherwise: Any) -> Any:
        """Return ``positive`` where ``decider`` is positive, else ``otherwise``."""
        yes, no = nodes_of(self, [positive, otherwise])
        if yes == no:
            return positive
        pair = self._node((Op.PAIR, yes, no), math.nan)
        value = self.values[yes if self.values[decider.node] > 0 else no]
        return self._node((Op.CHOOSE, decider.node, pair.node), value)

    def number(self, node: int) -> Traced:
        """Return a node as a number to calculate with."""
        return Traced(self, node)

    def _node(self, key: tuple[Op, int, int], value: float) -> Traced:
        number = self._known.get(key)
        if number is None:
            number = self._known[key] = len(self.nodes)
            self.nodes.append(key)
            self.values.append(float(value))
        return self.number(number)


class Traced:
    """A number that depends on a parameter. ``real`` is its value where the graph was traced; decisions look at that."""

    __slots__ = ("graph", "node")

    imag = 0.0

    def __init__(self, graph: Graph, node: int) -> None:
        self.graph = graph
        self.node = node

    @property
    def real(self) -> float:
        """The value at the parameters that the graph was traced at."""
        return self.graph.values[self.node]

    def __repr__(self) -> str:
        return f"Traced({self.real:g})"

    def __add__(self, other: Any) -> Any:
        if not isinstance(other, Traced):
            if not isinstance(other, _PLAIN):
                return NotImplemented
            if other == 0.0:
                return self
        return self.graph.apply(Op.ADD, self, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Traced):
            if other.node == self.node:
                return 0.0
        elif not isinstance(other, _PLAIN):
            return NotImplemented
        elif other == 0.0:
            return self
        return self.graph.apply(Op.SUB, self, other)

    def __rsub__(self, other: Any) -> Any:
        if not isinstance(other, _PLAIN):
            return NotImplemented
        return -self if other == 0.0 else self.graph.apply(Op.SUB, other, self)

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Traced):
            if not isinstance(other, _PLAIN):
                return NotImplemented
            if other == 0.0:
                return 0.0
            if other == 1.0:
                return self
            if other == -1.0:
                return -self
        return self.graph.apply(Op.MUL, self, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Traced):
            return 1.0 if other.node == self.node else self.graph.apply(Op.DIV, self, other)
        return self * (1.0 / other) if isinstance(other, _PLAIN) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        if not isinstance(other, _PLAIN):
            return NotImplemented
        return 0.0 if other == 0.0 else self.graph.apply(Op.DIV, other, self)

    def __neg__(self) -> Any:
        op, first, _ = self.graph.nodes[self.node]
        return self.graph.number(first) if op is Op.NEG else self.graph.apply(Op.NEG, self)

    def __pos__(self) -> Traced:
        return self

    def __pow__(self, exponent: Any) -> Any:
        if not isinstance(exponent, Traced):
            power = float(exponent.real)
            if power == round(power) and abs(power) <= _LARGEST_WHOLE_POWER:
                product: Any = 1.0
                for _ in range(abs(round(power))):
                    product = self * product
                return product if power >= 0 else 1.0 / product
            if power == 0.5:
                return self.apply(Op.SQRT)
            if power == 0.25:
                return self.apply(Op.SQRT).apply(Op.SQRT)
        return (exponent * self.apply(Op.LOG)).apply(Op.EXP)

    def __rpow__(self, base: Any) -> Any:
        number = float(base.real)
        if number == 0:
            return 0.0
        return (self * math.log(number)).apply(Op.EXP) if number > 0 else math.nan

    def apply(self, op: Op) -> Traced:
        """Return a function of one argument."""
        return self.graph.apply(op, self)

    # numpy calls these, by name, for its functions of numbers it does not know
    def exp(self) -> Traced:
        """Return e to its power."""
        return self.apply(Op.EXP)

    def log(self) -> Traced:
        """Return its natural logarithm."""
        return self.apply(Op.LOG)

    def sqrt(self) -> Traced:
        """Return its square root."""
        return self.apply(Op.SQRT)

    def sin(self) -> Traced:
        """Return its sine."""
        return self.apply(Op.SIN)

    def cos(self) -> Traced:
        """Return its cosine."""
        return self.apply(Op.COS)

    def tanh(self) -> Traced:
        """Return its hyperbolic tangent."""
        return self.apply(Op.TANH)


_LARGEST_WHOLE_POWER: Final = 16
_PLAIN: Final = (float, int, np.number)


def nominal(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return an array of traced numbers and floats as the floats that it was traced at; other arrays as they are."""
    if values.dtype != object:
        return values
    return np.array([float(entry.real) for entry in values.ravel()]).reshape(values.shape)


def nodes_of(graph: Graph, entries: Sequence[Traced | float]) -> list[int]:
    """Return the node numbers of traced numbers and floats."""
    return [entry.node if isinstance(entry, Traced) else graph.constant(float(entry)) for entry in entries]
