"""How long a response is followed: until nothing moves any more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.dc_gain import known_gain
from engine.exact.time.chebyshev import NODES
from engine.exact.time.trajectory import respond
from engine.model.errors import UnresolvedError

if TYPE_CHECKING:
    from engine.exact.time.run import Trajectory
    from engine.model.linear_system import Array, LaneSystem
    from engine.signals import Signal

Real = npt.NDArray[np.float64]

_AT_REST = 1e-13
"""Distance from the final value, relative to the largest one: nothing to follow any more."""
_ROUNDING = 1e-9
"""What rounding may leave of the largest value, even of an output whose value at rest is better known."""

_PATIENCE = 4
"""So often may a response be followed for twice as long without coming nearer to rest."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """A response to its end; ``left`` (outputs,) is how far from rest each output stays, ``largest`` its largest value.

    ``rounded`` (outputs,) says where that is no more than rounding makes of all that flows through the system at rest.
    """

    response: Trajectory
    left: Real
    largest: Real
    rounded: npt.NDArray[np.bool_]


def followed(
    part: LaneSystem, signals: Mapping[str, Signal], lifetime: float, finals: Sequence[Array | None]
) -> Followed:
    """Return the response until nothing moves any more: a lifetime, and longer where that is not enough."""
    horizon, rest, stalled = _horizon(part, signals, lifetime), np.full(len(finals), np.inf), 0
    longest: Followed | None = None
    if any(final is None for final in finals):
        found = respond(part, list(signals.values()), horizon)
        none = np.zeros(len(finals))
        return Followed(response=found, left=none, largest=none, rounded=none == 0)
    known = known_gain(part)[1] @ np.abs([float(signal.final() or 0.0) for signal in signals.values()])
    while True:
        try:
            found = respond(part, list(signals.values()), horizon)
        except UnresolvedError:
            if longest is None:
                raise
            return longest
        left, largest = _remainder(found, np.array([final[0].real for final in finals if final is not None]))
        stays = left > 0.5 * rest
        # what does not shrink any more is rounding, where rounding makes as much of what flows through the system
        rounded = (left <= _AT_REST * largest) | (stays & (left < np.maximum(known, _ROUNDING * largest)))
        longest = Followed(response=found, left=left, largest=largest, rounded=rounded)
        stalled += bool(np.all(stays | rounded))
        if rounded.all() or stalled == _PATIENCE:
            return longest
        horizon, rest = 2 * horizon, left


def _remainder(found: Trajectory, finals: Real) -> tuple[Real, Real]:
    """Return how far each output is from its final value in the last twentieth, and its largest value."""
    edges = found.edges[:, 0].real
    late = edges[:-1, None] + NODES * np.diff(edges)[:, None] >= 0.95 * edges[-1]
    y = found.y[:, :, 0].real
    away = np.abs(y[late] - finals).max(axis=0)
    return away, np.maximum(np.abs(y).max(axis=(0, 1)), 1e-300)


def _horizon(system: LaneSystem, signals: Mapping[str, Signal], lifetime: float) -> float:
    """Return when nothing moves any more, s."""
    last = max((t for signal in signals.values() for t in (*signal.breakpoints(), signal.end() or 0.0)), default=0.0)
    delays = float(system.delays[0].real.sum()) if system.m else 0.0
    periods = max((signal.repeats_after() or 0.0 for signal in signals.values()), default=0.0)
    horizon = last + delays + lifetime + 3 * periods
    return horizon if horizon > last else last + 1.0
