"""The response of a system with nonlinear laws: steps of high order between instants at which something changes.

The instants are breakpoints of the commands, their echoes through the delays, samples, and the events of the laws: the
roots of their guards on the polynomial of a step, found to rounding. At each of them the laws settle into modes that
agree with each other. Parameters with infinitesimals travel along as lanes: each accepted step is linearised exactly,
and an event's instant moves by dt = -(∂h/∂p) / ḣ, so that derivatives pass through events.

References
----------
L. F. Shampine, S. Thompson, "Event location for ordinary differential equations", Comput. Math. Appl. 39 (2000) 43-54;
A. F. Filippov, "Differential Equations with Discontinuous Righthand Sides", Kluwer 1988, chapter 2 (held inputs).
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Mode
from engine.elements._sampler import Sampler
from engine.exact.laws.straight import until
from engine.exact.nonlinear.agenda import Agenda, Stop
from engine.exact.nonlinear.bounds import Bounds
from engine.exact.nonlinear.driving import Driving
from engine.exact.nonlinear.guards import Crossing, first_crossing, touches
from engine.exact.nonlinear.meeting import Meeting
from engine.exact.nonlinear.outcome import Outcome
from engine.exact.nonlinear.periods import Periods
from engine.exact.nonlinear.pieces import Command, Record
from engine.exact.nonlinear.steps import Step, Stepper
from engine.exact.nonlinear.switching import StoppedError, Switchboard
from engine.exact.nonlinear.undecided import Undecided
from engine.exact.nonlinear.widths import EARLY, Widths
from engine.exact.nonlinear.windows import Chain
from engine.exact.nonlinear.windows import solve as solve_chain
from engine.exact.time.chebyshev import NODES, differentiation_matrix
from engine.model.errors import EngineError
from engine.model.failures import numerical
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.exact.laws.system import NonlinearSystem
    from engine.signals import Signal

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]

TOLERANCE: Final = 1e-11
"""What the polynomial of a step may miss, relative to the largest value of each state so far."""

_FEWEST, _MOST, _PAUSE = 8, 64, 4  # how many short steps are taken at once; after a failure single ones follow


class Integration:
    """A response under way.

    Parameters
    ----------
    system : NonlinearSystem
    signals : mapping of input name to Signal
        Inputs left out are 0.
    constants : ndarray, shape (inputs,), optional
        Added to the commands.
    state : ndarray, shape (lanes, n), optional
        Begin here in place of the initial state.
    modes : sequence of int, optional
        Begin with these, which the guards then correct; chosen by the laws where absent.
    past : ndarray, shape (lanes, m), optional
        What comes out of the delays that went in before the beginning; 0 where absent.
    clock : callable, optional
        Seconds; with ``limit`` (s) it bounds the time spent.
    tolerance : float, optional
    """

    def __init__(
        self,
        system: NonlinearSystem,
        signals: Mapping[str, Signal],
        *,
        constants: Real | None = None,
        state: Array | None = None,
        modes: Sequence[Mode] | None = None,
        past: Array | None = None,
        clock: Callable[[], float] | None = None,
        limit: float = math.inf,
        tolerance: float = TOLERANCE,
    ) -> None:
        self.system = system
        self._board = Switchboard(system, system.start if state is None else state, modes, self._around)
        self.record = Record(edges=[self._board.t], before=past)
        self._driving = Driving(system, signals, constants, self.record)
        self._stepper = Stepper(system, self.record, tolerance)
        self._bounds = Bounds(clock, limit)
        self._undecided = Undecided(system.value)
        self.smooth = not any(law.element.jumps(law.values) for law in system.laws)
        self.error = 0.0
        self._agenda = Agenda(system, self._driving)
        self._widths = Widths(system, self._board, self._stepper, self._driving, self._bounds)
        self._chain, self._pause = _FEWEST, 0
        self._left: Real | None = None
        self._torn = False  # whether signals jump here at other infinitesimals than where the record ends
        self._mixed = not all(issubclass(law.element, Sampler) for law in system.laws)
        self._periods = Periods.of(system)

    @property
    def now(self) -> float:
        """The present instant, s."""
        return float(self._board.t[0].real)

    def rest(self) -> tuple[Mode, ...]:
        """Return the modes at the present instant, all laws in agreement.

        Raises
        ------
        StoppedError
            If they do not come to agree.
        EngineError
            If the equations have no solution at this instant.
        """
        with np.errstate(all="ignore"), numerical("the laws"):
            if not self._board.started:
                self._board.begin()
            self._board.settle()
        return tuple(self._board.modes)

    def outputs(self) -> Array:
        """Return the outputs just after the present instant, (lanes, outputs)."""
        at = self._board.instant()
        return self.system.read(at, self.system.flow(at).v)[0][:, 0]

    def advance(self, horizon: float) -> Outcome:
        """Return the response up to ``horizon`` (s); may be called again with a later one."""
        verdict, advice = Verdict.OK, ""
        self._widths.horizon = max(self._widths.horizon, horizon)
        try:
            self._agenda.note_breaks(horizon)
            # what overflows is found at the end of each step, as a state that is not finite
            with np.errstate(all="ignore"), numerical("the response"):
                self._advance(horizon)
        except StoppedError as stop:
            verdict, advice = stop.verdict, stop.advice
        except EngineError as error:
            verdict, advice = Verdict.DOUBTFUL, f"at t = {self.now:.6g} s {error.message}"
        if not self.record.y:
            self._stand()
        after = self.outputs() if verdict is Verdict.OK else None
        return Outcome(
            record=self.record, after=after, state=self._board.x, modes=tuple(self._board.modes), verdict=verdict, advice=advice,
            error=self.error, events=self._bounds.events, steps=self._bounds.steps,
            smooth=self.smooth, limits=self.system.limits,
        )  # fmt: skip

    def _stand(self) -> None:
        """Record the beginning as a piece of its own, where the response could not be followed from there at all."""
        at = self._board.instant()
        with contextlib.suppress(EngineError), numerical("the response"):
            y, z = self.system.read(at, self.system.channels(at)[1])
            nodes = [np.repeat(part, len(NODES), axis=1) for part in (y, at.u, z)]
            self.record.append(self._board.t + 1e-12 * max(self._widths.horizon, 1e-300), *nodes)

    def _advance(self, horizon: float) -> None:
        while True:
            due = self._agenda.due(self.now, horizon)
            if due or not self._board.started:
                self._arrive(due)
            if self.now >= horizon * (1 - 1e-14):
                return
            if self._repeated(horizon):
                continue
            stop = self._agenda.following(horizon)
            self._step(horizon if stop is None else stop.time, None if stop is None else stop.lanes)

    # instants known beforehand

    def _arrive(self, due: Sequence[Stop]) -> None:
        """Do what is due at this instant, and let the laws settle."""
        begun = self._board.started
        if not begun:
            self._board.begin()
        meeting = Meeting.of(self._board, self.record, due, self._left) if self.system.complex else None
        self._board.switches = 0
        driven = self._driving.may_jump(self.now)
        unsettled = driven or not begun
        for stop in due:
            if meeting is not None:
                meeting.reach(stop)
            if stop.law is not None:
                if unsettled and self._mixed and not stop.updates:  # a sample is of what the other laws make of a jump
                    self._board.settle()
                self._board.sample(stop.law, updates=stop.updates)
                unsettled = True
                if not stop.updates:
                    self._agenda.sample_again(stop.law, self.now)
            if meeting is not None:
                meeting.happened(stop)
        if driven or any(stop.law is not None for stop in due):
            self._board.settle()
        if meeting is not None:
            self._torn = not meeting.end(stays=self.now >= self._widths.horizon * (1 - 1e-14))
            self.smooth = self.smooth and meeting.smooth
        generation = min((stop.generation if stop.law is None else 0 for stop in due), default=0)
        jumps = self._board.switches > 0 or self.record.jumps(self._board.t, self.system.delays)
        onward = self._agenda.onward(due) if self.record.y and not self._board.switches else None
        self._agenda.echo(self._board.t, 0 if jumps else generation, onward)

    def _around(self, t: Array) -> tuple[Array, Array, Array]:
        """Return inputs, their slopes and the delayed signals just after the instant ``t`` (lanes,)."""
        # what is due now has been taken from the list
        following = self._agenda.following()
        ahead = min(self._widths.next, 1.0, math.inf if following is None else following.time - self.now)
        ahead = ahead if ahead > 0 else min(self._widths.next, 1.0)
        return self._driving.around(t, self.now, ahead)

    def _command(self, width: float) -> Command:
        return self._driving.command(self.now, width)

    # steps

    def _step(self, target: float, lanes: Array | None) -> None:
        """Go on to ``target``, or as far as accuracy or an event allow."""
        self.smooth, self._torn = self.smooth and not self._torn, False
        gap = target - self.now
        width = self._widths.within(gap)
        if width == gap and self._many():
            return
        step, width, at_once = self._widths.solved(width, gap)
        if at_once is not None:
            self._note_guards(step, until(0.0))
            self._event(step, at_once)
            return
        tolerances = [self._board.tolerance(number, guard, values) for number, guard, values in step.guards]
        crossing = first_crossing(step.guards, tolerances)
        if crossing is not None and crossing.theta * width <= gap:
            event = self._widths.placed(step, crossing)
            if event is not None:
                self._note_guards(step, until(event.theta) if event.theta <= EARLY else None)
                self._event(step, event)
            return
        self._note_guards(step)
        self._undecided.look(step, self._board.modes, width=min(width, gap), now=self.now, horizon=self._widths.horizon)
        if width >= gap:
            part = step if width == gap else self._stepper.cut(step, gap / width, self._command(gap))
            self._accept(part, target, lanes)
        else:
            self._accept(step, self.now + width, None)

    def _note_guards(self, step: Step, part: Real | None = None) -> None:
        """Remember how large the guards are on a step, or on a part of it that these weights give."""
        for number, guard, values in step.guards:
            self._board.note(number, guard, values if part is None else part @ values)

    def _many(self) -> bool:
        """Take the steps between many kinks of the commands at once; return whether that has led on."""
        if self.system.delays.shape[-1] or len(self._agenda) < self._chain or not self.system.states:
            return False
        self._pause -= 1
        ahead = self._agenda.ahead(self._chain)
        inside = ahead[-1].time < self._widths.horizon and all(stop.law is None for stop in ahead)
        if not inside or self._pause > 0 or np.any(self._board.t.imag):
            return False
        times = np.array([self.now, *(stop.time for stop in ahead)])
        straight = self._driving.lines(times)
        chain = None if straight is None else solve_chain(self._stepper, self._board, straight)
        if chain is None:
            self._chain, self._pause = max(_FEWEST, self._chain // 2), _PAUSE
            return False
        taken = len(chain.edges)
        self._agenda.drop(taken - 1)
        if taken == self._chain:
            self._chain = min(2 * self._chain, _MOST)
        self._take(chain)
        return True

    def _take(self, chain: Chain) -> None:
        """Append a chain of steps to the record and move to its end."""
        self._bounds.step(self.now, len(chain.edges))
        board = self._board
        linear = chain.x[:, :, : self.system.linear_states]
        parts = np.concatenate([linear, chain.u[0].real, chain.v[0].real], axis=2)
        sums = np.concatenate([chain.y[0], chain.e[0], chain.v[0]], axis=2).real
        self._stepper.remember(*(np.concatenate(part) for part in (chain.x, parts, sums)))
        self._stepper.forget()
        self.error = max(self.error, chain.error)
        begin = self.record.edges[-1]
        self.record.extend(chain.edges.astype(board.t.dtype), chain.y, chain.u)
        board.t, board.x = self.record.edges[-1], chain.end.copy()
        width = float((board.t - (chain.edges[-2] if len(chain.edges) > 1 else begin))[0].real)
        self._left = differentiation_matrix()[-1] @ chain.x[-1] / width
        e, v = chain.e[:, -1], chain.v[:, -1]
        board.arrived(
            e, v, self._stepper.quiet_slope(e, width), noise=self._stepper.noise(), states=self._stepper.scale
        )

    def _repeated(self, horizon: float) -> bool:
        """Take whole periods of linear samplers between two kinks of the commands; return whether that has led on."""
        if self._periods is None or self._torn or not self._driving.straight:
            return False
        count = self._periods.count(self._board.t, self._agenda.kink(horizon))
        lines = self._driving.lines(self.now + np.array([0.0, count * self._periods.length[0].real])) if count else None
        board = self._board
        chain = None if lines is None else self._periods.follow(count, board.t, board.x, board.modes, lines)
        if chain is None:
            return False
        self._take(chain)
        self._agenda.sample_anew(self.now)
        return True

    def _accept(self, step: Step, end: float, lanes: Array | None, event: tuple[Step, Crossing] | None = None) -> None:
        """Append a step to the record and move to its end; ``event`` is what ends it, on the step that it is a part of."""
        self._stepper.accept(step, whole=event is None)
        self.error = max(self.error, step.error)
        board = self._board
        nodes = step.nodes
        if self.system.complex:
            self.smooth = self.smooth and not any(
                touches(values, board.tolerance(number, guard, values)) for number, guard, values in step.guards
            )
            ends = np.full(self.system.lanes, end, dtype=complex) if lanes is None else lanes
            path, nodes = self._stepper.lanes(step, board.x, board.t, ends)
            if event is not None:
                ends = ends - 1j * self._moved(*event, nodes)
                path, nodes = self._stepper.lanes(step, board.x, board.t, ends)
            board.t, last = ends, path[:, -1]
        else:
            board.t, last = np.full(1, end), step.path[-1:]
        board.x = last.copy()
        self._left = nodes.flow.f[0, -1].real
        self.record.append(board.t, nodes.y, nodes.at.u, nodes.z)
        noise, states = self._stepper.noise(), self._stepper.scale
        board.arrived(nodes.flow.e, nodes.flow.v, nodes.slope, noise=noise, states=states)
        self._bounds.state(end, last)

    def _moved(self, step: Step, event: Crossing, nodes: Any) -> Real:
        """Return how much earlier an event comes for the infinitesimals of its guard, (lanes,).

        Its rate is that of the whole ``step``: the part before the event may be so short that rounding is all of it.
        """
        number, guard, _ = step.guards[event.index]
        law = self.system.laws[number]
        seen = self.system.seen(number, nodes.at, nodes.flow.e, nodes.flow.v, nodes.slope)
        values = law.element.guards(seen, self._board.modes[number], law.values)[guard]
        shape = nodes.at.t.shape
        moved = np.asarray(np.broadcast_to(values, shape)[:, -1].imag)
        rate = step.slope_of(event.index, event.theta)
        if rate <= 0.0:
            self.smooth = self.smooth and not np.any(moved)
            return np.zeros_like(moved)
        return np.asarray(moved / rate)

    def _event(self, step: Step, crossing: Crossing) -> None:
        """Cut the step at its first event, and change the mode there."""
        number, guard, _ = step.guards[crossing.index]
        self.error = max(self.error, step.error)  # the part before the event is no better than the whole
        width = step.width * crossing.theta
        slope = None
        if width > 1e-13 * max(self.now, 1e-3 * self._widths.horizon):
            part = self._stepper.cut(step, crossing.theta, self._command(width))
            self._accept(part, self.now + width, None, event=(step, crossing))
            self._board.switches = 0
        else:
            slope = np.broadcast_to(step.nodes.slope[:, :1], (self.system.lanes, 1, step.nodes.slope.shape[-1]))
            self._stepper.forget()
        self._left = None
        self._bounds.event(self.now, self._widths.horizon, self.system.laws[number].label)
        self._board.switch(number, guard, slope)
        self._agenda.echo(self._board.t, 0)
        self._board.settle()
