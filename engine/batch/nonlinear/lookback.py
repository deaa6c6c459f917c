"""Where in what was marched before the delayed signals of a march are found: cubics through values and slopes of what went in.

    w(t) = z(t - τ) = h00(θ) z_j + h10(θ) H z'_j + h01(θ) z_{j+1} + h11(θ) H z'_{j+1}

All candidates have the same steps and the same delays, so that places and weights are the same for all of them. No step is longer
than a delay: what is looked up has been marched.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]

ECHOES: Final = 4
"""A kink that went through so many delays is smoother than the method sees."""
_INSIDE: Final = 1e-9
"""The end of a step looks back at what was just before, so much of a step; what jumps there comes with the next one."""
_ONE: Final = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Lookback:
    """What m delayed signals are made of on one piece of a march, at the rows of its inputs.

    ``places`` (rows, m) are slots; of that and the next one the values and slopes are weighted by ``shares`` (rows, m, 8): z, z',
    z and z' for the signal, and again for its slope. The beginnings of steps, and the end of the last, fill slots from ``first`` on.
    """

    places: npt.NDArray[np.int64]
    shares: Real
    first: int


def nowhere(rows: int, delays: int = 0) -> Lookback:
    """Return what delayed signals are made of where nothing has gone into the delays, or there are none."""
    return Lookback(places=np.zeros((rows, delays), dtype=np.int64), shares=np.zeros((rows, delays, 8)), first=0)


def echoes(breaks: Sequence[float], delays: Sequence[float], end: float) -> list[float]:
    """Return the instants before ``end`` (s) at which breaks come out of the delays, rising; those at 0 s included among the breaks."""
    found: set[float] = set()
    for generation in range(1, ECHOES + 1):
        for passed in itertools.combinations_with_replacement(delays, generation):
            found.update(t for begin in (0.0, *breaks) if (t := begin + sum(passed)) < end)
    return sorted(found)


def apart(times: Sequence[float], end: float) -> list[float]:
    """Return rising times (s) without those that are one with the one before, with 0 or with the end."""
    found = [0.0]
    for time in sorted(times):
        if found[-1] + _ONE * end < time < end * (1 - _ONE):
            found.append(time)
    return found[1:]


def lookbacks(edges: Real, steps: Sequence[int], rows: Sequence[Real], delays: Sequence[float]) -> Iterator[Lookback]:
    """Yield where each piece of a march looks back.

    Parameters
    ----------
    edges : ndarray, shape (pieces + 1,)
        s, from 0.
    steps : sequence of int
        How many each piece has.
    rows : sequence of ndarray, each (3 steps + 1,)
        When the inputs of each piece are asked for, s: at the beginning, in the middle and at the end of every step, and at the last end.
    delays : sequence of float
        s, none of them shorter than a step.
    """
    counts, lags = np.asarray(steps), np.asarray(delays)
    firsts = np.concatenate([[0], np.cumsum(counts + 1)])
    widths = np.diff(edges) / counts
    for k, times in enumerate(rows):
        past = times[:, None] - lags
        past[2::3] -= _INSIDE * widths[k]
        piece = np.clip(np.searchsorted(edges, past, side="right") - 1, 0, len(counts) - 1)
        along = (past - edges[piece]) / widths[piece]
        step = np.clip(np.floor(along).astype(np.int64), 0, counts[piece] - 1)
        shares = np.where((past >= 0.0)[..., None], _shares(along - step, widths[piece]), 0.0)
        yield Lookback(places=firsts[piece] + step, shares=shares, first=int(firsts[k]))


def _shares(theta: Real, width: Real) -> Real:
    """Return the weights of z_j, z'_j, z_{j+1} and z'_{j+1} in the cubic at ``theta``, and in its slope, (..., 8)."""
    square, cube = theta**2, theta**3
    value = (
        2 * cube - 3 * square + 1,
        width * (cube - 2 * square + theta),
        3 * square - 2 * cube,
        width * (cube - square),
    )
    rise = 6 * (square - theta)
    slope = (rise / width, 3 * square - 4 * theta + 1, -rise / width, 3 * square - 2 * theta)
    return np.stack([*value, *slope], axis=-1)
