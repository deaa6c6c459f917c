"""Programs that calculate functions of frequency, one operation after another, for the kernels to interpret.

What depends on no parameter is tabulated once for all candidates; operations with such a table take it as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.transfer import Code, Curve, Curves

if TYPE_CHECKING:
    from engine.batch.kernels.tape import Registers

Complex = npt.NDArray[np.complex128]
Whole = npt.NDArray[np.int32]

_WITH_TABLE = {Code.MUL: Code.MUL_TABLE, Code.DIV: Code.TABLE_DIV, Code.SCALE: Code.TABLE_SCALE}
"""Operations that take a table as it is: either factor of a product, the numerator of a quotient, what a number multiplies."""


class FrequencyProgram(NamedTuple):
    """Operations (K, 5): code, target, first, second, third; ``coefficients`` are registers of polynomials, one after another.

    ``targets`` (curves,) are the places of the functions asked for; ``places`` how many there are. A table holds the same for
    all candidates; it is an operand of its own, or comes to a place first.
    """

    operations: Whole
    coefficients: Whole
    targets: Whole
    places: int


def reals(curves: Curves, targets: Sequence[Any]) -> list[Any]:
    """Return every real number that the functions asked for contain."""
    return [o for node in _needed(curves, targets) for o in curves.nodes[node][1:] if not isinstance(o, Curve)]


def _needed(curves: Curves, targets: Sequence[Any]) -> list[int]:
    needed: set[int] = set()
    pending = [target.number for target in targets if isinstance(target, Curve)]
    while pending:
        node = pending.pop()
        if node not in needed:
            needed.add(node)
            pending += [o.number for o in curves.nodes[node][1:] if isinstance(o, Curve)]
    return sorted(needed)


def program(
    curves: Curves, targets: Sequence[Curve], registers: Registers, *, tabulate: bool
) -> tuple[FrequencyProgram, list[int]]:
    """Return a program for the functions, and the nodes that it expects in its tables.

    Parameters
    ----------
    curves : Curves
    targets : sequence of Curve
    registers : Registers
        Where the real numbers are.
    tabulate : bool
        Whether functions that depend on no parameter come from tables; otherwise they are calculated like all others.
    """
    steps, tables = _steps(curves, targets, tabulate=tabulate)
    last = {node: position for position, step in enumerate(steps) for node in step.inputs}
    last.update({target.number: len(steps) for target in targets})
    free: list[int] = []
    place: dict[int, int] = {}
    places = 0
    rows: list[tuple[int, ...]] = []
    coefficients: list[int] = []
    for position, step in enumerate(steps):
        given, numbers = [place[node] for node in step.inputs], [registers.of(number) for number in step.numbers]
        if free:
            to = free.pop()
        else:
            to = places
            places += 1
        place[step.node] = to
        table = [] if step.table is None else [tables.index(step.table)]
        if step.code in (Code.POLYNOMIAL, Code.TABLE_OVER_POLYNOMIAL):
            rows.append((step.code, to, *table, len(coefficients), len(numbers)))
            coefficients += numbers
        elif step.code is Code.MUL_TABLE:
            rows.append((step.code, to, *given, *table))
        else:
            rows.append((step.code, to, *table, *given, *numbers))
        free += [place.pop(node) for node in set(step.inputs) if last[node] == position]
    return FrequencyProgram(
        operations=np.array([(*row, 0, 0)[:5] for row in rows], dtype=np.int32).reshape(-1, 5),
        coefficients=np.array(coefficients, dtype=np.int32),
        targets=np.array([place[target.number] for target in targets], dtype=np.int32),
        places=max(places, 1),
    ), tables


class _Step(NamedTuple):
    """How one function is made: of functions made before, a table, and numbers."""

    node: int
    code: Code
    inputs: tuple[int, ...]
    table: int | None
    numbers: tuple[Any, ...]


def _steps(curves: Curves, targets: Sequence[Curve], *, tabulate: bool) -> tuple[list[_Step], list[int]]:
    """Return how the functions are made, one after another, and the tables for it."""
    needed = _needed(curves, targets)
    asked = {target.number for target in targets}
    varying = [node for node in needed if curves.varies[node]] if tabulate else needed
    used = [o.number for node in varying for o in curves.nodes[node][1:] if isinstance(o, Curve)]
    tables = [node for node in needed if node not in varying and (node in asked or node in used)] if tabulate else []
    made: dict[int, _Step] = {}
    for node in varying:
        code, *operands = curves.nodes[node]
        inputs = [o.number for o in operands if isinstance(o, Curve)]
        numbers = tuple(o for o in operands if not isinstance(o, Curve))
        able = inputs if code is Code.MUL else inputs[:1] if code in _WITH_TABLE else []
        table = next((o for o in able if o in tables), None)
        if table is not None:
            inputs.remove(table)
            code = _WITH_TABLE[code]
            below = curves.nodes[inputs[0]] if code is Code.TABLE_DIV else (None,)
            if (
                below[0] is Code.POLYNOMIAL
                and used.count(inputs[0]) == 1
                and inputs[0] in made
                and inputs[0] not in asked
            ):
                code, numbers = Code.TABLE_OVER_POLYNOMIAL, made.pop(inputs[0]).numbers
                inputs = []
        made[node] = _Step(node, code, tuple(inputs), table, numbers)
    placed = asked.union(*(step.inputs for step in made.values()))
    made.update({node: _Step(node, Code.TABLE, (), node, ()) for node in tables if node in placed})
    return [made[node] for node in sorted(made)], tables


def tabulated(curves: Curves, nodes: Sequence[int], frequencies: npt.NDArray[np.float64]) -> Complex:
    """Return functions that depend on no parameter at some frequencies, (nodes, frequencies)."""
    s = 1j * frequencies
    known: dict[int, Any] = {}
    for node in _needed(curves, [Curve(curves, number) for number in nodes]):
        code, *operands = curves.nodes[node]
        x = [known[o.number] if isinstance(o, Curve) else float(o) for o in operands]
        match code:
            case Code.POLYNOMIAL:
                known[node] = np.polyval(np.array(x[::-1]), s)
            case Code.ADD | Code.SHIFT:
                known[node] = x[0] + x[1]
            case Code.SUB:
                known[node] = x[0] - x[1]
            case Code.MUL | Code.SCALE:
                known[node] = x[0] * x[1]
            case Code.DIV:
                known[node] = x[0] / x[1]
            case _:
                known[node] = -x[0]
    return np.array([known[node] + 0 * s for node in nodes], dtype=complex).reshape(len(nodes), len(frequencies))
