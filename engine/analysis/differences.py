"""Derivatives by differences that converge, from both sides: for what is not differentiable everywhere, or only simulated.

    D_k = (M(p + h_k) - M(p)) / h_k,  h_k = h_0 / 2^k,   extrapolated to h = 0:   D_kj = D_k,j-1 + (D_k,j-1 - D_k-1,j-1) / (2^j - 1)

The central differences of the same values, extrapolated in h², are the derivative where both sides agree on it.

References
----------
C. J. F. Ridders, "Accurate computation of F'(x) and F'(x) F''(x)", Adv. Eng. Software 4 (1982) 75-76.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]

WIDEST: Final = 1 / 64
"""The first step, in parts of the parameter's scale."""
HALVINGS: Final = 8
"""So many steps, each half of the one before; with both sides a derivative costs 16 values at most."""

_FINE = 1e-7
_ENOUGH = 1e-3
_FLOOR = 1e-6
"""What a derivative may miss: of itself, to stop halving and to count as found; of value per scale where it is 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A derivative, or None where no difference converges; ``error`` is what it is estimated to miss.

    ``one_sided`` where the two sides disagree, or there is only one: the value is then that of the rising parameter if
    there is one.
    """

    value: float | None
    error: float | None
    one_sided: bool


def derivatives(function: Callable[[float], Real], at: float, *, scale: float, base: Real) -> list[Difference]:
    """Return the derivative of every entry of a function of one number.

    Parameters
    ----------
    function : callable
        p -> values (M,), NaN for one that does not exist there.
    at : float
        Where the derivatives are wanted.
    scale : float
        Size of the parameter, > 0: the widest step is 1/64 of it.
    base : ndarray, shape (M,)
        The values at ``at``.
    """
    rising, falling = _Table(len(base), order=1), _Table(len(base), order=1)
    both = _Table(len(base), order=2)
    floor = np.abs(base) / scale
    for k in range(HALVINGS):
        above, below = at + scale * WIDEST / 2**k, at - scale * WIDEST / 2**k
        up, down = function(above), function(below)
        rising.add((up - base) / (above - at))
        falling.add((base - down) / (at - below))
        both.add((up - down) / (above - below))
        if np.all(_agree(rising, falling, floor) & both.within(_FINE, 1e-3 * _FLOOR * floor)):
            break
    same = _agree(rising, falling, floor) & both.within(_ENOUGH, _FLOOR * floor)
    sides = [table.within(_ENOUGH, _FLOOR * floor) for table in (rising, falling)]
    found = []
    for m in range(len(base)):
        table = both if same[m] else rising if sides[0][m] else falling if sides[1][m] else None
        if table is None:
            found.append(Difference(value=None, error=None, one_sided=True))
        else:
            value, error = float(table.value[m]), float(table.error[m])
            found.append(Difference(value=value, error=error, one_sided=table is not both))
    return found


def _agree(rising: _Table, falling: _Table, floor: Real) -> npt.NDArray[np.bool_]:
    """Return where the sides are the same as far as they are known, and known well enough to tell."""
    apart = np.abs(rising.value - falling.value)
    size = np.maximum(np.abs(rising.value), np.abs(falling.value))
    known = rising.within(_ENOUGH, _FLOOR * floor) & falling.within(_ENOUGH, _FLOOR * floor)
    return np.asarray(known & (apart <= 4 * (rising.error + falling.error) + _FINE * size + _FLOOR * floor))


class _Table:
    """Differences of ever smaller steps with their extrapolations in steps to the power ``order``: the best so far."""

    def __init__(self, count: int, *, order: int) -> None:
        self.value, self.error = np.full(count, np.nan), np.full(count, np.inf)
        self._order = order
        self._row: list[Real] = []

    def add(self, difference: Real) -> None:
        """Take the difference of the next step, half as wide as the last."""
        row = [difference]
        for j, before in enumerate(self._row):
            row.append(row[j] + (row[j] - before) / (2.0 ** (self._order * (j + 1)) - 1.0))
            doubt = np.maximum(np.abs(row[j + 1] - row[j]), np.abs(row[j + 1] - before))
            better = doubt < self.error  # NaN is never better
            self.value = np.where(better, row[j + 1], self.value)
            self.error = np.where(better, doubt, self.error)
        self._row = row

    def within(self, relative: float, absolute: Real) -> npt.NDArray[np.bool_]:
        """Return where the error is below a part of the value, or an absolute bound."""
        return np.asarray(self.error <= relative * np.abs(self.value) + absolute)
