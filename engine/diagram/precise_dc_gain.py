"""Gains at rest in many digits, from the equations of the blocks as they stand: what double precision cannot tell.

    s x = A x + B u,   y = C x + D u + K s x + D12 w,   w_k = e^{-s τ_k} (D21 u)_k,   every u another y, an input or 0

The equations are solved as they are: no signal is put into another, so that no coefficient is a sum of others. At s itself
0 an integral that the path does not see would make them singular; at two values of s beside 0, by `_NEARER` apart, a gain
that exists is the same, one that an integral makes grows, and one that is 0 falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, localcontext
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.elimination import Elimination
from engine.model.errors import UnresolvedError
from engine.model.many_digits import CONTEXT, Formulas, Slopes, times

if TYPE_CHECKING:
    from engine.diagram.realize import Interconnection, Wiring
    from engine.elements import Realization

_BESIDE: Final = Decimal("1e-70")
_NEARER: Final = Decimal("1e-3")
_APART: Final = 30
"""Gains at both that differ by more than this, in ratio, are in no rest."""
_USUAL: Final = Decimal("1e10")
"""A gain between this and its inverse so near to rest is at rest: no integral and no derivative is so weak, or so strong."""


class ExactRest:
    """Gains at rest of connected blocks.

    Parameters
    ----------
    realizations : sequence of Realization
        Blocks whose coefficients are numbers or formulas.
    formulas : Formulas
        The formulas' values and slopes.
    interconnection, wiring
        How the blocks are connected.
    lanes : int
        How many slopes each gain has.

    Raises
    ------
    UnresolvedError
        If the equations are singular, or too many.
    """

    def __init__(
        self,
        realizations: Sequence[Realization],
        formulas: Formulas,
        interconnection: Interconnection,
        wiring: Wiring,
        lanes: int,
    ) -> None:
        self._lanes = lanes
        self._given = realizations, formulas, interconnection, wiring
        with localcontext(CONTEXT):
            self._far = _Equations(*self._given, _BESIDE)

    def gain(self, source: int, read: int) -> tuple[float, npt.NDArray[np.float64]] | None:
        """Return the gain from an input to an output and its slope along each lane; None where it grows without bound.

        Raises
        ------
        UnresolvedError
            If a slope grows without bound.
        """
        with localcontext(CONTEXT):
            value, slopes = self._far.gain(source, read, self._lanes)
            if not self._lanes and (not value or 1 / _USUAL < abs(value) < _USUAL):
                return float(value), np.zeros(0)
            nearer, own = self._near.gain(source, read, self._lanes)
            found = _limit(value, nearer)
            limits = [_limit(first, second) for first, second in zip(slopes, own, strict=True)]
        if found is None:
            return None
        if any(limit is None for limit in limits):
            raise UnresolvedError("a gain at rest must have a derivative, but it grows without bound")
        return found, np.array(limits, dtype=np.float64)

    @cached_property
    def _near(self) -> _Equations:
        return _Equations(*self._given, _BESIDE * _NEARER)

    def sensitivity(self, source: int, read: int) -> float:
        """Return what a change of each lane by 1 changes of the gain beside rest, relative to it, all together."""
        with localcontext(CONTEXT):
            value, slopes = self._far.gain(source, read, self._lanes)
            return float(sum(map(abs, slopes)) / abs(value)) if value else 0.0


def _limit(value: Decimal, nearer: Decimal) -> float | None:
    """Return where a quantity goes as s goes to 0; None where it grows."""
    if not nearer or abs(value) > _APART * abs(nearer):
        return 0.0
    return float(value) if abs(nearer) <= _APART * abs(value) else None


class _Equations:
    """The equations of all states and outputs at one s, eliminated; unknowns are the states, then the outputs."""

    def __init__(
        self,
        realizations: Sequence[Realization],
        formulas: Formulas,
        interconnection: Interconnection,
        wiring: Wiring,
        s: Decimal,
    ) -> None:
        self._formulas, self._wiring, self._s = formulas, wiring, s
        self._states = sum(r.a.shape[-1] for r in realizations)
        self._outputs = interconnection.outputs
        size = self._states + self._outputs
        self._rows: list[dict[int, Decimal]] = [{} for _ in range(size)]
        self._slopes: list[tuple[int, int, Slopes]] = []
        """Row, column and slopes; an input's column is ``size`` and its number."""
        self._driven: list[dict[int, Decimal]] = [{} for _ in range(size)]
        first = 0
        for block, realization in zip(interconnection.blocks, realizations, strict=True):
            x = range(first, first := first + realization.a.shape[-1])
            y = range(self._states + block.first_output, self._states + block.first_output + len(block.ports.outputs))
            u = wiring.sources[block.first_input : block.first_input + len(block.ports.inputs)]
            self._add(realization, x, y, [self._column(source) for source in u])
        self._elimination = Elimination(self._rows)

    def _column(self, source: int) -> int | None:
        """Return where a signal is among the unknowns and the inputs behind them; None for the one that is always 0."""
        return self._states + source if source < self._outputs + len(self._wiring.inputs) else None

    def _add(self, r: Realization, x: range, y: range, u: Sequence[int | None]) -> None:
        for row in x:
            self._put(row, row, self._s)
        for row in y:
            self._put(row, row, Decimal(1))
        read = r if r.reading is None else r.reading
        self._put_all(x, x, r.a)
        self._put_all(x, u, r.b)
        self._put_all(y, x, read.c)
        self._put_all(y, u, read.d)
        if r.reading is not None:
            self._put_all(y, x, r.reading.k, share=self._s)
        if r.d12 is not None and r.d21 is not None:
            for k, delay in enumerate(r.delays):
                self._put_late(y, u, r.d12[:, k], r.d21[k], delay)

    def _put_all(self, rows: range, columns: Sequence[int | None], array: Any, share: Decimal | None = None) -> None:
        """Put what drives some signals into their equations, on the side of the signals."""
        for i, row in enumerate(rows):
            for j, column in enumerate(columns):
                entry = array[i, j]
                if column is not None and not (isinstance(entry, float) and entry == 0.0):
                    value, slopes = self._formulas.of(entry)
                    factor = Decimal(-1) if share is None else -share
                    self._put(row, column, factor * value, times(factor, slopes))

    def _put_late(self, rows: range, columns: Sequence[int | None], out: Any, into: Any, delay: Any) -> None:
        """Put a delayed signal into the equations of the outputs that it is a part of."""
        length, stretched = self._formulas.of(delay)
        late = (-self._s * length).exp()
        later = times(-self._s * late, stretched)
        for i, row in enumerate(rows):
            leaving, left = self._formulas.of(out[i])
            for j, column in enumerate(columns):
                entering, entered = self._formulas.of(into[j])
                if column is not None and leaving and entering:
                    through = leaving * entering
                    self._put(row, column, -through * late, times(-through, later))
                    for slopes, other in ((left, entering), (entered, leaving)):
                        self._put(row, column, Decimal(0), times(-other * late, slopes))

    def _put(self, row: int, column: int, value: Decimal, slopes: Slopes | None = None) -> None:
        size = len(self._rows)
        place, entry = (self._rows, value) if column < size else (self._driven, -value)
        column_there = column if column < size else column - size
        if entry:
            place[row][column_there] = place[row].get(column_there, 0) + entry
        if slopes:
            self._slopes.append((row, column, slopes))

    def gain(self, source: int, read: int, lanes: int) -> tuple[Decimal, list[Decimal]]:
        """Return the gain from an input to an output, and its slopes."""
        size, column = len(self._rows), self._column(self._wiring.reads[read])
        moved = [Decimal(0)] * lanes
        if column is None or column >= size:
            return Decimal(int(column is not None and column - size == source)), moved
        solved = self._elimination.solve([driven.get(source, Decimal(0)) for driven in self._driven])
        if lanes:
            weights = self._elimination.weights(column)
            for row, at, slopes in self._slopes:
                if weights[row] and (at < size or at - size == source):
                    share = weights[row] * solved[at] if at < size else weights[row]
                    for lane, slope in slopes.items():
                        moved[lane] -= share * slope
        return solved[column], moved
