"""How a response moves with a parameter of its command: a delay, a velocity, the frequency that a shaper is made for.

    y = G u(t, p)   =>   ∂y/∂p = G ∂u/∂p,   ∂u/∂p = u_p(t) - Σ_b J_b (dt_b/dp) δ(t - t_b)

u_p is the derivative between the instants t_b at which the command breaks, by an infinitesimal in its parameter; where it
jumps there by J_b, the moving jump adds an impulse, whose response is the slope of that to a step. Pieces that end where
the command breaks move with it. So a command's parameter is a lane like any other, and every metric has its derivative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from engine.exact.time.chebyshev import NODES, differentiation_matrix
from engine.exact.time.run import Trajectory
from engine.exact.time.trajectory import respond
from engine.model.errors import SignalError
from engine.model.tangent import INFINITESIMAL
from engine.signals import Signal

if TYPE_CHECKING:
    from engine.model.linear_system import Array, LaneSystem
    from engine.model.parameters import Param
    from engine.signals._base import FloatArray

_BESIDE = 1e-12
"""A jump is the difference over this part of the command's time span."""

_JUMP = 1e-9
"""What is less than this part of the command is no jump."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CommandParameter:
    """One number of a command, to be varied: ``delay``, or ``command.max_velocity`` of the command inside.

    The command is meant by identity: two experiments may have equal ones and vary only one of them.

    Raises
    ------
    SignalError
        If the path leads to no number.
    """

    signal: Signal
    path: str

    def __post_init__(self) -> None:
        _declared(*self._place())

    def _place(self) -> tuple[Signal, str]:
        """Return the command that has the number, and the number's name there."""
        *inside, name = self.path.split(".")
        holder: Any = self.signal
        for part in inside:
            holder = getattr(holder, part, None)
            if not isinstance(holder, Signal):
                msg = f"{part} must be a command inside {self.signal.kind}, got '{self.path}'"
                raise SignalError(msg, at=(self.path,))
        return holder, name

    @property
    def param(self) -> Param:
        """What is known of the number: unit, bounds, scale."""
        return _declared(*self._place())

    @property
    def value(self) -> float:
        """The number, SI."""
        holder, name = self._place()
        return float(getattr(holder, name))

    @property
    def scale(self) -> float:
        """What its infinitesimal is relative to."""
        return abs(self.value) or 1.0

    def perturbed(self) -> Signal:
        """Return the command with an infinitesimal in this number."""
        return _perturbed(self.signal, self.path, 1j * INFINITESIMAL * self.scale)


def _declared(holder: Signal, name: str) -> Param:
    numbers = {param.name: param for param in holder.parameters if param.shape == "scalar"}
    if name not in numbers:
        msg = f"parameter of {holder.kind} must be one of {', '.join(numbers) or '(none)'}, got '{name}'"
        raise SignalError(msg, at=(name,))
    return numbers[name]


def _perturbed(signal: Signal, path: str, step: complex) -> Signal:
    name, _, rest = path.partition(".")
    values = {param.name: getattr(signal, param.name) for param in signal.parameters}
    values[name] = _perturbed(values[name], rest, step) if rest else values[name] + step
    return signal.of(values)


@dataclass(frozen=True, kw_only=True)
class Motions:
    """The commands of a response and which of their numbers are lanes."""

    signals: Mapping[str, Signal]
    lanes: tuple[CommandParameter, ...]

    def finals(self) -> Array:
        """Return where the commands settle, shape (lanes, inputs); 0 for one that does not."""
        rows = [[_final(signal) for signal in row] for row in self._rows()]
        return np.array(rows, dtype=np.complex128).reshape(len(self.lanes), len(self.signals))

    def start(self) -> Array:
        """Return when the first of the commands begins, shape (lanes,)."""
        firsts = [min((s.breakpoints()[0] for s in row), key=lambda t: t.real) for row in self._rows()]
        return np.array(firsts, dtype=np.complex128)

    def last_start(self) -> Array:
        """Return when the last of the commands begins, shape (lanes,)."""
        lasts = [max((s.breakpoints()[0] for s in row), key=lambda t: t.real) for row in self._rows()]
        return np.array(lasts, dtype=np.complex128)

    def end(self) -> Array | None:
        """Return when the last of the commands ends, shape (lanes,); None when one goes on for ever."""
        rows = [[signal.end() for signal in row] for row in self._rows()]
        if any(end is None for row in rows for end in row):
            return None
        return np.array(
            [max((end for end in row if end is not None), key=lambda t: t.real) for row in rows], dtype=np.complex128
        )

    def _rows(self) -> list[list[Signal]]:
        """Return the commands of every lane."""
        return [
            [lane.perturbed() if signal is lane.signal else signal for signal in self.signals.values()]
            for lane in self.lanes
        ]

    def moved(self, response: Trajectory, part: LaneSystem) -> Trajectory:
        """Return a response (of one lane) with a lane for each number, on the same pieces.

        Parameters
        ----------
        response : Trajectory
            Of ``part`` to the commands.
        part : LaneSystem
            One lane, real.
        """
        at_rest = replace(part, x0=np.zeros_like(part.x0))
        lanes = [self._lane(response, at_rest, lane) for lane in self.lanes]
        edges, u, y = (
            np.concatenate(group, axis=axis) for group, axis in zip(zip(*lanes, strict=True), (1, 2, 2), strict=True)
        )
        return replace(response, edges=edges, u=u, y=y)

    def _lane(self, response: Trajectory, at_rest: LaneSystem, lane: CommandParameter) -> tuple[Array, Array, Array]:
        """Return edges, inputs and outputs of one lane."""
        horizon = float(response.edges[-1, 0])
        changes = [_Change.of(signal, lane, horizon) for signal in self.signals.values()]

        def answer(signals: Sequence[Signal]) -> Trajectory:
            return respond(at_rest, signals, horizon, plan=response.plan, propagators=response.propagators)

        smooth = answer([_Tangent(change=change) for change in changes])
        u, y = smooth.u, smooth.y
        if any(change.jumps for change in changes):
            y = y + _slope(answer([_Stairs(change=change) for change in changes]), "y")
        edge = np.zeros(len(response.edges))
        for change in changes:
            for instant, motion in change.motions:
                edge[np.abs(response.edges[:, 0] - instant) <= 1e-10 * max(horizon, instant)] = motion
        node = edge[:-1, None] + NODES * np.diff(edge)[:, None]
        step = 1j * INFINITESIMAL * lane.scale
        if node.any():
            u = u + _slope(response, "u") * node[:, :, None, None]
            y = y + _slope(response, "y") * node[:, :, None, None]
        return response.edges + step * edge[:, None], response.u + step * u, response.y + step * y


