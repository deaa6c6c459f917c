"""Where the ratios of a loop are largest on the continuous frequency axis: the grids of a convex problem grow by these.

The exact path's scan of the loop at the present parameters brackets every summit; inside its bracket each is searched on
the exact response.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.analysis.evaluation import Evaluation
    from optimizers.convex.linear_controller import Coefficients, LinearLoop, Real
    from optimizers.problem import Vector

_GRID = 140
_BEYOND = 1e3
"""So far beyond the scan lies what stands for rest and for infinite frequency."""

_AT_REST = 1e-4
"""The frequency that stands for ω → 0, of the slowest corner: what it neglects is the square of this."""

_NEAR = 0.5
_MOST = 6
_CLOSER = 9
_ROUNDS = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class Summits:
    """The largest magnitude of each ratio, ``values`` (R,), and the frequencies (rad/s) of all summits near to it."""

    values: Real
    frequencies: Real
    stable: bool


def height(known: Coefficients, x: Vector, ratio: int) -> Real:
    """Return |N/M| of one ratio at parameter values, shape (k,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        quotient = np.abs(known.valued(known.n[:, ratio], x) / known.valued(known.m[:, ratio], x))
    return np.where(np.isnan(quotient), np.inf, quotient)


def at_rest(loop: LinearLoop) -> Real:
    """Return the frequency that stands for ω → 0, rad/s, shape (1,)."""
    return np.array([_AT_REST * loop.slowest])


def scan(loop: LinearLoop, evaluation: Evaluation) -> Real:
    """Return frequencies (rad/s, rising) fine enough that no summit hides between neighbours."""
    omega, _ = evaluation.loop(loop.open_at).response.scan
    corners = [w for ratio in loop.ratios for w in ratio.corners]
    ends = [min([omega[0], *corners]) / _BEYOND, _BEYOND * max([omega[-1], *corners])]
    between = [np.geomspace(a, b, 30) for a, b in ((ends[0], omega[0]), (omega[-1], ends[1]))]
    return np.unique(np.concatenate([omega, corners, *between]))


def grid(loop: LinearLoop, x: Vector) -> Real:
    """Return frequencies for the first convex problem: the scan, thinned."""
    omega = scan(loop, loop.evaluation(x))
    chosen = omega[np.unique(np.linspace(0, len(omega) - 1, _GRID).round().astype(int))]
    return np.unique(np.concatenate([chosen, [w for ratio in loop.ratios for w in ratio.corners]]))


def stable(loop: LinearLoop, x: Vector) -> bool:
    """Return whether the closed loop is stable at parameter values, by its exact poles."""
    return loop.evaluation(x).poles.verdict is Verdict.OK


def summits(loop: LinearLoop, x: Vector) -> Summits:
    """Return the largest magnitudes of all ratios at parameter values."""
    evaluation = loop.evaluation(x)
    omega = scan(loop, evaluation)
    known = loop.coefficients(omega)
    values = np.zeros(len(loop.ratios))
    brackets = []
    for r, ratio in enumerate(loop.ratios):
        if ratio.at_rest:
            values[r] = height(loop.coefficients(at_rest(loop)), x, r)[0]
            continue
        inside = (omega >= ratio.band[0]) & (omega <= ratio.band[1])
        brackets += _brackets(r, omega[inside], height(known.at(inside), x, r))
    tops, owners, heights = _climbed(loop, x, np.array(brackets).reshape(-1, 5))
    np.maximum.at(values, owners, heights)
    return Summits(values=values, frequencies=tops, stable=evaluation.poles.verdict is Verdict.OK)


def _brackets(ratio: int, omega: Real, heights: Real) -> list[tuple[float, ...]]:
    """Return (ratio, lower neighbour, frequency, upper neighbour, height) of the local summits near to the highest."""
    padded = np.concatenate([[-np.inf], heights, [-np.inf]])
    local = (heights >= padded[:-2]) & (heights >= padded[2:])
    tops = np.flatnonzero(local & (heights >= _NEAR * heights.max(initial=0.0)))
    tops = tops[np.argsort(heights[tops], kind="stable")[-_MOST:]]
    low, high = omega[np.maximum(tops - 1, 0)], omega[np.minimum(tops + 1, len(omega) - 1)]
    return list(zip([ratio] * len(tops), low, omega[tops], high, heights[tops], strict=True))


def _climbed(loop: LinearLoop, x: Vector, brackets: Real) -> tuple[Real, npt.NDArray[np.intp], Real]:
    """Return (frequency, ratio, height) of the summits inside their brackets."""
    owners = brackets[:, 0].astype(np.intp)
    low, at, high, best = brackets[:, 1:].T
    rows, shares = np.arange(len(owners)), np.linspace(0, 1, _CLOSER)
    for _ in range(_ROUNDS if len(owners) else 0):
        closer = low[:, None] * (high / low)[:, None] ** shares
        known = loop.coefficients(closer.ravel())
        found = np.array([height(known, x, r) for r in range(len(loop.ratios))])
        mine = found.reshape(-1, *closer.shape)[owners, rows]
        where = mine.argmax(axis=1)
        better = mine[rows, where] > best
        at, best = np.where(better, closer[rows, where], at), np.maximum(best, mine[rows, where])
        low, high = closer[rows, np.maximum(where - 1, 0)], closer[rows, np.minimum(where + 1, _CLOSER - 1)]
    return at, owners, best
