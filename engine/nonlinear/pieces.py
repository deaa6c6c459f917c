"""The growing record of a nonlinear response: pieces on Chebyshev nodes, and what delays look back at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.linear.chebyshev import DEGREE, NODES, differentiation_matrix, interior, weights
from engine.linear.curve import Curve

if TYPE_CHECKING:
    from engine.signals import Signal

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Command:
    """The inputs on one step, as polynomials through ``values`` (17, inputs) on [``start``, ``start`` + ``width``]."""

    start: float
    width: float
    values: Real

    def at(self, theta: Real) -> tuple[Real, Real]:
        """Return values and slopes in time at ``theta`` of the step, each (len(theta), inputs)."""
        value, slope, _ = _stencil(theta.tobytes())
        return value @ self.values, slope @ self.values / self.width

    def extended(self, width: float) -> Command:
        """Return the same straight lines on another width."""
        rise = (self.values[-1] - self.values[0]) * (width / self.width)
        return Command(start=self.start, width=width, values=self.values[0] + NODES[:, None] * rise)

    def near(self, theta: Real, times: Array) -> tuple[Array, Array]:
        """Return values and slopes (lanes, N, inputs) at ``times`` (lanes, N), whose real parts lie at ``theta``."""
        values, slope = self.at(theta)
        if not np.iscomplexobj(times):
            return values[None], slope[None]
        moved = 1j * times.imag[:, :, None]
        bend = _stencil(theta.tobytes())[2] @ self.values / self.width**2
        return values + moved * slope, slope + moved * bend


@cache
def _stencil(theta: bytes) -> tuple[Real, Real, Real]:
    """Return the weights from node values to values, first and second derivatives at a few fixed points of a step."""
    value = weights(np.frombuffer(theta))
    slope = value @ differentiation_matrix()
    return value, slope, slope @ differentiation_matrix()


def command(signals: Sequence[Signal | None], start: float, width: float, constants: Real) -> Command:
    """Return what ``signals`` (None: 0) plus ``constants`` do on a step without a breakpoint inside.

    At its ends each has its one-sided limit.
    """
    points, to_nodes = interior()
    inside = start + width * points
    values = np.zeros((DEGREE + 1, len(signals)))
    for k, signal in enumerate(signals):
        if signal is None:
            continue
        degree = signal.degree()
        if degree == 0:
            values[:, k] = float(signal.value(inside[8:9])[0])
        elif degree == 1:
            first, last = (float(v) for v in signal.value(inside[[0, -1]]))
            rise = (last - first) / (points[-1] - points[0])
            values[:, k] = first + rise * (NODES - points[0])
        else:
            values[:, k] = to_nodes @ signal.value(inside)
    return Command(start=start, width=width, values=values + constants)


@dataclass(kw_only=True, eq=False)
class Record:
    """Pieces side by side: ``edges`` one more than pieces, each (lanes,); node values (17, lanes, ·) of each piece."""

    edges: list[Array]
    y: list[Array] = field(default_factory=list)
    u: list[Array] = field(default_factory=list)
    z: list[Array] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    def append(self, end: Array, y: Array, u: Array, z: Array) -> None:
        """Add a piece that ends at ``end`` (lanes,); arrays (lanes, 17, ·)."""
        if not self.times:
            self.times.append(float(self.edges[0][0].real))
        self.edges.append(end)
        self.times.append(float(end[0].real))
        self.y.append(y.swapaxes(0, 1))
        self.u.append(u.swapaxes(0, 1))
        self.z.append(z.swapaxes(0, 1))

    def extend(self, ends: Real, lanes: int, y: Array, u: Array) -> None:
        """Add pieces that end at ``ends`` (K,), without infinitesimals; arrays (lanes, K, 17, ·)."""
        for k, end in enumerate(ends):
            self.append(np.full(lanes, end), y[:, k], u[:, k], np.zeros((lanes, y.shape[2], 0)))

    def curve(self, values: list[Array], index: int) -> Curve:
        """Return one signal of all pieces."""
        lanes = len(self.edges[0])
        edges = np.array([np.broadcast_to(edge, (lanes,)) for edge in self.edges])
        return Curve(edges=edges, values=np.array([piece[:, :, index] for piece in values]))

    def delayed(self, times: Array, delays: Array, *, later: bool) -> Array:
        """Return the delayed signals w(t) = z(t - delay) at ``times`` (lanes, N); 0 before the beginning.

        At an edge the piece after it counts where ``later``, the one before it else.
        """
        lanes, count = times.shape
        m = delays.shape[-1]
        kind = complex if np.iscomplexobj(times) or np.iscomplexobj(delays) or self._lanes_complex() else float
        out = np.zeros((lanes, count, m), dtype=kind)
        if not m or not self.times:
            return out
        edges = np.asarray(self.times)
        for i in range(m):
            past = times - delays[:, i, None]
            real = past[0].real
            grain = 1e-12 * max(abs(float(edges[-1])), float(delays[0, i].real))
            known = real >= edges[0] - (grain if later else -grain)
            piece = np.clip(
                np.searchsorted(edges, real + (grain if later else -grain), side="right") - 1, 0, len(self.y) - 1
            )
            for k in np.unique(piece[known]):
                places = np.flatnonzero(known & (piece == k))
                width = self.edges[k + 1] - self.edges[k]
                theta = (past[:, places] - self.edges[k][:, None]) / width[:, None]
                inside = np.clip(theta.real, 0.0, 1.0)
                theta = inside + 1j * theta.imag if np.iscomplexobj(theta) else inside
                out[:, places, i] = np.einsum("ltj,jl->lt", weights(theta), self.z[k][:, :, i])
        return out

    def _lanes_complex(self) -> bool:
        return bool(self.z) and np.iscomplexobj(self.z[-1])
