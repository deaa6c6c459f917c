"""A piece that is shorter than those of the first level: by powers of time."""

from __future__ import annotations

from typing import Any, Final

import numpy.typing as npt

from engine.batch.linear.channels import TERMS, Channels, integrate
from engine.batch.linear.compiled import compiled
from engine.batch.linear.pieces import Pieces
from engine.batch.linear.series import NODES, PARTS, SIZE, to_series

Series = npt.NDArray[Any]

_TERMS: Final = 26


@compiled
def shorter_piece(
    pieces: Pieces, channels: Channels, m: Series, rows: Series, width: float, n: int, whole: float
) -> None:  # fmt: skip
    """Write the trial of a piece shorter than the first level's, ``whole`` (s), by powers of time, and move the state over it."""
    size, z, moved, term, nodes = m.shape[0], pieces.state, pieces.other, pieces.term, channels.nodes
    for j in range(size):
        term[0, j] = z[j]
    for k in range(1, _TERMS):
        factor = width / k
        for i in range(size):
            total = 0.0 * z[0]
            for j in range(0 if i < n else n, size):
                total = total + m[i, j] * term[k - 1, j]
            term[k, i] = total * factor
    for j in range(size):
        total = 0.0 * z[0]
        for k in range(_TERMS - 1, -1, -1):
            total = total + term[k, j]
        z[j] = total
    for r in range(rows.shape[0]):
        for k in range(_TERMS):
            total = 0.0 * z[0]
            for j in range(size):
                total = total + rows[r, j] * term[k, j]
            moved[k] = total
        for node in range(SIZE):
            theta = NODES[node] / PARTS
            total = 0.0 * z[0]
            for k in range(_TERMS - 1, -1, -1):
                total = total * theta + moved[k]
            nodes[node] = total
        to_series(nodes, pieces.trial[r])
    for j in range(channels.delays.shape[0]):
        inflow, out = channels.inflow[j], channels.integral
        for k in range(SIZE):
            out[k] = inflow[k]
            for r in range(rows.shape[0]):
                pieces.trial[r, k] += channels.through[r, j] * inflow[k]
        for k in range(SIZE, out.shape[0]):
            out[k] = 0.0 * z[0]
        for k in range(TERMS):
            integrate(out, 0.5 * width / whole)
            total = 0.0 * z[0]
            for c in range(out.shape[0]):
                total = total + out[c]
            for i in range(n):
                z[i] += channels.powers[k, i, j] * total * whole
            for r in range(rows.shape[0]):
                factor = channels.markov[k, r, j] * whole
                for c in range(SIZE):
                    pieces.trial[r, c] += factor * out[c]
