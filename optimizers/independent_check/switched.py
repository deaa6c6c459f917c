"""Responses of systems with nonlinear laws, a second time: scipy's LSODA between the events, which its dense output brackets.

Of the engine it takes the matrices, and the formulas of the laws with their modes; how these are followed in time is written out
again (`equations` has the rates).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from engine.elements._nonlinear import Moment
from engine.model.interruption import look
from optimizers.independent_check.equations import Equations, Instants, seen
from optimizers.independent_check.march import NODES, CannotFollowError, March

if TYPE_CHECKING:
    from engine.elements._nonlinear import Change
    from engine.exact.laws.system import NonlinearSystem
    from engine.signals import Signal

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

_STEP: Final = 1e-40
_MOST_LOOKS: Final = 20_000
"""So often are the rates asked for at most,"""
_MOST_EVENTS: Final = 300
_MOST_PIECES: Final = 20_000
_MOST_AT_ONCE: Final = 50
_FEWEST_STEPS: Final = 100
_POSITIVE, _MISSED = 1e-10, 1e-5
"""A guard that is larger than this part of its size is positive; one that is so between two events was passed unseen."""
_PARTS: Final = ("x", "z", "slope", "y")
_JUMP: Final = 1e-9


class Follower:
    """A system under commands, followed from t = 0.

    Parameters
    ----------
    system : NonlinearSystem
    signals : mapping of input name to Signal
    until : float
        s.

    Raises
    ------
    CannotFollowError
        Here and in `run`, for what is beyond it: delays, samplers, loops without a state, very many steps or events.
    """

    def __init__(self, system: NonlinearSystem, signals: Mapping[str, Signal], until: float) -> None:
        self._equations = Equations(system)
        self._laws = self._equations.laws
        self._signals = [signals.get(name) for name in system.inputs]
        self._until = until
        self._x: Array = np.array(system.start[0].real, dtype=float)
        b = self._equations.matrices["b1"]
        for column, signal in enumerate(self._signals):
            self._x[: len(b)] += b[:, column] * (0.0 if signal is None else signal.impulse())
        self._span = (0.0, 0.0)
        self._looks = self._events = 0
        self._largest = np.zeros(self._equations.matrices["c3"].shape[0])
        self._sizes = [np.zeros(1) for _ in self._laws]

    def beginning(self) -> Array:
        """Return the outputs just before the commands begin, (outputs,): of a system without any."""
        self._begin()
        self._settle(0.0)
        at = self._at(np.zeros(1), self._x[None])
        return np.asarray(self._equations.outputs(at, self._equations.flow(at))[0])

    def run(self, outputs: Sequence[int], *, relative: float, sizes: Real) -> tuple[March, Real]:
        """Return outputs, and the largest value of each state.

        Parameters
        ----------
        outputs : sequence of int
        relative : float
            Tolerance of a step,
        sizes : ndarray, shape (states,)
            relative to values of this size at least.
        """
        breaks = {t for s in self._signals if s is not None for t in s.breaks(self._until) if 0 < t < self._until}
        pieces: list[tuple[Real, Real]] = []
        largest = np.abs(self._x)
        before: Array | None = None
        for begin, end in pairwise([0.0, *sorted(breaks), self._until]):
            self._span = (float(np.nextafter(begin, np.inf)), float(np.nextafter(end, 0.0)))
            if before is None:
                self._begin()
            else:
                self._jump(begin, before)
            now = begin
            while now < end:
                self._settle(now)
                times, dense, modes, now = self._smooth(now, end, relative, sizes)
                later, self._equations.modes = self._equations.modes, modes
                for a, b in pairwise(sorted(set(times))):  # an event may take no time at all
                    instants = a + (b - a) * NODES
                    states = np.asarray(dense(instants)).T
                    largest = np.maximum(largest, np.abs(states).max(axis=0))
                    pieces.append((instants, self._read(instants, states)[:, list(outputs)]))
                    if next(self._beyond(instants, states, _MISSED), None) is not None:
                        raise CannotFollowError
                self._equations.modes = later
                if len(pieces) > _MOST_PIECES:
                    raise CannotFollowError
            before = self._equations.channels(self._at(np.array([end]), self._x[None]))[0][0]
        starts = np.array([instants[0] for instants, _ in pieces])
        widths = np.array([instants[-1] - instants[0] for instants, _ in pieces])
        return March(starts=starts, widths=widths, values=np.stack([y for _, y in pieces]), finals=None), largest

    def _at(self, t: Real, x: Array) -> Instants:
        """Return instants with the commands as they are inside the present stretch."""
        inside = np.clip(t, *self._span)
        moved: Array = inside + 1j * _STEP
        silent = np.zeros(len(inside))
        u = [silent if s is None else np.asarray(s.value(inside), dtype=float) for s in self._signals]
        du = [silent if s is None else np.imag(s.value(moved)) / _STEP for s in self._signals]
        shape = (len(inside), len(self._signals))
        return Instants(t=t, x=x, u=np.reshape(np.array(u).T, shape), du=np.reshape(np.array(du).T, shape))

    def _smooth(
        self, begin: float, end: float, relative: float, sizes: Real
    ) -> tuple[list[float], Callable[[Real], Any], list[int], float]:
        """Go on from ``begin`` to the next event or ``end``; return the steps, the states on them, their modes, and where it ended."""
        # What `_settle` left positive is so by rounding only and counts as 0: of one that is positive the solver sees no passage.
        at = {begin: [[min(float(g[0]), 0.0) for g in law] for law in self._guards(np.array([begin]), self._x[None])]}
        guards = [(k, g) for k, values in enumerate(at[begin]) for g in range(len(values))]

        def watched(number: int, guard: int) -> Callable[[float, Real], float]:
            def value(t: float, x: Real) -> float:
                # What an end of a step said stands: the dense output differs from it by rounding, which may change a sign.
                if t not in at:
                    at[t] = [[float(g[0]) for g in law] for law in self._guards(np.array([t]), x[None])]
                return at[t][number][guard]

            value.terminal, value.direction = True, 1.0  # type: ignore[attr-defined]
            return value

        modes = list(self._equations.modes)
        solver: Any = solve_ivp  # its stubs know no events with attributes
        with np.errstate(all="ignore"):
            found = solver(
                self._rates, (begin, end), self._x, method="LSODA", dense_output=True, rtol=relative,
                atol=relative * sizes, max_step=self._until / _FEWEST_STEPS, events=[watched(k, g) for k, g in guards],
            )  # fmt: skip
        if found.status < 0 or not np.isfinite(found.y[:, -1]).all():
            raise CannotFollowError
        self._x = found.y[:, -1].copy()
        now = float(found.t[-1])
        if found.status == 1:
            self._events += 1
            if self._events > _MOST_EVENTS:
                raise CannotFollowError
            which = next(k for k, instants in enumerate(found.t_events) if len(instants))
            self._switch(*guards[which], now)
        return found.t.tolist(), found.sol, modes, now if found.status == 1 else end

    def _rates(self, t: float, x: Real) -> Array:
        look()
        self._looks += 1
        if self._looks > _MOST_LOOKS:
            raise CannotFollowError
        return np.asarray(self._equations.flow(self._at(np.array([t]), x[None])).f[0])

    def _read(self, t: Real, x: Array) -> Array:
        """Return the outputs, (N, outputs); note how large the laws' inputs are."""
        at = self._at(t, x)
        flow = self._equations.flow(at)
        self._largest = np.maximum(self._largest, np.abs(flow.e).max(axis=0))
        return self._equations.outputs(at, flow)

    # events

    def _moment(self, number: int, t: float, x: Real) -> Moment:
        """Return all that a law sees at one instant."""
        at = self._at(np.array([t]), x[None])
        flow = self._equations.flow(at)
        return seen(self._laws[number], at, flow.e, flow.v, self._equations.slopes(at, flow))

    def _guards(self, t: Real, x: Array) -> list[list[Real]]:
        """Return the guards of every law at some instants, each (N,); note how large their parts are."""
        at = self._at(t, x)
        flow = self._equations.flow(at)
        slopes = self._equations.slopes(at, flow)
        found = []
        for number, (law, mode) in enumerate(zip(self._laws, self._equations.modes, strict=True)):
            moment = seen(law, at, flow.e, flow.v, slopes)
            self._sizes[number] = np.fmax(self._sizes[number], np.abs(_parts(moment)).max(axis=1))
            found.append([np.broadcast_to(np.real(g), t.shape) for g in law.element.guards(moment, mode, law.real)])
        return found

    def _size(self, number: int, guard: int, t: float, x: Real) -> float:
        """Return a guard's size: what the largest values of its parts, whose units differ, move it by."""
        law, m = self._laws[number], self._moment(number, t, x)
        parts = _parts(m)
        moved = iter(parts[:, None, :] + 1j * _STEP * np.eye(len(parts))[:, :, None])
        m = Moment(t=t, **{name: [next(moved) for _ in getattr(m, name)] for name in _PARTS})
        value = law.element.guards(m, self._equations.modes[number], law.real)[guard]
        slopes = np.broadcast_to(np.imag(value) / _STEP, (len(parts), 1))[:, 0]
        return float(np.nan_to_num(np.abs(slopes) * self._sizes[number], posinf=0.0).sum())

    def _begin(self) -> None:
        """Let the laws choose their first modes."""
        at = self._at(np.zeros(1), self._x[None])
        for _ in range(2):
            for number, law in enumerate(self._laws):
                e, v = self._equations.channels(at)
                self._equations.modes[number] = law.element.start(seen(law, at, e, v), law.real)
                self._largest = np.maximum(self._largest, np.abs(e[0]))
        for number, law in enumerate(self._laws):
            if law.element.held(self._equations.modes[number]) is not None:
                self._hold(number, 0.0, self._equations.modes[number])

    def _jump(self, t: float, before: Array) -> None:
        """Let the laws whose inputs jump with the commands open for it."""
        after = self._equations.channels(self._at(np.array([t]), self._x[None]))[0][0]
        jumps = np.abs(after - before) > _JUMP * np.maximum(self._largest, np.abs(after))
        span, inside = self._span, float(np.nextafter(t, 0.0))
        for number, law in enumerate(self._laws):
            if np.any(jumps[law.inputs]):
                self._span = (inside, inside)
                moment = self._moment(number, t, self._x)
                self._span = span
                self._adopt(number, law.element.release(moment, self._equations.modes[number], law.real))

    def _settle(self, t: float) -> None:
        """Let every law change its mode until all agree."""
        for _ in range(_MOST_AT_ONCE):
            if any(law.element.idle(mode) for law, mode in zip(self._laws, self._equations.modes, strict=True)):
                raise CannotFollowError
            beyond = next(self._beyond(np.array([t]), self._x[None], _POSITIVE), None)
            if beyond is None:
                return
            self._switch(*beyond, t)
        raise CannotFollowError

    def _beyond(self, t: Real, x: Array, part: float) -> Iterator[tuple[int, int]]:
        """Yield every law and guard that is larger than a part of its size at one of some instants."""
        for number, guards in enumerate(self._guards(t, x)):
            for guard, values in enumerate(guards):
                k = int(np.argmax(values))
                if values[k] > 0 and values[k] > part * self._size(number, guard, float(t[k]), x[k]):
                    yield number, guard

    def _switch(self, number: int, guard: int, t: float) -> None:
        law, before = self._laws[number], self._equations.modes[number]
        self._adopt(number, law.element.switch(guard, self._moment(number, t, self._x), before, law.real))
        after = self._equations.modes[number]
        if after != before and law.element.held(after) is not None:
            self._hold(number, t, before)

    def _hold(self, number: int, t: float, before: int) -> None:
        """Bring what a law begins to hold to rest, or let it go where its output does not drive it back."""
        law, at = self._laws[number], self._at(np.array([t]), self._x[None])
        moved = self._equations.held_at(at, number)
        if moved is not None:
            self._x = moved
            return
        moment = seen(law, at, *self._equations.channels(at))
        self._adopt(number, law.element.unheld(moment, self._equations.modes[number], law.real, before=before))

    def _adopt(self, number: int, change: Change) -> None:
        self._equations.modes[number] = change.mode
        if change.x is not None:
            for k, state in enumerate(range(self._laws[number].states.start, self._laws[number].states.stop)):
                self._x[state] = float(np.ravel(change.x[k])[0].real)


def _parts(m: Moment) -> Real:
    """Return all that a law's guards may depend on, (parts, N)."""
    return np.array([signal for name in _PARTS for signal in getattr(m, name)])
