"""Traced numbers that move with time: a law that calculates with them leaves behind its formula.

What a law may do with a signal is arithmetic, the elementary functions and a choice by a comparison (`np.where`). A decision
that Python would have to take is no formula, and refused.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from engine.model.traced import Graph, Op, Traced, UnsuitableError


class SignalGraph(Graph):
    """A graph in which some parameters stand for what moves: states, inputs and their slopes."""

    def __init__(self) -> None:
        super().__init__()
        self._moving: list[bool] = []
        self._signals: set[int] = set()

    def signal(self) -> Any:
        """Return the next signal; it is numbered among the parameters."""
        made = self.parameter(0.0)
        self._signals.add(made.node)
        self._moving[made.node] = True
        return self.number(made.node)

    def moves(self, node: int) -> bool:
        """Whether a node depends on a signal."""
        for op, first, second in self.nodes[len(self._moving) :]:
            operands = () if op in {Op.CONSTANT, Op.PARAMETER} else (first, second)
            self._moving.append(any(self._moving[k] for k in operands if k >= 0))
        return self._moving[node]

    def number(self, node: int) -> Traced:
        """Return a node as a number to calculate with."""
        return Signal(self, node) if self.moves(node) else Traced(self, node)

    def needs(self, entry: Any) -> set[int]:
        """Return the signals that a number depends on, by their nodes."""
        found: set[int] = set()
        seen: set[int] = set()
        pending = [entry.node] if isinstance(entry, Signal) else []
        while pending:
            node = pending.pop()
            if node in seen or node < 0:
                continue
            seen.add(node)
            op, first, second = self.nodes[node]
            if node in self._signals:
                found.add(node)
            elif op not in {Op.CONSTANT, Op.PARAMETER}:
                pending += (first, second)
        return found

    def choices(self, entry: Any) -> list[int]:
        """Return the whole numbers between which a number is chosen.

        Raises
        ------
        UnsuitableError
            If it is anything else.
        """
        if not isinstance(entry, Traced):
            return [int(entry)]
        op, _, second = self.nodes[entry.node]
        if op is Op.CONSTANT:
            return [int(self.values[entry.node])]
        if op is not Op.CHOOSE:
            raise UnsuitableError("what follows a mode is calculated")
        _, *both = self.nodes[second]
        return [number for node in both for number in self.choices(self.number(node))]


class Signal(Traced):
    """A number without a value of its own: it is another at every instant."""

    __slots__ = ()

    @property
    def real(self) -> float:
        """There is none: what asks for it wants to decide."""
        raise UnsuitableError("it decides by the value of a signal")

    def __repr__(self) -> str:
        return f"Signal({self.node})"

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Traced) and not isinstance(other, Signal):
            return self * (1.0 / other)  # the reciprocal of what does not move is computed once
        return super().__truediv__(other)

    def __gt__(self, other: Any) -> Condition:
        return Condition(self - other)

    def __lt__(self, other: Any) -> Condition:
        return Condition(other - self)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *operands: Any, **options: Any) -> Any:
        function = _FUNCTIONS.get(ufunc)
        if function is None or method != "__call__" or options:
            raise UnsuitableError(f"it needs {ufunc.__name__} of a signal")
        return function(*(entry.item() if isinstance(entry, np.ndarray | np.number) else entry for entry in operands))

    def __array_function__(
        self, function: Callable[..., Any], types: Sequence[type], args: Sequence[Any], kwargs: Mapping[str, Any]
    ) -> Any:
        if function is np.real:  # signals have no infinitesimals
            return args[0]
        return _chosen(function, *args)


class Condition:
    """Whether a signal is positive."""

    def __init__(self, decider: Any) -> None:
        self.decider = decider

    def __bool__(self) -> bool:
        raise UnsuitableError("it decides by the value of a signal")

    def __array_function__(
        self, function: Callable[..., Any], types: Sequence[type], args: Sequence[Any], kwargs: Mapping[str, Any]
    ) -> Any:
        return _chosen(function, *args)


def choose(decider: Any, positive: Any, otherwise: Any) -> Any:
    """Return ``positive`` where ``decider`` is positive, else ``otherwise``; a plain number decides at once."""
    if isinstance(decider, Traced):
        return decider.graph.choose(decider, positive, otherwise)
    return positive if decider > 0 else otherwise


def largest(numbers: Sequence[Any]) -> Any:
    """Return the largest of numbers, some of which may be signals."""
    found = numbers[0]
    for number in numbers[1:]:
        found = _pick(Op.LARGER, found, number)
    return found


def least(numbers: Sequence[Any]) -> Any:
    """Return the least of numbers, some of which may be signals."""
    found = numbers[0]
    for number in numbers[1:]:
        found = _pick(Op.SMALLER, found, number)
    return found


def _pick(op: Op, a: Any, b: Any) -> Any:
    traced = next((entry for entry in (a, b) if isinstance(entry, Traced)), None)
    if traced is None:
        return max(a, b) if op is Op.LARGER else min(a, b)
    return traced.graph.apply(op, a, b)


def _chosen(function: Callable[..., Any], *args: Any) -> Any:
    if function is np.where and len(args) == 3 and isinstance(args[0], Condition):
        return choose(args[0].decider, args[1], args[2])
    raise UnsuitableError(f"it needs {function.__name__} of a signal")


_FUNCTIONS: Final[Mapping[np.ufunc, Callable[..., Any]]] = {
    np.add: operator.add,
    np.subtract: operator.sub,
    np.multiply: operator.mul,
    np.true_divide: operator.truediv,
    np.power: operator.pow,
    np.negative: operator.neg,
    np.exp: lambda a: a.apply(Op.EXP),
    np.log: lambda a: a.apply(Op.LOG),
    np.sqrt: lambda a: a.apply(Op.SQRT),
    np.sin: lambda a: a.apply(Op.SIN),
    np.cos: lambda a: a.apply(Op.COS),
    np.tanh: lambda a: a.apply(Op.TANH),
    np.maximum: lambda a, b: _pick(Op.LARGER, a, b),
    np.minimum: lambda a, b: _pick(Op.SMALLER, a, b),
}
