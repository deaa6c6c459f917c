"""A path whose delays lie in no loop, as a sum of chains without delays, each of them heard later by one time.

    G(s) = Σ_k e^(-s T_k) G_k(s),    G_k = R_{0 d1} R_{d1 d2} ... R_{dm y},    T_k = τ_d1 + ... + τ_dm

R_ij is what leads from delay i to delay j without passing another one. There are finitely many such chains just where no
delay acts on itself; everything that is asked of G_k is then a closed form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING, Final

import numpy as np

from engine.exact.frequency.path import connected

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem

_MOST: Final = 64
"""Chains: parallel branches multiply, and the long sum is cheaper than so many."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """One way through a path: the sum of its delays (s), and what lies between them, without a delay of its own."""

    delay: float
    part: LaneSystem


def chains(part: LaneSystem) -> list[Chain] | None:
    """Return all ways from the input to the output of a path; None where a delay is in a loop, or for more than 64.

    Parameters
    ----------
    part : LaneSystem
        One input, one output; its first lane counts.
    """
    reached = _reached(part)
    if np.linalg.matrix_power(reached, part.m).any():
        return None
    found: list[Chain] = []
    for way in _ways(reached, part):
        if len(found) == _MOST:
            return None
        ends = [None, *way], [*way, None]
        pieces = [_between(part, source, target) for source, target in zip(*ends, strict=True)]
        found.append(Chain(delay=float(part.delays[0].real[way].sum()), part=reduce(_in_series, pieces)))
    return found


def _reached(part: LaneSystem) -> Array:
    """Return which delay (row) hears which other one (column) without one between them, (m, m) of 0 and 1."""
    a, b, c, d = (getattr(part, name)[0].real != 0 for name in ("a", "b2", "c2", "d22"))
    moved = b
    for _ in range(part.n):
        moved = moved | (a @ moved)
    return np.asarray(d | (c @ moved), dtype=np.int64)


def _ways(reached: Array, part: LaneSystem) -> Iterator[list[int]]:
    """Yield the delays of every chain, the one without a delay first."""
    open_ways: list[list[int]] = [[], *([k] for k in range(part.m))]
    while open_ways:
        way = open_ways.pop(0)
        yield way
        if way:
            open_ways += [[*way, k] for k in np.flatnonzero(reached[:, way[-1]]).tolist()]


def _between(part: LaneSystem, source: int | None, target: int | None) -> LaneSystem:
    """Return what leads from a delay (the input: None) to a delay (the output: None)."""
    b = part.b1 if source is None else part.b2[:, :, [source]]
    c = part.c1 if target is None else part.c2[:, [target]]
    through = {
        (True, True): part.d11, (False, True): part.d12, (True, False): part.d21, (False, False): part.d22,
    }[source is None, target is None]  # fmt: skip
    through = through if source is None else through[:, :, [source]]
    d = through if target is None else through[:, [target]]
    lanes = part.lanes
    without = replace(
        part, b1=b, c1=c, d11=d, b2=np.zeros((lanes, part.n, 0)), c2=np.zeros((lanes, 0, part.n)), d12=np.zeros((lanes, 1, 0)),
        d21=np.zeros((lanes, 0, 1)), d22=np.zeros((lanes, 0, 0)), delays=np.zeros((lanes, 0)), inputs=("u",), outputs=("y",),
    )  # fmt: skip
    return connected(without, [0], [0])


def _in_series(first: LaneSystem, second: LaneSystem) -> LaneSystem:
    """Return the second system behind the first."""
    upper = np.concatenate([first.a, np.zeros((first.lanes, first.n, second.n))], axis=2)
    lower = np.concatenate([second.b1 @ first.c1, second.a], axis=2)
    n, lanes = first.n + second.n, first.lanes
    return replace(
        first,
        a=np.concatenate([upper, lower], axis=1),
        b1=np.concatenate([first.b1, second.b1 @ first.d11], axis=1),
        c1=np.concatenate([second.d11 @ first.c1, second.c1], axis=2),
        d11=second.d11 @ first.d11,
        b2=np.zeros((lanes, n, 0)),
        c2=np.zeros((lanes, 0, n)),
        x0=np.concatenate([first.x0, second.x0], axis=1),
    )
