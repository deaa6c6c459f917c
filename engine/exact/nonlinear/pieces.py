"""The growing record of a nonlinear response: pieces on Chebyshev nodes, and what delays look back at."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from engine.exact.time.chebyshev import DEGREE, NODES, coefficient_matrix, differentiation_matrix, interior, weights
from engine.exact.time.curve import Curve

if TYPE_CHECKING:
    from engine.signals import Signal

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_JUMP = 1e-9
"""A change below this part of the largest value is no jump."""


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

    @property
    def resolved(self) -> bool:
        """Whether the polynomials are the inputs: their last coefficients are rounding."""
        tail = np.abs(coefficient_matrix()[-2:] @ self.values).max(axis=0, initial=0.0)
        return bool(np.all(tail <= _RESOLVED * np.abs(self.values).max(axis=0, initial=0.0)))

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


_SAME = 1e-12
_RESOLVED = 1e-12


@cache
def _stencil(theta: bytes) -> tuple[Real, Real, Real]:
    """Return the weights from node values to values, first and second derivatives at a few fixed points of a step."""
    points = np.frombuffer(theta)
    value = weights(points)
    value[points == 0], value[points == 1] = np.eye(DEGREE + 1)[[0, -1]]  # both ends are nodes
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
        if degree != 0:  # what is exactly 0 at an end is so here; where it jumps there, the limit stays
            ends = signal.value(np.array([start, start + width]))
            same = np.abs(ends - values[[0, -1], k]) <= _SAME * np.abs(values[:, k]).max()
            values[[0, -1], k] = np.where(same, ends, values[[0, -1], k])
    return Command(start=start, width=width, values=values + constants)


@dataclass(kw_only=True, eq=False)
class Record:
    """Pieces side by side: ``edges`` one more than pieces, each (lanes,); node values (17, lanes, ·) of each piece."""

    edges: list[Array]
    y: list[Array] = field(default_factory=list)
    u: list[Array] = field(default_factory=list)
    z: list[Array] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    largest: Real = field(default_factory=lambda: np.zeros(1))
    """How large each delayed signal has been, (m,)."""
    before: Array | None = None
    """What comes out of the delays that went in before the beginning, (lanes, m); None: 0."""

    def append(self, end: Array, y: Array, u: Array, z: Array) -> None:
        """Add a piece that ends at ``end`` (lanes,); arrays (lanes, 17, ·)."""
        if not self.times:
            self.times.append(float(self.edges[0][0].real))
        self.edges.append(end)
        self.times.append(float(end[0].real))
        self.y.append(y.swapaxes(0, 1))
        self.u.append(u.swapaxes(0, 1))
        self.z.append(z.swapaxes(0, 1))
        if z.shape[2]:
            self.largest = np.maximum(self.largest, np.abs(z[0].real).max(axis=0))

    def extend(self, ends: Array, y: Array, u: Array) -> None:
        """Add pieces that end at ``ends`` (K, lanes), of a system without delays; arrays (lanes, K, 17, ·)."""
        for k, end in enumerate(ends):
            self.append(end, y[:, k], u[:, k], np.zeros((len(end), y.shape[2], 0)))

    def stretch(self, moved: Real) -> None:
        """Let the last piece end later, or sooner, by infinitesimals (lanes,): its polynomials remain what they are."""
        width = self.times[-1] - self.times[-2]
        for kind in (self.y, self.u, self.z):
            slope = np.tensordot(differentiation_matrix(), kind[-1].real, axes=1) / width
            kind[-1] = kind[-1] + 1j * NODES[:, None, None] * moved[:, None] * slope
        self.edges[-1] = self.edges[-1] + 1j * moved

    def curve(self, values: list[Array], index: int) -> Curve:
        """Return one signal of all pieces."""
        return Curve(edges=np.array(self.edges), values=np.array([piece[:, :, index] for piece in values]))

    def delayed(self, times: Array, delays: Array, *, later: bool | npt.NDArray[np.bool_]) -> Array:
        """Return the delayed signals w(t) = z(t - delay), (lanes, N, m).

        Parameters
        ----------
        times : ndarray, shape (1 or lanes, N)
            Real times give the real signals alone, as one lane.
        delays : ndarray, shape (lanes, m)
        later : bool or ndarray, shape (N,)
            At an edge the piece after it counts where true, the one before it else.
        """
        whole = np.iscomplexobj(times)
        lanes = len(self.edges[0]) if whole else 1
        m = delays.shape[-1]
        out = np.zeros((lanes, times.shape[1], m), dtype=complex if whole else float)
        if self.before is not None:
            out[...] = self.before[:, None] if whole else self.before[:1, None].real
        if not m or not self.times:
            return out
        lags = delays if whole else delays[:1].real
        past = times[:, None] - lags[:, :, None]
        grain = 1e-12 * np.maximum(abs(self.times[-1]), lags[0].real)[:, None]
        beside = past[0].real + np.where(later, grain, -grain)
        last = len(self.y) - 1
        pieces = np.array([min(bisect_right(self.times, t) - 1, last) for t in beside.ravel().tolist()]).reshape(
            beside.shape
        )
        channel, place = np.nonzero(pieces >= 0)
        if not len(place):
            return out
        found = pieces[channel, place].tolist()
        z = np.array([self.z[k][:, :lanes, i] for k, i in zip(found, channel.tolist(), strict=True)])  # (P, 17, lanes)
        start, end = (np.array([self.edges[k + more][:lanes] for k in found]) for more in (0, 1))
        if not whole:
            z, start, end = z.real, start.real, end.real
        theta = (past[:, channel, place] - start.T) / (end - start).T
        inside = np.clip(theta.real, 0.0, 1.0)
        theta = inside + 1j * theta.imag if whole else inside
        out[:, place, channel] = np.einsum("lpj,pjl->lp", weights(theta), z)
        return out

    def jumps(self, time: Array, delays: Array) -> bool:
        """Return whether a delayed signal jumps at the instant ``time`` (lanes,)."""
        if not delays.shape[-1]:
            return False
        sides = self.delayed(np.repeat(time[:1, None].real, 2, axis=1), delays, later=np.array([False, True]))[0]
        return bool(np.any(np.abs(sides[1] - sides[0]) > _JUMP * self.largest))
