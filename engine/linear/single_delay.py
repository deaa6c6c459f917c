"""Step response of a path with one delay, fast: the delay is cut into equal segments and every segment is the same map.

    (x_end, z, y)_k = L (x_end_{k-1}, z_{k-q}) + l,    q segments to one delay, z and y at the Chebyshev nodes

The delayed signal of a segment is that of q segments earlier at the same nodes: nothing is searched or interpolated, and
one matrix product advances the response. It gives what :func:`engine.linear.trajectory.respond` gives, for one delay.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from engine.errors import EngineError
from engine.linear.chebyshev import DEGREE, tail
from engine.linear.curve import Curve
from engine.linear.propagate import Collocation

if TYPE_CHECKING:
    from engine.linear.system import Array, LaneSystem

RESOLUTION = 1e-12
"""What the last Chebyshev coefficients of a segment may be, relative to the largest value of the response."""

MAX_SEGMENTS = 50_000

_REACH = 4.0
"""|λ| h up to which a polynomial of degree 16 holds e^{λt} over a segment h to 1e-13."""


def step_response(system: LaneSystem, horizon: float) -> Curve:
    """Return the unit step response from rest of a path with one input, one output and one delay.

    Parameters
    ----------
    system : LaneSystem
    horizon : float
        Least length of the response in s.

    Raises
    ------
    EngineError
        When the delay is so short against the horizon, or the response so stiff against the delay, that more than
        50 000 segments would be needed.
    """
    system = system.balanced() if system.n else system
    delay = float(system.delays[0, 0].real)
    fastest = float(np.abs(np.linalg.eigvals(system.a[0].real)).max()) if system.n else 0.0
    parts = max(1, int(np.ceil(fastest * delay / _REACH)))
    while True:
        if horizon / delay * parts > MAX_SEGMENTS:
            raise EngineError(
                f"delay must be long enough to follow over {horizon:.3g} s (in {MAX_SEGMENTS} segments), got {delay:.3g} s"
            )
        curve = _march(system, parts, int(np.ceil(horizon / delay * parts * (1 + 1e-12))))
        values = curve.values[:, :, :1].real
        if float(tail(np.moveaxis(values, 1, 0)).max()) <= RESOLUTION * float(np.abs(values).max(initial=1e-300)):
            return curve
        parts *= 2


def _march(system: LaneSystem, parts: int, segments: int) -> Curve:
    """Return the response on ``segments`` segments, ``parts`` of them to a delay."""
    nodes, n, lanes = DEGREE + 1, system.n, system.lanes
    width = system.delays[:, 0] / parts
    advance, constant = _segment_map(system, width)
    result = np.zeros((segments, lanes, n + 2 * nodes), dtype=constant.dtype)
    last = np.zeros((lanes, n + nodes), dtype=constant.dtype)
    for k in range(segments):
        if k:
            last[:, :n] = result[k - 1, :, :n]
        if k >= parts:
            last[:, n:] = result[k - parts, :, n : n + nodes]
        result[k] = (advance @ last[:, :, None])[:, :, 0] + constant
    edges = np.arange(segments + 1)[:, None] * width
    return Curve(edges=edges, values=result[:, :, n + nodes :].swapaxes(1, 2))


def _segment_map(system: LaneSystem, width: Array) -> tuple[Array, Array]:
    """Return L and l: shapes (lanes, n + 2 (N + 1), n + N + 1) and (lanes, n + 2 (N + 1))."""
    nodes, n, lanes = DEGREE + 1, system.n, system.lanes
    propagator = Collocation(system.a, np.concatenate([system.b1, system.b2], axis=-1), width)

    def through(x0: Array, u: Array, w: Array) -> Array:
        x = propagator.states(x0, np.stack([u, w], axis=-1))
        z = x @ system.c2[:, 0, :, None] + (u * system.d21[:, 0] + w * system.d22[:, 0])[..., None]
        y = x @ system.c1[:, 0, :, None] + (u * system.d11[:, 0] + w * system.d12[:, 0])[..., None]
        return np.concatenate([x[:, -1], z[..., 0], y[..., 0]], axis=-1)

    nothing = np.zeros((lanes, nodes))
    columns = [through(np.broadcast_to(unit, (lanes, n)), nothing, nothing) for unit in np.eye(n)]
    columns += [through(np.zeros((lanes, n)), nothing, np.broadcast_to(unit, (lanes, nodes))) for unit in np.eye(nodes)]
    return np.stack(columns, axis=-1), through(np.zeros((lanes, n)), np.ones((lanes, nodes)), nothing)
