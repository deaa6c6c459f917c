"""The present instant of a nonlinear response: its state and modes, and how the laws settle into modes that agree.

A law that begins to hold an input is given the impulse that brings this input to rest exactly; where its output cannot
move the input's rate, it is let go again. Changes of mode in one instant that do not end are chattering.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Change, Mode, Moment, guard_slopes, stacked
from engine.exact.laws.straight import keep
from engine.exact.laws.system import Flow, Instants, NonlinearSystem
from engine.model.verdicts import Verdict

Array = npt.NDArray[Any]

NEGLIGIBLE = 1e-10
"""A guard below this part of its largest value is 0."""

ROUNDING = 30 * 2.3e-16
"""What a signal is known to, in parts of what it is made of."""

MAX_SWITCHES = 60
"""So many changes of mode in one instant do not end by themselves."""

_JUMP = 1e-9
_AT_REST = 1e-12
_SMALL = 1e-6


class StoppedError(Exception):
    """The response cannot be followed any further; carries the verdict and a sentence for the user."""

    def __init__(self, verdict: Verdict, advice: str) -> None:
        super().__init__(advice)
        self.verdict, self.advice = verdict, advice


class Switchboard:
    """State and modes at the present instant.

    Parameters
    ----------
    system : NonlinearSystem
    state : ndarray, shape (lanes, n)
    modes : sequence of int or None
        Modes to begin with; None: chosen by the laws.
    around : callable
        (time (lanes,)) -> inputs, their slopes and the delayed signals just after it, each (lanes, 1, ·).

    Attributes
    ----------
    t : ndarray, shape (lanes,)
    x : ndarray, shape (lanes, n)
    modes : list of int
    before : tuple of ndarray, or None
        Channels e and v at the end of the step before, and the slopes of e.
    largest : ndarray, shape (channels,)
        How large the laws' inputs have been.
    """

    def __init__(
        self,
        system: NonlinearSystem,
        state: Array,
        modes: Sequence[Mode] | None,
        around: Callable[[Array], tuple[Array, Array, Array]],
    ) -> None:
        self.system, self.real = system, system.value
        self.t: Array = np.zeros(system.lanes, dtype=complex if system.complex else float)
        self.x: Array = state.astype(self.t.dtype)
        self.modes: list[Mode] = list(modes or ())
        self.started = modes is not None
        self.switches = 0
        self._reopened = False
        self.around = around
        self.before: tuple[Array, Array, Array | None] | None = None
        self._scale: dict[tuple[int, Mode, int], float] = {}
        self._leanings: dict[tuple[int, Mode, int], Array] = {}
        self.largest = np.zeros(system.matrices["c3"].shape[-2])
        self._noise, self._states = np.zeros_like(self.largest), np.zeros(system.states)
        m = self.real.matrices
        self._reach: Array = np.abs(m["c3"][0]) @ np.abs(m["b3"][0])
        """From the laws' outputs to the rates of their inputs, (channels, outputs)."""

    # what the step before has left

    def arrived(self, e: Array, v: Array, slope: Array, *, noise: Array, states: Array) -> None:
        """Note the channels (lanes, 17, channels) of the step that ends at the present instant, and their slopes.

        ``noise`` (channels,) is what rounding makes of the laws' inputs, ``states`` (n,) how large the states have been.
        """
        self._noise, self._states = noise, states
        self.before = e[:, -1:], v[:, -1:], slope[:, -1:]
        self.largest = np.maximum(self.largest, np.abs(e[0].real).max(axis=0, initial=0.0))

    def tolerance(self, number: int, guard: int, values: Array) -> float:
        """Return what counts as 0 for a guard that has these values on a step."""
        known = self._scale.get(self._surface(number, guard), 0.0)
        return max(NEGLIGIBLE * max(known, float(np.abs(values).max())), self._rounding(number, guard))

    def note(self, number: int, guard: int, values: Array) -> None:
        """Remember how large a guard has been on a step."""
        key = self._surface(number, guard)
        self._scale[key] = max(self._scale.get(key, 0.0), float(np.abs(values).max()))

    def _surface(self, number: int, guard: int) -> tuple[int, Mode, int]:
        """Return the key under which the size of a guard is known.

        All guards of a continuous law count alike: were a corner nearer in one interval than in the next, an input that
        rests on it would go to and fro between them for ever.
        """
        return (number, 0, 0) if self.system.laws[number].element.continuous else (number, self.modes[number], guard)

    def _rounding(self, number: int, guard: int) -> float:
        """Return what the rounding of a law's states and inputs makes of a guard."""
        return self._in_its_unit(number, guard, ROUNDING * self._states, self._noise)

    def _in_its_unit(self, number: int, guard: int, states: Array, inputs: Array) -> float:
        """Return sizes of states (n,) and of inputs (channels,), whose units may differ, in that of a guard: by its slopes."""
        law = self.real.laws[number]
        key = (number, self.modes[number], guard)
        if key not in self._leanings:
            at = self.instant().real
            e, v = self.real.channels(at)
            seen = self.real.seen(number, at, e, v, np.zeros_like(e))
            keep(self._leanings, key, np.abs(guard_slopes(law.element, seen, guard, self.modes[number], law.real)))
        return float(self._leanings[key] @ np.concatenate([states[law.states], inputs[law.inputs]]))

    # the present instant

    def instant(self) -> Instants:
        """Return the present instant, just after whatever happens in it."""
        u, du, w = self.around(self.t)
        return Instants(t=self.t[:, None], x=self.x[:, None], u=u, du=du, w=w, modes=self.modes)

    def begin(self) -> None:
        """Let the laws choose their first modes."""
        self.started = True
        self.modes = [0] * len(self.system.laws)
        for _ in range(2):
            for number, law in enumerate(self.system.laws):
                at = self.instant().real
                e, v = self.real.channels(at)
                self.modes[number] = law.element.start(self.real.seen(number, at, e, v), law.real)
        for number, mode in enumerate(self.modes):
            self._entered(number, mode)

    def sample(self, number: int, *, updates: bool) -> None:
        """Let a law take a sample, or let its output follow the last one."""
        law = self.system.laws[number]
        at = self.instant()
        flow = self.system.flow(at)
        act = law.element.update if updates else law.element.sample
        self._put(number, act(self.system.seen(number, at, flow.e, flow.v), self.modes[number], law.values))

    def switch(self, number: int, guard: int, slope: Array | None) -> None:
        """Change the mode of a law whose guard has become positive; ``slope`` (lanes, 1, channels) where it is known."""
        at = self.instant()
        if self.before is not None and slope is None:
            e, v, slope = self.before
        else:
            flow = self.system.flow(at)
            e, v = flow.e, flow.v
        self._change(number, guard, self.system.seen(number, at, e, v, slope))

    def settle(self) -> None:
        """Let every law change its mode until all agree with the signals just after this instant."""
        if not self.system.laws:
            return
        before = None if self.before is None else self.before[:2]
        while True:
            if self._reopened:
                self._reopened = False
                self._reconsider()
            at = self.instant()
            flow = self.system.flow(at)
            if before is not None:
                if self._release(before, flow.e):
                    at = self.instant()
                    flow = self.system.flow(at)
                before = flow.e, before[1]
            if not self._correct(at, flow):
                return

    def _reconsider(self) -> None:
        """Let a law go that can no longer hold, now that another one has changed its mode, and open one that may hold again."""
        for number, law in enumerate(self.system.laws):
            mode, at = self.modes[number], self.instant()
            if law.element.idle(mode):
                self.modes[number] = law.element.release(Moment(t=at.t), mode, law.values).mode
            elif law.element.held(mode) is not None and not self.real.holdable(number, at.real):
                e, v = self.system.channels(at)
                self._adopt(
                    number, law.element.unheld(self.system.seen(number, at, e, v), mode, law.values, before=mode)
                )

    def _put(self, number: int, states: Sequence[Any] | None) -> None:
        law = self.system.laws[number]
        if states is not None and law.states.stop > law.states.start:
            self.x = self.x.copy()
            self.x[:, law.states] = stacked(states, (self.system.lanes, 1))[:, 0]

    def _adopt(self, number: int, change: Change) -> None:
        before, self.modes[number] = self.modes[number], change.mode
        self._put(number, change.x)
        if before != change.mode:
            self._entered(number, before)

    def _change(self, number: int, guard: int, seen: Moment) -> None:
        law, before = self.system.laws[number], self.modes[number]
        self._adopt(number, law.element.switch(guard, seen, before, law.values))
        after = self.modes[number]
        # what is 0 at once is a surface seen from its other side, or left just now: it counts as 0 in parts of what it is made of
        for k, other in enumerate(law.element.guards(seen, after, law.values) if after != before else ()):
            size = self._in_its_unit(number, k, self._states, self.largest)
            if abs(float(np.ravel(other)[0].real)) <= NEGLIGIBLE * size:
                self._scale.setdefault(self._surface(number, k), size)
        if not law.element.idle(after) and law.element.held(before) is law.element.held(after) is None:
            self._reopened = True
        self.switches += 1
        if self.switches > MAX_SWITCHES:
            raise StoppedError(
                Verdict.DOUBTFUL,
                f"{law.label} changes its mode without end at t = {float(self.t[0].real):.6g} s (chattering): "
                "give it hysteresis, or put a lag into the loop",
            )

    def _release(self, before: tuple[Array, Array], e: Array) -> bool:
        """Tell the laws whose inputs jump to prepare for it; return whether there are some."""
        old, outputs = before
        size = np.maximum(self.largest, np.abs(e[0, 0].real))
        # what has been held so far has no size of its own: what rounding of the force on it moves it by is no jump
        pushed = ROUNDING * float(self.t[0].real) * (self._reach @ np.abs(outputs[0, 0].real))
        jumps = np.abs((e - old)[0, 0].real) > np.maximum(_JUMP * size, pushed)
        if not jumps.any():
            return False
        for number, law in enumerate(self.system.laws):
            if np.any(jumps[law.inputs]):
                seen = self.system.seen(number, self.instant(), old, outputs)
                self._adopt(number, law.element.release(seen, self.modes[number], law.values))
        return True

    def _correct(self, at: Instants, flow: Flow) -> bool:
        """Switch the first law whose guard is positive; return whether there was one."""
        largest = np.maximum(self.largest, np.abs(flow.e[0, 0].real))
        states = np.maximum(self._states, np.abs(at.x[0, 0].real))
        for number, law in enumerate(self.system.laws):
            mode = self.modes[number]
            seen = self.system.seen(number, at, flow.e, flow.v)
            found = law.element.guards(seen, mode, law.values)
            for k, guard in enumerate(found):
                known = self._scale.get(self._surface(number, k), 0.0)
                size = max(known, self._in_its_unit(number, k, states, largest))
                least = max(NEGLIGIBLE * size, self._rounding(number, k))
                if float(np.ravel(guard)[0].real) > least:
                    self._change(number, k, seen)
                    return True
        return False

    def _entered(self, number: int, before: Mode) -> None:
        """Make a law, so far in the mode ``before``, that begins to hold an input really hold it, or let it go."""
        law = self.system.laws[number]
        output = law.element.held(self.modes[number])
        if output is None:
            return
        free, at = self.x, self.instant()
        if self.real.holdable(number, at.real):
            moved = self._impulse(number, at)
            if moved is not None:
                self.x = self._resting(number, output, at, moved)
                at = self.instant()
                if self.real.holdable(number, at.real):  # exactly at rest, too: a damper has no force there
                    return
        self.x, at = free, replace(at, x=free[:, None])
        e, v = self.system.channels(at)
        seen = self.system.seen(number, at, e, v)
        change = law.element.unheld(seen, self.modes[number], law.values, before=before)
        self.modes[number] = change.mode
        self._put(number, change.x)

    def _resting(self, number: int, output: int, at: Instants, moved: Array) -> Array:
        """Return the states with 0 for the one that a law holds, where that is a state itself."""
        law = self.system.laws[number]
        row = self.system.holds(self.modes).index((law.outputs.start + output, number))
        slope = self.real.tangent(at.real).hold[0, row]
        places = np.flatnonzero(slope)
        if len(places) == 1:
            place = int(places[0])
            seen_as = abs(float(slope[place]) * float(moved[0, place].real))
            if seen_as <= _AT_REST * float(self.largest[law.inputs].max(initial=0.0)):
                moved[:, place] = 0.0
        return moved

    def _impulse(self, number: int, at: Instants) -> Array | None:
        """Return the states with what a law begins to hold at exactly 0; None where that is no small correction."""
        law = self.system.laws[number]
        tangent = self.real.tangent(at.real)
        row = [held for _, held in self.system.holds(self.modes)].index(number)
        impulse = tangent.fm[0] @ np.linalg.inv(tangent.gain[0])[:, row]
        x = self.x
        for _ in range(3):
            now = replace(at, x=x[:, None])
            e, v = self.system.channels(now)
            away = law.element.surface(self.system.seen(number, now, e, v), self.modes[number], law.values)
            x = x - impulse * away
        allowed = _SMALL * np.maximum(self._states, np.abs(self.x[0].real))
        return x if np.all(np.abs((x - self.x)[0].real) <= allowed) else None
