"""Sparse linear equations in many decimal digits, eliminated once and solved for any right-hand sides.

Each step takes the equation with the fewest unknowns left, and of these the one that the fewest other equations have
(H. Markowitz, "The elimination form of the inverse", Management Science 3 (1957) 255-269). The digits are many enough for
any pivot but one that is far smaller than another of its equation.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from typing import Final

from engine.model.errors import UnresolvedError
from engine.model.many_digits import DIGITS

_SMALL: Final = Decimal("1e-30")
"""A pivot is at least this part of the largest coefficient of its equation."""
_CANCELLED: Final = DIGITS - 60
"""What is left of two numbers that agree in so many digits is rounding."""
_MOST_COEFFICIENTS: Final = 5_000
_MOST_STEPS: Final = 200_000
_TOO_MANY: Final = "equations at rest must be fewer to be solved in many digits"


class Elimination:
    """Equations Σ_j m_ij x_j = r_i.

    Parameters
    ----------
    rows : sequence of dict
        Coefficients by the number of their unknown; as many equations as unknowns.

    Made and solved within the context of `engine.model.many_digits`.

    Raises
    ------
    UnresolvedError
        If the equations are singular, or so full that their elimination would take too long.
    """

    def __init__(self, rows: Sequence[dict[int, Decimal]]) -> None:
        self._rows = [{column: entry for column, entry in row.items() if entry} for row in rows]
        if sum(map(len, rows)) > _MOST_COEFFICIENTS:
            raise UnresolvedError(_TOO_MANY)
        self._pivots: list[tuple[int, int]] = []
        self._steps: list[tuple[int, int, Decimal]] = []
        having: list[set[int]] = [set() for _ in rows]
        for number, row in enumerate(self._rows):
            for column in row:
                having[column].add(number)
        waiting = set(range(len(self._rows)))
        done = 0
        while waiting:
            number = min(waiting, key=lambda n: len(self._rows[n]))
            row = self._rows[number]
            waiting.discard(number)
            column = self._pivot(row, having)
            self._pivots.append((number, column))
            for other in row:
                having[other].discard(number)
            done += len(row) * len(having[column])
            if done > _MOST_STEPS:
                raise UnresolvedError(_TOO_MANY)
            for target in having[column]:
                self._subtract(target, number, column, having)
            having[column].clear()

    @staticmethod
    def _pivot(row: dict[int, Decimal], having: Sequence[set[int]]) -> int:
        if not row:
            raise UnresolvedError("equations at rest must have one solution, but they are singular")
        least = _SMALL * max(map(abs, row.values()))
        return min((c for c, entry in row.items() if abs(entry) >= least), key=lambda c: len(having[c]))

    def _subtract(self, target: int, number: int, column: int, having: Sequence[set[int]]) -> None:
        """Take a multiple of an equation from another, so that the other is without an unknown."""
        row, changed = self._rows[number], self._rows[target]
        factor = changed.pop(column) / row[column]
        self._steps.append((target, number, factor))
        for other, entry in row.items():
            if other == column:
                continue
            before, taken = changed.get(other), factor * entry
            if before is None:
                changed[other] = -taken
                having[other].add(target)
                continue
            left = before - taken
            if not left or left.adjusted() < before.adjusted() - _CANCELLED:
                del changed[other]
                having[other].discard(target)
            else:
                changed[other] = left

    def solve(self, right: Sequence[Decimal]) -> list[Decimal]:
        """Return all unknowns for these right-hand sides."""
        left = list(right)
        for target, number, factor in self._steps:
            if left[number]:
                left[target] -= factor * left[number]
        found = [Decimal(0)] * len(left)
        for number, column in reversed(self._pivots):
            row, total = self._rows[number], left[number]
            for other, entry in row.items():
                if other != column and found[other]:
                    total -= entry * found[other]
            found[column] = total / row[column]
        return found

    def weights(self, unknown: int) -> list[Decimal]:
        """Return how much of each right-hand side an unknown is: its row of the inverse."""
        asked = [Decimal(0)] * len(self._rows)
        asked[unknown] = Decimal(1)
        found = [Decimal(0)] * len(self._rows)
        for number, column in self._pivots:
            if asked[column]:
                row = self._rows[number]
                found[number] = share = asked[column] / row[column]
                for other, entry in row.items():
                    if other != column:
                        asked[other] -= entry * share
        for target, number, factor in reversed(self._steps):
            if found[target]:
                found[number] -= factor * found[target]
        return found
