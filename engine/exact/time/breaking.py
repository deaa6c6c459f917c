"""Where a response jumps or kinks: at the instants of its commands, and at their echoes through the delays.

    w_i(t) = z_i(t - τ_i): what kinks in z_i at t kinks in w_i at t + τ_i, and is smoother by the integrations that follow

An instant is a combination of 1 and the delays, so that it moves with each delay as the true one does.

References
----------
A. Bellen, M. Zennaro, "Numerical Methods for Delay Differential Equations", Oxford 2003, chapters 2-3 (breaking points).
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import DEGREE

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem
    from engine.signals import Signal

_SMOOTH = DEGREE + 2
"""A jump that was integrated so often is smoother than the polynomials can see."""

_NEVER = 10**6


Echo: TypeAlias = "tuple[int, Array, int]"
"""A channel that jumps, its own instant less the common one (0, but of another motion), and the number of the one that it comes from."""


@dataclass(frozen=True)
class Apart:
    """What jumps at an instant, which has a ``number``, or at those before it that it comes from, with motions of its own."""

    number: int
    echoes: tuple[Echo, ...]


def gaps(
    system: LaneSystem, signals: Sequence[Signal], horizon: float, most: int
) -> list[tuple[Array, Array, Apart | None]] | None:
    """Return the intervals between breaking points up to ``horizon``, as combinations of 1 and the delays.

    None where there are more than ``most``: whoever cannot follow so many need not wait for the rest.
    """
    m = system.m
    basis = np.concatenate([[1.0], system.delays[0].real])
    starts = sorted({0.0, *(t for signal in signals for t in signal.breaks(horizon) if 0 <= t < horizon)})
    points: list[tuple[Array, Apart | None]] = [(np.array([t, *([0.0] * m)]), None) for t in starts]
    if m:
        echoed = _with_echoes(system, [point for point, _ in points], basis, horizon, most)
        if echoed is None:
            return None
        points = echoed
    end = np.zeros(1 + m)
    end[0] = horizon
    found: list[tuple[Array, Array, Apart | None]] = []
    for k, (a, apart) in enumerate(points):
        b = points[k + 1][0] if k + 1 < len(points) else end
        if float((b - a) @ basis) > 1e-12 * horizon:
            found.append((a, b, apart))
    return found


def _with_echoes(
    system: LaneSystem, points: list[Array], basis: npt.NDArray[np.float64], horizon: float, most: int
) -> list[tuple[Array, Apart | None]] | None:
    """Return the breaking points and those echoes of them that can be seen, sorted, coinciding ones once; None if too many."""
    m = len(basis) - 1
    grain = 1e-10 * float(basis[1:].min())
    first, onward = _integrations(system)
    audible = _audible(system.d22[0].real)
    shifts = np.eye(1 + m)[1:]
    points_at = {round(float(point @ basis) / grain): point for point in points}
    smoothness: dict[tuple[int, int], int] = {}
    front: list[tuple[float, int, int, int, int]] = []  # instant in w, channel, integrations so far, echoes, its key
    combinations: dict[int, Array] = dict(points_at)
    apart: dict[int, list[Echo]] = {}

    def send(source: int, channel: int, integrations: int, echoes: int) -> None:
        echo = combinations[source] + shifts[channel]
        instant = float(echo @ basis)
        key = round(instant / grain)
        if integrations > _SMOOTH or instant >= horizon or integrations >= smoothness.get((key, channel), _NEVER):
            return
        smoothness[key, channel] = integrations
        other = echo - combinations.setdefault(key, echo)
        if integrations == 0 and (other.any() or source in apart):
            apart.setdefault(key, []).append((channel, other, source))
        heapq.heappush(front, (instant, channel, integrations, echoes, key))

    for key in points_at:
        for channel in range(m):
            send(key, channel, int(first[channel]), 1)
    while front and len(combinations) <= most:
        _, channel, integrations, echoes, key = heapq.heappop(front)
        if integrations > smoothness[key, channel] or echoes >= audible:
            continue
        for following in range(m):
            send(key, following, integrations + int(onward[following, channel]), echoes + 1)
    if len(combinations) > most:
        return None
    told = [(point, Apart(key, tuple(apart[key])) if key in apart else None) for key, point in combinations.items()]
    return sorted(told, key=lambda one: float(one[0] @ basis))


def _integrations(system: LaneSystem) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return how many integrations lie at least between a command, shape (m,), or a delayed signal, (m, m), and each z."""
    pattern = {name: np.any(getattr(system, name) != 0, axis=0) for name in ("a", "b2", "c2", "d22", "d21", "b1", "x0")}
    driven = np.concatenate([pattern["b2"], pattern["b1"].any(axis=1, keepdims=True)], axis=1)  # (n, m + 1)
    through = np.concatenate([pattern["d22"], pattern["d21"].any(axis=1, keepdims=True)], axis=1)
    found = np.where(through, 0, _NEVER)
    reached = driven
    for count in range(1, min(system.n, _SMOOTH) + 1):
        found = np.where((found == _NEVER) & ((pattern["c2"].astype(int) @ reached.astype(int)) > 0), count, found)
        reached = reached | ((pattern["a"].astype(int) @ reached.astype(int)) > 0)
    first = found[:, -1]
    if pattern["x0"].any():  # a start off rest is a jump of what the states are seen in
        first = np.where((pattern["c2"] & pattern["x0"]).any(axis=1), 0, np.minimum(first, 1))
    return first.astype(np.int64), found[:, :-1].astype(np.int64)


def _audible(d22: npt.NDArray[np.float64]) -> int:
    """Return how many echoes matter where they pass undamped by any lag: until a jump has died away."""
    remains = float(np.abs(np.linalg.eigvals(np.abs(d22))).max(initial=0.0)) if d22.size else 0.0
    if remains == 0.0:
        return _NEVER
    return _NEVER if remains >= 1 else _SMOOTH + int(np.log(1e-14) / np.log(remains))
