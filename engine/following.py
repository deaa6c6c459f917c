"""How long a response is followed: until nothing moves any more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from engine.errors import UnresolvedError
from engine.linear.chebyshev import NODES
from engine.linear.trajectory import respond

if TYPE_CHECKING:
    from engine.linear.system import Array, LaneSystem
    from engine.linear.trajectory import Trajectory
    from engine.signals import Signal

_AT_REST = 1e-13
_ROUNDING = 1e-9
"""Relative distances from the final value: nothing to follow any more, and what rounding may leave at most."""

_PATIENCE = 4
"""So often may a response be followed for twice as long without coming nearer to rest."""


def followed(
    part: LaneSystem, signals: Mapping[str, Signal], lifetime: float, finals: Sequence[Array | None]
) -> Trajectory:
    """Return the response until nothing moves any more: a lifetime, and longer where that is not enough."""
    horizon, rest, stalled = _horizon(part, signals, lifetime), np.inf, 0
    while True:
        found = respond(part, list(signals.values()), horizon)
        if any(final is None for final in finals):
            return found
        last = _remainder(found, np.array([final[0].real for final in finals if final is not None]))
        stays = last > 0.5 * rest
        # what does not shrink any more is rounding
        if last <= _AT_REST or (last < _ROUNDING and stays):
            return found
        stalled += stays
        if stalled == _PATIENCE:
            raise UnresolvedError(
                f"a response must settle within {_ROUNDING:g} of its largest value, but rounding leaves {last:.2g}: "
                "its time constants or its gains lie too far apart"
            )
        horizon, rest = 2 * horizon, last


def _remainder(found: Trajectory, finals: npt.NDArray[np.float64]) -> float:
    """Return how far the outputs are from their final values in the last twentieth, relative to their largest values."""
    edges = found.edges[:, 0].real
    late = edges[:-1, None] + NODES * np.diff(edges)[:, None] >= 0.95 * edges[-1]
    y = found.y[:, :, 0].real
    largest = np.abs(y).max(axis=(0, 1))
    away = np.abs(y[late] - finals).max(axis=0)
    return float(np.max(away / np.maximum(largest, 1e-300), initial=0.0))


def _horizon(system: LaneSystem, signals: Mapping[str, Signal], lifetime: float) -> float:
    """Return when nothing moves any more, s."""
    last = max((t for signal in signals.values() for t in (*signal.breakpoints(), signal.end() or 0.0)), default=0.0)
    delays = float(system.delays[0].real.sum()) if system.m else 0.0
    periods = max((signal.repeats_after() or 0.0 for signal in signals.values()), default=0.0)
    horizon = last + delays + lifetime + 3 * periods
    return horizon if horizon > last else last + 1.0
