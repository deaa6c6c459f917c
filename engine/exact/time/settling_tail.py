"""What is left of a response once its commands stand still: the distance from rest, followed by itself.

    d = x - x(∞),   d' = A d + B2 v,   v_i(t) = z_i(t - τ_i) - z_i(∞),   y - y(∞) = C1 d + D12 v

Before t = 0 the delays heard 0, so that they bring -z(∞) until then.

A response is right to a part of its largest value. Where a small tail outlives everything else by decades, an integral to
its end, above all one weighted with time, hears the rounding of the value that the tail is a small part of. The distance
from rest has no such value beside it: it keeps its digits down to its end.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from engine.exact.frequency.dc_gain import states_at_rest
from engine.exact.time.origin import Origin
from engine.exact.time.trajectory import respond

if TYPE_CHECKING:
    from engine.exact.time.run import Trajectory
    from engine.model.linear_system import Array, LaneSystem
    from engine.signals import Signal


def fading(system: LaneSystem, signals: Sequence[Signal], settled: Array, response: Trajectory) -> Trajectory:
    """Return how far inputs and outputs are from where they go, on the pieces of their response.

    Parameters
    ----------
    system : LaneSystem
        All its poles decay.
    signals : sequence of Signal
        One for each input, in order.
    settled : ndarray, shape (1 or lanes, inputs)
        Where they go.
    response : Trajectory
        Of this system to these signals.
    """
    at_rest = (states_at_rest(system) @ settled[:, :, None])[:, :, 0]
    x, w = np.split(at_rest, [system.n], axis=1)  # at rest what comes out of a delay is what goes into it
    origin, horizon = Origin(x=x, u=settled, z=w), float(response.edges[-1, 0].real)
    return respond(system, signals, horizon, plan=response.plan, propagators=response.propagators, origin=origin)
