"""The loop and path transfer functions of a diagram as formulas: sparse elimination over the signals, once for all values.

    signal = Σ G_ij(jω) · source,    G = C adj(jω - A) B / det(jω - A) + D   for every block

A block of up to four states is a quotient of polynomials in jω whose coefficients are formulas of the parameters; of a larger
one the states take part in the elimination.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from engine.batch.kernels.assembly import Row, add, is_zero, solve
from engine.model.traced import Traced

if TYPE_CHECKING:
    from engine.diagram.diagram import TracedDiagram
    from engine.diagram.realize import Wiring
    from engine.elements import Realization

_LARGEST_QUOTIENT = 4


class Code(IntEnum):
    """Operations of a program, as the kernels interpret them."""

    POLYNOMIAL = 0
    ADD = 1
    SUB = 2
    MUL = 3
    DIV = 4
    SCALE = 5
    SHIFT = 6
    NEG = 7
    TABLE = 8
    MUL_TABLE = 9
    TABLE_DIV = 10
    TABLE_SCALE = 11
    TABLE_OVER_POLYNOMIAL = 12


class Curves:
    """The graph of complex functions of frequency that a diagram needs; equal functions are one node."""

    def __init__(self) -> None:
        self.nodes: list[tuple[Any, ...]] = []
        self.varies: list[bool] = []
        self._known: dict[tuple[Any, ...], int] = {}

    def node(self, code: Code, *operands: Any) -> Curve:
        """Return a function; operands are curves, or real numbers where the operation says so."""
        key = (code, *map(_key, operands))
        number = self._known.get(key)
        if number is None:
            number = self._known[key] = len(self.nodes)
            self.nodes.append((code, *operands))
            self.varies.append(any(self._changes(o) for o in operands))
        return Curve(self, number)

    def polynomial(self, coefficients: Sequence[Any]) -> Any:
        """Return a polynomial in jω, lowest power first; a plain number where it is constant."""
        kept = list(coefficients)
        while kept and is_zero(kept[-1]):
            kept.pop()
        if len(kept) < 2:
            return kept[0] if kept else 0.0
        return self.node(Code.POLYNOMIAL, *kept)

    def _changes(self, operand: Any) -> bool:
        return self.varies[operand.number] if isinstance(operand, Curve) else isinstance(operand, Traced)


def _key(operand: Any) -> int | str:
    """Return what equal operands share: functions are counted up from 0, formulas down from -1, numbers go by their digits."""
    if isinstance(operand, Curve):
        return operand.number
    return -1 - operand.node if isinstance(operand, Traced) else float(operand).hex()


class Curve:
    """A complex function of frequency, with the arithmetic that an elimination needs."""

    __slots__ = ("curves", "number")

    real = 1.0  # an elimination asks how large a pivot is; a function is as good as another

    def __init__(self, curves: Curves, number: int) -> None:
        self.curves = curves
        self.number = number

    def _split(self) -> tuple[bool, Curve]:
        """Return (whether it is negated, what is negated): signs are moved outwards, so that equal products meet."""
        node = self.curves.nodes[self.number]
        return (True, node[1]) if node[0] is Code.NEG else (False, self)

    def signed(self, negative: bool) -> Curve:
        """Return the function, negated or not."""
        return self.curves.node(Code.NEG, self) if negative else self

    def __add__(self, other: Any) -> Any:
        if is_zero(other):
            return self
        minus, base = self._split()
        if not isinstance(other, Curve):
            return self.curves.node(Code.SHIFT, base, -other if minus else other).signed(minus)
        minus2, base2 = other._split()
        if minus != minus2:
            return self.curves.node(Code.SUB, *((base2, base) if minus else (base, base2)))
        return self.curves.node(Code.ADD, *_in_order(base, base2)).signed(minus)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __neg__(self) -> Any:
        minus, base = self._split()
        return base.signed(not minus)

    def __mul__(self, other: Any) -> Any:
        if is_zero(other):
            return 0.0
        minus, base = self._split()
        if isinstance(other, Curve):
            minus2, base2 = other._split()
            return self.curves.node(Code.MUL, *_in_order(base, base2)).signed(minus != minus2)
        if not isinstance(other, Traced) and abs(other) == 1:
            return base.signed(minus != (other < 0))
        return self.curves.node(Code.SCALE, base, other).signed(minus)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if not isinstance(other, Curve):
            return self * (1.0 / other)
        (minus, base), (minus2, base2) = self._split(), other._split()
        return self.curves.node(Code.DIV, base, base2).signed(minus != minus2)

    def __rtruediv__(self, other: Any) -> Any:
        return self.curves.node(Code.POLYNOMIAL, other) / self


def _in_order(first: Curve, second: Curve) -> tuple[Curve, Curve]:
    """Return the operands of what commutes in one order, so that equal functions meet."""
    return (first, second) if first.number <= second.number else (second, first)


class Network:
    """The signals of one wiring, solved for what each external input makes of them.

    Parameters
    ----------
    curves : Curves
    traced : TracedDiagram
    wiring : Wiring
    sources : sequence of int
        Positions of the external inputs that are asked about.
    """

    def __init__(self, curves: Curves, traced: TracedDiagram, wiring: Wiring, sources: Sequence[int]) -> None:
        self._curves = curves
        self._wiring = wiring
        self._outputs = sum(block.d.shape[-2] for block in traced.realizations)
        self._rows: list[Row] = [{} for _ in range(self._outputs)]
        self._right: list[Row] = [{} for _ in range(self._outputs)]
        self._sources = {self._outputs + source: k for k, source in enumerate(sources)}
        base = 0
        for number, block in enumerate(traced.realizations):
            drives = traced.interconnection.sources_of(number, wiring)
            self._enter(block, base, drives)
            base += block.d.shape[-2]
        for k in range(len(self._rows)):
            add(self._rows[k], k, 1.0)
        self.signals = solve(self._rows, self._right, _cost, lambda _: None)

    def read(self, output: int, source: int) -> Any:
        """Return what an output of the wiring gets from one of ``sources``, by position."""
        signal = self._wiring.reads[output]
        if signal in self._sources:
            return 1.0 if self._sources[signal] == source else 0.0
        return self.signals[signal].get(source, 0.0) if signal < self._outputs else 0.0

    def _drive(self, row: int, signal: int, gain: Any) -> None:
        """Add ``gain`` times a signal to a row."""
        if signal in self._sources:
            add(self._right[row], self._sources[signal], gain)
        elif signal < self._outputs:
            add(self._rows[row], signal, -gain)

    def _enter(self, block: Realization, base: int, drives: Sequence[int]) -> None:
        n = block.a.shape[-1]
        used = [j for j, signal in enumerate(drives) if signal in self._sources or signal < self._outputs]
        if n <= _LARGEST_QUOTIENT:
            quotient = _Quotient(self._curves, block)
            for i in range(block.d.shape[-2]):
                for j in used:
                    self._drive(base + i, drives[j], quotient.gain(i, j))
        else:
            first = len(self._rows)
            self._rows += [{} for _ in range(n)]
            self._right += [{} for _ in range(n)]
            for i in range(n):
                # (jω - a_ii) x_i = Σ a_ij x_j + Σ b_ij u_j
                inverse = 1.0 / self._curves.node(Code.POLYNOMIAL, -block.a[i, i], 1.0)
                for j in range(n):
                    if j != i and not is_zero(block.a[i, j]):
                        add(self._rows[first + i], first + j, -(block.a[i, j] * inverse))
                for j in used:
                    if not is_zero(block.b[i, j]):
                        self._drive(first + i, drives[j], block.b[i, j] * inverse)
            for i in range(block.d.shape[-2]):
                for j in range(n):
                    if not is_zero(block.c[i, j]):
                        add(self._rows[base + i], first + j, -block.c[i, j])
                for j in used:
                    if not is_zero(block.d[i, j]):
                        self._drive(base + i, drives[j], block.d[i, j])


class _Quotient:
    """One block as quotients of polynomials, by the method of Leverrier and Faddeev."""

    def __init__(self, curves: Curves, block: Realization) -> None:
        self._curves, self._block = curves, block
        n = block.a.shape[-1]
        a = block.a.tolist()
        adjoint: list[list[list[Any]]] = []
        characteristic: list[Any] = [1.0]
        current: list[list[Any]] = [[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)]
        for k in range(1, n + 1):
            adjoint.append(current)
            columns = list(zip(*current, strict=True))
            diagonal = [_dot(row, column) for row, column in zip(a, columns, strict=True)]
            coefficient = sum(diagonal) * (-1.0 / k)
            characteristic.append(coefficient)
            if k < n:
                current = [
                    [diagonal[i] + coefficient if i == j else _dot(a[i], columns[j]) for j in range(n)]
                    for i in range(n)
                ]
        self._adjoint = adjoint
        self._characteristic = characteristic
        self._inverse = 1.0 / curves.polynomial(characteristic[::-1]) if n else 1.0

    def gain(self, i: int, j: int) -> Any:
        """Return the transfer function from input j to output i."""
        n = self._block.a.shape[-1]
        direct = self._block.d[i, j]
        c, b = self._block.c[i].tolist() if n else [], [row[j] for row in self._block.b.tolist()]
        numerator: list[Any] = [direct * coefficient for coefficient in self._characteristic]
        for k, matrix in enumerate(self._adjoint):
            numerator[k + 1] = numerator[k + 1] + _dot(c, [_dot(row, b) for row in matrix])
        if n == 0:
            return numerator[0]
        polynomial = self._curves.polynomial(numerator[::-1])
        return 0.0 if is_zero(polynomial) else polynomial * self._inverse


def _dot(row: Sequence[Any], column: Sequence[Any]) -> Any:
    total: Any = 0.0
    for x, y in zip(row, column, strict=True):
        if not is_zero(x) and not is_zero(y):
            total = total + x * y
    return total


def _cost(value: Any) -> float:
    """Plain numbers before formulas before functions; among equals, what is the same for all candidates."""
    if isinstance(value, Curve):
        return 3.0 if value.curves.varies[value.number] else 2.0
    return 1.0 if isinstance(value, Traced) else 0.0