def _final(signal: Signal) -> complex:
    final = signal.final()
    return 0.0 if final is None else final


def _slope(response: Trajectory, name: str) -> Array:
    """Return the slopes of inputs or outputs on the pieces, shape (pieces, N + 1, 1, ·)."""
    width = np.diff(response.edges[:, 0])
    return np.asarray(
        np.einsum("jl,klps->kjps", differentiation_matrix(), getattr(response, name)) / width[:, None, None, None]
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Change:
    """∂u/∂p of one command: of its values, of the instants at which it breaks, and the impulses of its jumps."""

    signal: Signal
    perturbed: Signal | None
    unit: float
    motions: tuple[tuple[float, float], ...]
    jumps: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, signal: Signal, lane: CommandParameter, horizon: float) -> Self:
        if signal is not lane.signal:
            return cls(signal=signal, perturbed=None, unit=1.0, motions=(), jumps=())
        perturbed, unit = lane.perturbed(), INFINITESIMAL * lane.scale
        instants = np.array(perturbed.breaks(horizon), dtype=np.complex128)
        real, moves = instants.real, instants.imag / unit
        beside = _BESIDE * max(float(real[-1]), 1e-9)
        after = signal.value(real)
        before = np.where(real > 0, signal.value(np.maximum(real - beside, 0.0)), 0.0)
        height = after - before
        large = np.abs(height) > _JUMP * max(float(np.abs(after).max()), float(np.abs(before).max()), 1e-300)
        moving = moves != 0
        return cls(
            signal=signal,
            perturbed=perturbed,
            unit=unit,
            motions=tuple(zip(real[moving].tolist(), moves[moving].tolist(), strict=True)),
            jumps=tuple(zip(real[moving & large].tolist(), (-height * moves)[moving & large].tolist(), strict=True)),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tangent(Signal):
    """u_p(t): what the command's values change by, between the instants at which it breaks."""

    change: _Change

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the tangent."""
        return cls(**values)

    def value(self, t: FloatArray) -> FloatArray:
        """Return u_p(t)."""
        if self.change.perturbed is None:
            return np.zeros_like(t)
        return np.asarray(np.imag(self.change.perturbed.value(t)) / self.change.unit)

    def breakpoints(self) -> tuple[float, ...]:
        """Return those of the command."""
        return self.change.signal.breakpoints()

    def breaks(self, horizon: float) -> tuple[float, ...]:
        """Return those of the command."""
        return self.change.signal.breaks(horizon)

    def impulse(self) -> float:
        """Return what the impulse of the command changes by."""
        return 0.0 if self.change.perturbed is None else np.imag(self.change.perturbed.impulse()) / self.change.unit

    def final(self) -> float | None:
        """Return None: it is not asked for."""
        return None

    def end(self) -> float | None:
        """Return that of the command."""
        return self.change.signal.end()

    def degree(self) -> int | None:
        """Return that of the command, which a derivative by a parameter does not raise."""
        return self.change.signal.degree()


class _Stairs(_Tangent):
    """The integral of the impulses that moving jumps are."""

    def impulse(self) -> float:
        """Return 0."""
        return 0.0

    def value(self, t: FloatArray) -> FloatArray:
        """Return the sum of the steps so far."""
        total = np.zeros_like(t)
        for instant, height in self.change.jumps:
            total = total + np.where(t >= instant, height, 0.0)
        return total


def span_of(signals: Mapping[str, Signal]) -> tuple[float, float | None]:
    """Return when the commands start and end, s; the end is None for one that goes on for ever."""
    start = min((t for signal in signals.values() for t in signal.breakpoints()), default=0.0)
    ends = [signal.end() for signal in signals.values()]
    return start, None if any(e is None for e in ends) else max((float(e or 0.0) for e in ends), default=0.0)


def last_start(signals: Mapping[str, Signal]) -> Array:
    """Return when the last of the commands begins, s, shape (1,)."""
    return np.array(
        [max((signal.breakpoints()[0] for signal in signals.values() if signal.breakpoints()), default=0.0)]
    )


def repeats(signals: Mapping[str, Signal]) -> bool:
    """Return whether a command repeats for ever."""
    return any(signal.repeats_after() is not None for signal in signals.values())
