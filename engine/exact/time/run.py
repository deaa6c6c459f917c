"""The growing response of a linear system with delays: segment by segment, each from the state at the end of the one before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from engine.exact.time.breaking import Apart
from engine.exact.time.chebyshev import DEGREE, NODES, differentiation_matrix, interior, weights
from engine.exact.time.curve import Curve
from engine.exact.time.equilibrium import Equilibrium
from engine.exact.time.propagate import Collocation, DelayedCollocation, Exponential, Propagator, stride
from engine.exact.time.repeated import Repeated, pieces_of

if TYPE_CHECKING:
    from engine.exact.time.origin import Origin
    from engine.model.linear_system import Array, LaneSystem
    from engine.signals import Signal

_FEW_PIECES = 4
"""So few pieces one delay ago hold nothing that the nodes of the segment that hears them could all lie beside."""
_NEAR = 0.1
"""Of its largest value: how near a state must be to where it rests."""
_NOTHING = 1e-12
"""Of the largest state: how far one may be from rest that never moved."""
_OVERLOOKED = 5e-11
"""Of the largest value so far: what may be heard between the nodes."""

Propagators: TypeAlias = dict[tuple[tuple[float, ...], int, bool], Propagator]
"""Propagators by the key of their segments, and whether commands are straight there."""


@dataclass(frozen=True)
class Segment:
    """Equal segments of the plan, one after the other: start and width of one as combinations of 1 and the delays.

    ``resting`` segments are counted from where the response goes. Delayed signals that are ``apart`` jump at the start, but move
    with other delays than it does.
    """

    start: npt.NDArray[np.float64]
    width: npt.NDArray[np.float64]
    key: tuple[tuple[float, ...], int]
    count: int = 1
    resting: bool = False
    apart: Apart | None = None

    def singles(self) -> Iterator[Segment]:
        """Yield them one by one."""
        for k in range(self.count):
            yield replace(self, start=self.start + k * self.width, count=1, apart=self.apart if k == 0 else None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """States, inputs, delayed signals, outputs and signals to be delayed on the nodes, shapes (segments, lanes, N + 1, ·).

    On segments that rest all but inputs are counted from where the response goes.
    """

    x: Array
    u: Array
    w: Array
    y: Array
    z: Array


@dataclass(kw_only=True, eq=False)
class Trajectory:
    """Inputs and outputs on the pieces of one response.

    Shapes: ``edges`` (pieces + 1, lanes); ``u`` (pieces, N + 1, lanes, inputs), ``y`` (pieces, N + 1, lanes, outputs).
    """

    edges: Array
    u: Array
    y: Array
    plan: list[Segment] = field(repr=False)
    propagators: Propagators = field(repr=False, default_factory=dict)

    def output(self, index: int) -> Curve:
        """Return output ``index`` as a curve."""
        return Curve(edges=self.edges, values=self.y[..., index])

    def input(self, index: int) -> Curve:
        """Return input ``index`` as a curve."""
        return Curve(edges=self.edges, values=self.u[..., index])


class Run:
    """The growing response: arrays of pieces, and the propagators met so far."""

    def __init__(self, system: LaneSystem, signals: Sequence[Signal], pieces: int, origin: Origin | None) -> None:
        self.s = system
        self.signals = signals
        self.lanes = system.lanes
        self.count = 0
        self._b = np.concatenate([system.b1, system.b2], axis=-1)
        self._basis = np.concatenate([np.ones((self.lanes, 1)), system.delays], axis=-1)  # (lanes, 1 + m)
        self.propagators: Propagators = {}
        self._reach: dict[Propagator, Array] = {}
        self._repeated: dict[Propagator, Repeated] = {}
        self._dtype = system.dtype
        self._loudest = np.zeros(system.m)
        self._shortest = float(system.delays[0].real.min()) if system.m else np.inf
        self.edges: Array = np.zeros((1, self.lanes))
        self.u, self.y, self.z = (
            np.zeros((0, DEGREE + 1, self.lanes, size)) for size in (system.n_in, system.n_out, system.m)
        )
        self._allocate(max(pieces, 64))
        degrees = [signal.degree() for signal in signals]
        self._steps = all(d == 0 for d in degrees)
        self._linear = all(d is not None and d <= 1 for d in degrees)
        ends = [signal.end() for signal in signals]
        self._over = max((end for end in ends if end is not None), default=0.0) if None not in ends else np.inf
        self.size = float(np.linalg.norm(system.a[0].real, 2)) if system.n else 0.0
        self._origin = origin
        self._heard: Array = np.zeros((self.lanes, system.m))
        self._moments: dict[int, Array] = {}
        self._rest: Equilibrium | None = None
        self._goes: Equilibrium | None = None
        self.state: Array = np.array(system.x0 if origin is None else system.x0 - origin.x, dtype=self._dtype)

    def _allocate(self, pieces: int) -> None:
        """Make room for so many pieces, keeping those there are."""
        shape, k = (pieces, DEGREE + 1, self.lanes), self.count
        s = self.s
        self.u, self.y, self.z = (
            _grown(old[:k], (*shape, size), self._dtype)
            for old, size in ((self.u, s.n_in), (self.y, s.n_out), (self.z, s.m))
        )
        self.edges = _grown(self.edges[: k + 1], (pieces + 1, self.lanes), self._dtype)

    def strides(self, start: float) -> bool:
        """Return whether many equal segments are computed at once: no delays, and commands that are straight from here on."""
        return not self.s.m and (self._linear or start >= self._over * (1 - 1e-12))

    def rest(self) -> tuple[Array, Array]:
        """Return states (n,), and outputs and signals to be delayed (outputs + m,), where the response goes; known once it is near."""
        assert self._goes is not None
        return self._goes.x[0].real, np.concatenate([self._goes.y[0].real, self._goes.w[0].real])

    def propagator(self, segment: Segment) -> Propagator:
        """Return what leads over a segment; kept for others of its width."""
        start, width = self._basis @ segment.start, self._basis @ segment.width
        gap, level = segment.key
        straight = self.strides(float(start[0].real))
        found = self.propagators.get((gap, level, straight))
        if found is None:
            half = self.propagators.get((gap, level + 1, straight))
            if isinstance(half, Exponential):
                found = half.doubled()
            elif straight:
                found = Exponential.of(self.s.a, self.s.b1, width)
            elif self.s.m and float(width[0].real) > self._shortest * (1 + 1e-9):
                found = DelayedCollocation(self.s, width)
            else:
                found = Collocation(self.s.a, self._b, width)
            self.propagators[gap, level, straight] = found
        return found

    def step(self, segment: Segment) -> Nodes:
        """Return what is seen on the nodes of the segments of ``segment``, from the current state."""
        s = self.s
        start, width = self._basis @ segment.start, self._basis @ segment.width
        u = self._inputs(start, width)
        if segment.resting and self._rest is None:
            self._rest = Equilibrium.of(s, u[:, 0])
            self.state = self.state - self._rest.x
        away, propagator = self._away(u), self.propagator(segment)
        if segment.count == 1:
            x, w = propagator.solve(self.state, away, self._delayed(start, width))
            u, away, x, w = u[None], away[None], x[None], w[None]
        elif not isinstance(propagator, Exponential):  # it repeats
            x, w = self._follow(propagator, width, segment.count)
            u, away = (np.broadcast_to(part, (segment.count, *part.shape)) for part in (u, away))
        else:
            change = u[:, -1] - u[:, 0]
            x = stride(propagator.maps, np.concatenate([self.state, u[:, 0], change], axis=-1), segment.count)
            away = u = u + np.arange(segment.count)[:, None, None, None] * change[:, None]
            w = np.zeros((segment.count, self.lanes, DEGREE + 1, 0))
        y = x @ s.c1.swapaxes(-1, -2) + away @ s.d11.swapaxes(-1, -2) + w @ s.d12.swapaxes(-1, -2)
        z = x @ s.c2.swapaxes(-1, -2) + away @ s.d21.swapaxes(-1, -2) + w @ s.d22.swapaxes(-1, -2)
        return Nodes(x=x, u=u, w=w, y=y, z=z)

    def repeats(self, segment: Segment) -> bool:
        """Return whether segments like one are all moved in the same way: by what came before, on pieces as wide, and by nothing else."""
        if not self.s.m or self._rest is None or segment.apart is not None:
            return False
        start, width = self._basis @ segment.start, self._basis @ segment.width
        pieces = pieces_of(self.s, width)
        if not 0 < pieces <= self.count or float(start[0].real) < self._over * (1 - 1e-12):
            return False
        last = self.edges[self.count - pieces : self.count + 1]
        apart = np.diff(last, axis=0) - width
        same = np.abs(apart.real).max() <= 1e-12 * float(np.abs(last.real).max())
        if np.iscomplexobj(apart):
            same &= np.abs(apart.imag).max() <= 1e-12 * float(np.abs(last.imag).max())
        return bool(same) and not self._away(self._inputs(start, width)).any()

    def _follow(self, propagator: Propagator, width: Array, count: int) -> tuple[Array, Array]:
        """Return states and delayed signals on the nodes of segments that repeat, (count, lanes, N + 1, ·)."""
        assert self._rest is not None
        pieces = pieces_of(self.s, width)
        if propagator not in self._repeated:
            self._repeated[propagator] = Repeated(self.s, propagator, width, pieces)
        before = self.z[self.count - pieces : self.count] - self._rest.w
        return self._repeated[propagator].follow(self.state, before, count)

    def _away(self, u: Array) -> Array:
        """Return inputs (..., lanes, N + 1, inputs) as they are counted now."""
        return u if self._rest is None else u - self._rest.u[:, None]

    def nears_rest(self, segment: Segment, largest: Array) -> bool:
        """Return whether, behind a segment, commands and states are near where they go, beside the ``largest`` (n,) states."""
        if not self.s.m or float((self._basis[0] @ segment.start).real) < self._over * (1 - 1e-12):
            return False
        if self._goes is None:
            self._goes = Equilibrium.of(self.s, self.u[self.count - 1, -1])
        return bool(
            np.all(np.abs((self.state - self._goes.x)[0].real) <= _NEAR * largest + _NOTHING * largest.max(initial=0.0))
        )

    def terms(self, segment: Segment, nodes: Nodes) -> Array:
        """Return the size of the terms that outputs, signals to be delayed and states are the sum of, shape (segments, ·).

        Those of outputs and delayed signals where only exponentials meet terms that cancel in a long segment, 0 else;
        those of states are what their rates are the sum of, over the segment or the time in which a state forgets.
        """
        propagator = self.propagator(segment)
        if not isinstance(propagator, Exponential):
            h = float((self._basis[0] @ segment.width).real)
            x, u, w = (
                np.abs(part[:, 0].real).max(axis=1, initial=0.0) for part in (nodes.x, self._away(nodes.u), nodes.w)
            )
            a = np.abs(self.s.a[0].real)
            flow = x @ a.T + np.concatenate([u, w], axis=-1) @ np.abs(self._b[0].real).T
            return np.concatenate(
                [np.zeros((segment.count, self.s.n_out + self.s.m)), h * flow / (1 + h * np.diag(a))], axis=-1
            )
        if propagator not in self._reach:
            self._reach[propagator] = np.abs(self.s.c1[0].real @ propagator.maps[0].real).max(axis=0).T
        x, u = nodes.x[:, 0, 0].real, nodes.u[:, 0]
        return np.asarray(np.abs(np.concatenate([x, u[:, 0], u[:, -1] - u[:, 0]], axis=-1)) @ self._reach[propagator])

    def overlooks(self, segment: Segment, nodes: Nodes) -> bool:
        """Return whether something between the nodes of ``segment`` is heard, which many short pieces held one delay ago."""
        if not self.s.m or not self.count:
            return False
        start, h = (float((self._basis[0] @ part).real) for part in (segment.start, segment.width))
        edges = self.edges[: self.count + 1, 0].real
        for channel, delay in enumerate(self.s.delays[0].real):
            first, last = np.searchsorted(edges, (start - delay, start - delay + h))
            if h > delay or last - first <= _FEW_PIECES:
                continue
            middles = (edges[first : last - 1] + edges[first + 1 : last]) / 2
            heard = weights((middles + delay - start) / h) @ nodes.w[0, 0, :, channel].real
            held = self.z[first : last - 1, DEGREE // 2, 0, channel].real
            if self._rest is not None:
                held = held - float(self._rest.w[0, channel].real)
            if np.abs(heard - held).max() > _OVERLOOKED * self._loudest[channel]:
                return True
        return False

    def append(self, segment: Segment, nodes: Nodes) -> None:
        """Take over the first ``segment.count`` of the segments computed."""
        k, count = self.count, segment.count
        if k + count > len(self.y):
            self._allocate(max(2 * k, k + count))
        y, z = nodes.y, nodes.z
        if self._rest is not None:
            y, z = y + self._rest.y[:, None], z + self._rest.w[:, None]
        for kept, found in ((self.u, nodes.u), (self.y, y), (self.z, z)):
            kept[k : k + count] = found[:count].swapaxes(1, 2)
        self._loudest = np.maximum(self._loudest, np.abs(z[:count, 0].real).max(axis=(0, 1), initial=0.0))
        self.state = nodes.x[count - 1, :, -1]
        self._heard = nodes.w[count - 1, :, -1]
        start, width = self._basis @ segment.start, self._basis @ segment.width
        self.edges[k : k + count + 1] = start + np.arange(count + 1)[:, None] * width
        self.count += count

    def replay(self, plan: list[Segment]) -> Trajectory:
        """Follow segments that were placed before."""
        for segment in plan:
            if segment.apart is not None and self.count:
                self._keep_apart(segment, segment.apart)
            if segment.count == 1 or not self.s.m or self.repeats(segment):
                self.append(segment, self.step(segment))
                continue
            for one in segment.singles():
                self.append(one, self.step(one))
        return self.trajectory(plan)

    def _keep_apart(self, segment: Segment, apart: Apart) -> None:
        """Let signals jump at their own instants: x misses B2 Δw times the infinitesimal by which a segment begins later.

        Signals that jump into a delay together, each at its own instant, jump out of it so: of its jump Δw only the moment
        counts, the sum of the parts times how much later each comes.
        """
        start, width = self._basis @ segment.start, self._basis @ segment.width
        jump = (self._delayed(start, width)[0, 0] - self._heard[0]).real
        moments = np.zeros((self.s.m, self._basis.shape[1]))
        for channel, later, source in apart.echoes:
            before = self._moments.get(source)
            moments[channel] = jump[channel] * later + (0.0 if before is None else before[channel])
        self._moments[apart.number] = self.s.d22[0].real @ moments
        self.state = self.state - np.einsum("lnm,mb,lb->ln", self.s.b2, moments, self._basis)

    def trajectory(self, plan: list[Segment]) -> Trajectory:
        """Return the response so far."""
        k = self.count
        return Trajectory(
            edges=self.edges[: k + 1], u=self.u[:k], y=self.y[:k], plan=plan, propagators=self.propagators
        )

    def _inputs(self, start: Array, width: Array) -> Array:
        """Return the inputs at the nodes, shape (lanes, N + 1, inputs), each end with its one-sided limit."""
        points, to_nodes = interior()
        t0, h = float(start[0].real), float(width[0].real)
        zero = 0.0 if self._origin is None else self._origin.u[:, None]
        if self._steps:  # constant between breaking points, so the nodes' own motion is not seen
            held = np.array([float(signal.value(np.array([t0 + h / 2]))[0]) for signal in self.signals])
            return np.broadcast_to(held - zero, (self.lanes, DEGREE + 1, len(held)))
        inside = t0 + h * points
        values = (
            np.stack([np.asarray(signal.value(inside), dtype=float) for signal in self.signals], axis=-1)
            if self.signals
            else np.zeros((DEGREE + 1, 0))
        )
        values = to_nodes @ values
        if self._dtype != np.complex128:
            return np.broadcast_to(values - zero, (self.lanes, *values.shape))
        # a node that moves with a delay sees the command a little earlier or later
        moved = (start[:, None] + width[:, None] * NODES) - (t0 + h * NODES)
        return np.asarray(values[None] + moved[:, :, None] * (differentiation_matrix() @ values / h)[None] - zero)

    def _delayed(self, start: Array, width: Array) -> Array:
        """Return the delayed signals at the nodes as they are counted now, shape (lanes, N + 1, m); 0 where the segment itself tells."""
        s, k = self.s, self.count
        out = self._before(start, width)
        if not s.m or not k:
            return out
        out = self._from_before(start, width, out)
        if self._rest is None:
            return out
        own = NODES[:, None] * float(width[0].real) > s.delays[0].real * (1 + 1e-9)
        return np.where(own, 0.0, out - self._rest.w[:, None])

    def _from_before(self, start: Array, width: Array, out: Array) -> Array:
        """Write what delayed signals bring from the segments so far, and return it, shape (lanes, N + 1, m)."""
        s, k = self.s, self.count
        edges = self.edges[: k + 1, 0].real
        t0, h = float(start[0].real), float(width[0].real)
        nodes = start[:, None] + width[:, None] * NODES  # (lanes, N + 1)
        echo = self._echoes(start, width)
        heard = np.flatnonzero(echo >= 0)
        out[:, :, heard] = self.z[echo[heard], :, :, heard].transpose(2, 1, 0)
        apart = np.flatnonzero(echo < 0)
        if not len(apart):
            return out
        delays = s.delays[:, apart].T  # (channels, lanes)
        past = nodes - delays[:, :, None]
        inward = (t0 + h * (NODES + 1e-9 * (0.5 - NODES))) - delays[:, :1].real
        known = (inward >= edges[0]) & (NODES * h <= delays[:, :1].real * (1 + 1e-9))
        piece = np.clip(np.searchsorted(edges, inward, side="right") - 1, 0, k - 1)  # (channels, N + 1)
        begin, end = self.edges[piece].swapaxes(1, 2), self.edges[piece + 1].swapaxes(1, 2)
        past_z = self.z[piece, :, :, apart[:, None]]
        values = np.einsum("cpjl,cjlp->cpj", weights((past - begin) / (end - begin)), past_z)
        out[:, :, apart] = np.where(known[:, None, :], values, out[:, :, apart].transpose(2, 0, 1)).transpose(1, 2, 0)
        return out

    def _before(self, start: Array, width: Array) -> Array:
        """Return what delayed signals bring from before t = 0 at the nodes, shape (lanes, N + 1, m), 0 from later on."""
        s = self.s
        heard = np.zeros((self.lanes, DEGREE + 1, s.m), dtype=self._dtype)
        if self._origin is None or not s.m:
            return heard
        nodes = float(start[0].real) + float(width[0].real) * (NODES + 1e-9 * (0.5 - NODES))
        return np.where((nodes[:, None] < s.delays[0].real)[None], -self._origin.z[:, None], heard)

    def _echoes(self, start: Array, width: Array) -> npt.NDArray[np.intp]:
        """Return, for each delay, the piece that is exactly the interval asked for, one delay ago; -1 where none is."""
        edges, h = self.edges[: self.count + 1], float(width[0].real)
        begin = (start[:, None] - self.s.delays).T  # (channels, lanes)
        piece = np.searchsorted(edges[:, 0].real, begin[:, 0].real + h / 2, side="right") - 1
        inside = (piece >= 0) & (piece < self.count)
        there = np.where(inside, piece, 0)
        apart = np.concatenate([edges[there] - begin, edges[there + 1] - begin - width], axis=1)
        same = inside & (np.abs(apart.real).max(axis=1) <= 1e-12 * h)
        if np.iscomplexobj(start):
            same &= np.abs(apart.imag).max(axis=1) <= 1e-12 * float(np.abs(start.imag).max(initial=0.0))
        return np.where(same, piece, -1)


def _grown(old: Array, shape: tuple[int, ...], dtype: type[np.float64 | np.complex128]) -> Array:
    new = np.zeros(shape, dtype=dtype)
    new[: len(old)] = old
    return new
