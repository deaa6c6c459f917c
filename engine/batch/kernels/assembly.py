"""The closed loop as formulas: the interconnection of traced blocks, solved sparsely and once for all parameter values.

Rows are dictionaries from column to number; columns are states, then external signals, then delay channels, as in
`engine.diagram.realize`. Pivots that are plain numbers come first, so that a formula is divided by only where it must be.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from engine.diagram.realize import Term

if TYPE_CHECKING:
    from engine.diagram.diagram import TracedDiagram
    from engine.diagram.realize import Loop, Wiring

Row = dict[int, Any]

_PLAIN: Final = (int, float)


def add(row: Row, column: int, value: Any) -> None:
    """Add a number to an entry of a row; what becomes 0 goes."""
    total = row[column] + value if column in row else value
    if is_zero(total):
        row.pop(column, None)
    else:
        row[column] = total


def is_zero(value: Any) -> bool:
    """Whether a number is 0 whatever the parameters are."""
    return isinstance(value, _PLAIN) and value == 0


def add_scaled(row: Row, other: Mapping[int, Any], factor: Any) -> None:
    """Add a multiple of another row."""
    for column, value in other.items():
        add(row, column, factor * value)


class Cost(Protocol):
    """How unwelcome a number is as a pivot: plain numbers cost least."""

    def __call__(self, value: Any) -> float: ...  # noqa: D102 - the class says it


def solve(rows: Sequence[Row], right: Sequence[Row], cost: Cost, seen: Callable[[Any], None]) -> list[Row]:
    """Return x of (rows) x = (right) by sparse elimination, the cheapest pivot first.

    Parameters
    ----------
    rows : sequence of dict
        A square matrix, column number -> entry.
    right : sequence of dict
        Right-hand sides, one dictionary for each row.
    cost : Cost
    seen : callable
        Told every pivot that is divided by.
    """
    rows, right = [dict(row) for row in rows], [dict(row) for row in right]
    left = set(range(len(rows)))
    solution: list[Row] = [{} for _ in rows]
    order: list[tuple[int, int]] = []
    while left:
        # no row that is left has a column that was eliminated
        costs = {i: {j: cost(value) for j, value in rows[i].items()} for i in left}
        users: dict[int, list[int]] = {}
        for i in left:
            for j in rows[i]:
                users.setdefault(j, []).append(i)
        best: tuple[float, int, int] | None = None
        for i, own in costs.items():
            along = sum(own.values()) + sum(cost(entry) for entry in right[i].values())
            for j, here in own.items():
                price = here + (len(users[j]) - 1) * (len(own) - 1)
                # a product of two numbers of the same kind now is one product less for every candidate
                price += 0.01 * along
                price += 0.01 * sum(costs[k][j] for k in users[j] if k != i)
                rank = (price, i, j)
                if best is None or rank < best:
                    best = rank
        if best is None:
            raise ZeroDivisionError
        _, i, j = best
        pivot = rows[i].pop(j)
        if not (isinstance(pivot, float) and pivot == 1.0):
            seen(pivot)
            inverse = 1.0 / pivot
            rows[i] = {k: inverse * value for k, value in rows[i].items()}
            right[i] = {k: inverse * value for k, value in right[i].items()}
        for k in range(len(rows)):
            if k != i and j in rows[k]:
                factor = -rows[k].pop(j)
                add_scaled(rows[k], rows[i], factor)
                add_scaled(right[k], right[i], factor)
        left.remove(i)
        order.append((i, j))
    for i, j in order:
        solution[j] = right[i]
    return solution


@dataclass(kw_only=True, eq=False)
class Assembly:
    """One wiring of a traced diagram: what drives every state, what goes into the delays, and the signals that are read.

    Attributes
    ----------
    states, externals : int
        How many there are; the columns of all rows in that order, delayed signals behind them.
    flow : list of dict
        x' as rows.
    reads : list of dict
        The outputs of the wiring as rows.
    entering, delays : list
        What goes into the delays as rows, and how long each is, s.
    pivots : list
        What was divided by, on the way through algebraic loops.
    """

    states: int
    externals: int
    flow: list[Row]
    reads: list[Row]
    pivots: list[Any] = field(default_factory=list)
    entering: list[Row] = field(default_factory=list)
    delays: list[Any] = field(default_factory=list)

    @classmethod
    def of(cls, traced: TracedDiagram, wiring: Wiring) -> Assembly:
        """Connect the blocks.

        Raises
        ------
        ZeroDivisionError
            If an algebraic loop has no solution whatever the parameters are.
        """
        blocks, interconnection = traced.realizations, traced.interconnection
        firsts = np.cumsum([0, *(block.a.shape[-1] for block in blocks)]).tolist()
        states, externals = firsts[-1], len(wiring.inputs)
        signals = [
            _entries(block.c[i], first)
            for block, first in zip(blocks, firsts, strict=False)
            for i in range(block.d.shape[-2])
        ]
        signals += [{states + k: 1.0} for k in range(externals)]
        signals.append({})
        made = cls(states=states, externals=externals, flow=[], reads=[])
        made.delays = [length for block in blocks for length in block.delays.tolist()]
        heard = states + externals
        for block, flat in zip(blocks, interconnection.blocks, strict=True):
            if block.d12 is not None:
                for i, row in enumerate(block.d12):
                    signals[flat.first_output + i].update(_entries(row, heard))
            heard += block.delays.shape[-1]
        for step in interconnection.order(blocks, wiring):
            if isinstance(step, Term):
                add_scaled(signals[step.row], signals[step.source], blocks[step.block].d[step.i, step.j])
            else:
                made._close(step, traced, signals)
        for number, (block, first) in enumerate(zip(blocks, firsts, strict=False)):
            sources = interconnection.sources_of(number, wiring)
            for i in range(block.a.shape[-1]):
                row = _entries(block.a[i], first)
                for j, source in enumerate(sources):
                    if not is_zero(block.b[i, j]):
                        add_scaled(row, signals[source], block.b[i, j])
                made.flow.append(row)
            for line in () if block.d21 is None else block.d21:
                made.entering.append({})
                for factor, source in zip(line.tolist(), sources, strict=True):
                    if not is_zero(factor):
                        add_scaled(made.entering[-1], signals[source], factor)
        made.reads = [signals[read] for read in wiring.reads]
        return made

    def _close(self, loop: Loop, traced: TracedDiagram, signals: list[Row]) -> None:
        """Solve the rows of an algebraic loop."""
        place = {row: k for k, row in enumerate(loop.rows)}
        for term in loop.outer:
            add_scaled(signals[term.row], signals[term.source], traced.realizations[term.block].d[term.i, term.j])
        equations: list[Row] = [{k: 1.0} for k in range(len(place))]
        for term in loop.inner:
            add(equations[place[term.row]], place[term.source], -traced.realizations[term.block].d[term.i, term.j])
        solved = solve(equations, [signals[row] for row in loop.rows], _real_cost, self.pivots.append)
        for row, found in zip(loop.rows, solved, strict=True):
            signals[row] = found


def _real_cost(value: Any) -> float:
    """Plain numbers before formulas, large before small: a small one may vanish at other parameter values."""
    size = abs(float(value.real))
    return (0.0 if isinstance(value, int | float) else 100.0) + (np.inf if size < 1e-9 else 0.0)


def _entries(row: Any, offset: int) -> Row:
    return {offset + k: value for k, value in enumerate(row.tolist()) if not is_zero(value)}
