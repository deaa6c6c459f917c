"""What is left of a response once its commands stand still: the distance from rest, followed by itself.

    d = x - x(∞),   d' = A d,   y - y(∞) = C d

A response is right to a part of its largest value. Where a small tail outlives everything else by decades, an integral to
its end, above all one weighted with time, hears the rounding of the value that the tail is a small part of. The distance
from rest has no such value beside it: it keeps its digits down to its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from engine.linear.rest import states_at_rest
from engine.linear.trajectory import respond

if TYPE_CHECKING:
    from engine.linear.system import Array, LaneSystem
    from engine.linear.trajectory import Trajectory
    from engine.signals import Signal


def fading(system: LaneSystem, signals: Sequence[Signal], settled: Array, begin: float, horizon: float) -> Trajectory:
    """Return how far the outputs are from where they go, on pieces from 0 (at ``begin``) to ``horizon`` - ``begin``.

    Parameters
    ----------
    system : LaneSystem
        Without delays; all its poles decay.
    signals : sequence of Signal
        One for each input, in order.
    settled : ndarray, shape (lanes, inputs)
        Their values from ``begin`` on.
    begin, horizon : float
        When the commands stand still, and the end of the response, s.
    """
    at_rest = (states_at_rest(system) @ settled[:, :, None])[:, :, 0]
    outputs = system.n_out
    free = replace(
        system, b1=system.b1[:, :, :0], d21=system.d21[:, :, :0], d11=np.zeros((system.lanes, outputs, 0)),
        x0=_state(system, signals, begin) - at_rest, inputs=(),
    )  # fmt: skip
    return respond(free, [], horizon - begin)


def _state(system: LaneSystem, signals: Sequence[Signal], instant: float) -> Array:
    """Return the state at an instant, shape (lanes, n)."""
    if instant <= 0.0:
        return system.x0
    states = tuple(f"x{k}" for k in range(system.n))
    watched = replace(
        system, c1=np.tile(np.eye(system.n), (system.lanes, 1, 1)), d12=np.zeros((system.lanes, system.n, 0)),
        d11=np.zeros((system.lanes, system.n, system.n_in)), outputs=states,
    )  # fmt: skip
    return np.asarray(respond(watched, signals, instant).y[-1, -1])
