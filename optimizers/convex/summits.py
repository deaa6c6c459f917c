"""Where the ratios of a loop are largest on the continuous frequency axis: the grids of a convex problem grow by these.

The exact path's scan of the loop at the present parameters brackets every summit; inside its bracket each is searched on
the exact response.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from engine.verdicts import Verdict

if TYPE_CHECKING:
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


def scan(loop: LinearLoop, x: Vector) -> Real:
    """Return frequencies (rad/s, rising) fine enough that no summit at ``x`` hides between neighbours."""
    omega, _ = loop.evaluation(x).loop(loop.open_at).response.scan
    corners = [w for ratio in loop.ratios for w in ratio.corners]
    ends = [min([omega[0], *corners]) / _BEYOND, _BEYOND * max([omega[-1], *corners])]
    between = [np.geomspace(a, b, 30) for a, b in ((ends[0], omega[0]), (omega[-1], ends[1]))]
    return np.unique(np.concatenate([omega, corners, *between]))


def grid(loop: LinearLoop, x: Vector) -> Real:
    """Return frequencies for the first convex problem: the scan, thinned."""
    omega = scan(loop, x)
    chosen = omega[np.unique(np.linspace(0, len(omega) - 1, _GRID).round().astype(int))]
    return np.unique(np.concatenate([chosen, [w for ratio in loop.ratios for w in ratio.corners]]))


def summits(loop: LinearLoop, x: Vector) -> Summits:
    """Return the largest magnitudes of all ratios at parameter values."""
    omega = scan(loop, x)
    known = loop.coefficients(omega)
    values, frequencies = np.zeros(len(loop.ratios)), [np.zeros(0)]
    for r, ratio in enumerate(loop.ratios):
        if ratio.at_rest:
            values[r] = height(loop.coefficients(at_rest(loop)), x, r)[0]
            continue
        inside = (omega >= ratio.band[0]) & (omega <= ratio.band[1])
        tops, heights = _climbed(loop, x, r, omega[inside], height(known.at(inside), x, r))
        values[r] = heights.max(initial=0.0)
        frequencies.append(tops)
    return Summits(values=values, frequencies=np.concatenate(frequencies), stable=stable(loop, x))


def stable(loop: LinearLoop, x: Vector) -> bool:
    """Return whether the closed loop is stable at parameter values, by its exact poles."""
    return loop.evaluation(x).poles.verdict is Verdict.OK


def _climbed(loop: LinearLoop, x: Vector, ratio: int, omega: Real, heights: Real) -> tuple[Real, Real]:
    """Return (frequencies, heights) of the local summits that come near to the highest."""
    padded = np.concatenate([[-np.inf], heights, [-np.inf]])
    local = (heights >= padded[:-2]) & (heights >= padded[2:])
    tops = np.flatnonzero(local & (heights >= _NEAR * heights.max(initial=0.0)))
    tops = tops[np.argsort(heights[tops], kind="stable")[-_MOST:]]
    low, high = omega[np.maximum(tops - 1, 0)], omega[np.minimum(tops + 1, len(omega) - 1)]
    best, at = heights[tops], omega[tops]
    rows, shares = np.arange(len(tops)), np.linspace(0, 1, _CLOSER)
    for _ in range(_ROUNDS):
        closer = low[:, None] * (high / low)[:, None] ** shares
        found = height(loop.coefficients(closer.ravel()), x, ratio).reshape(closer.shape)
        where = found.argmax(axis=1)
        better = found[rows, where] > best
        at, best = np.where(better, closer[rows, where], at), np.maximum(best, found[rows, where])
        low, high = closer[rows, np.maximum(where - 1, 0)], closer[rows, np.minimum(where + 1, _CLOSER - 1)]
    return at, best
