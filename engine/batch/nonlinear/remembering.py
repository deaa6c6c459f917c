"""A nonlinear law whose mode only its past tells: the mode is a signal of its own, by which its formulas are chosen.

The mode changes where a guard of the one that is remembered becomes positive, and the states with it. In a mode that holds an input
an output is a signal of its own, too, until `engine.batch.nonlinear.holding` finds what it takes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.batch.nonlinear.choices import joined, same
from engine.batch.nonlinear.recording import MOST_MODES, RecordedLaw, modes_of_the_instant
from engine.batch.nonlinear.signals import Signal, SignalGraph, choose, largest
from engine.elements._base import Values
from engine.elements._nonlinear import Change, Mode, Moment
from engine.exact.laws.laws import Law
from engine.model.traced import UnsuitableError


@dataclass(frozen=True, kw_only=True, eq=False)
class Memory:
    """What a law that remembers its mode does with it.

    ``guard`` is positive where the mode ends, ``mode`` the one that follows; ``switched`` and ``released`` are pairs of a signal,
    the mode or a state, and what it is after that, or before the inputs jump.
    """

    guard: Any
    mode: Any
    switched: list[tuple[Any, Any]]
    released: list[tuple[Any, Any]]


class RememberingLaw(RecordedLaw):
    """One law of a diagram that remembers its mode.

    Attributes
    ----------
    mode : signal
        The mode.
    hold : signal
        The output that is held in modes that hold one.
    holding : list of int
        These modes, once they are known to hold; where no output can move the input, what follows at once takes their place.
    jumps : bool
        Whether an output may jump where a mode ends.
    """

    def __init__(self, law: Law, values: Values, graph: SignalGraph) -> None:
        self.mode, self.hold = graph.signal(), graph.signal()
        super().__init__(law, values, graph)
        self.holding = [mode for mode in self._modes if self._element.held(mode) is not None]
        moment = self._moment(self._open)
        self.jumps = any(
            self._element.across(number, mode, values) is not None
            for mode in self._modes if mode not in self.holding
            for number, _ in enumerate(self._element.guards(moment, mode, values))
        )  # fmt: skip

    @property
    def begins(self) -> Mode:
        """The mode at rest."""
        if self._element.held(self._begins) is None or self._begins in self.holding:
            return self._begins
        moment = self._moment(self._open)
        return self._element.unheld(moment, self._begins, self._values, before=self._begins).mode

    def surface(self, mode: Mode, inputs: Sequence[Any]) -> Any:
        """Return what a mode that holds keeps at 0."""
        return self._element.surface(self._moment(inputs), mode, self._values)

    def among_held(self, alternatives: Sequence[Any]) -> Any:
        """Return what belongs to the mode, of one entry for each of `holding`; in other modes any of them."""
        return self._chosen(self.holding, alternatives)

    def memory(
        self, inputs: Sequence[Any], slopes: Sequence[Any], *, outputs: Sequence[Any], jumps: bool, jumped: bool = False
    ) -> Memory:
        """Return what happens to the mode, where inputs, their slopes in time and outputs are these.

        The inputs may be about to jump, and may have ``jumped``: what they have jumped across is not held.
        """
        moment = Moment(t=self._time, x=self.states, z=inputs, slope=slopes, y=outputs)
        signals = [self.mode, *self.states]
        largest_guards, switched, released = [], [], []
        for mode in self._modes:
            stays = [float(mode), *self.states]
            guards = list(self._element.guards(moment, mode, self._values))
            largest_guards.append(largest([-math.inf, *(guard for guard in guards if _may_end(guard))]))
            after = stays
            for number in reversed(range(len(guards))):
                if _may_end(guards[number]):
                    holds = not (jumped and isinstance(guards[number], Signal))
                    changed = self._after(self._switch(number, moment, mode, holds=holds))
                    after = [choose(guards[number], *pair) for pair in zip(changed, after, strict=True)]
            switched.append(after)
            away = self._element.release(moment, mode, self._values)
            released.append(self._after(away) if jumps else stays)
        found = [
            [self._chosen(self._modes, column) for column in zip(*rows, strict=True)] for rows in (switched, released)
        ]
        for number in (*largest_guards, *found[0], *found[1]):
            self._needed(number)
        pairs = [[(own, new) for own, new in zip(signals, row, strict=True) if not same(own, new)] for row in found]
        return Memory(
            guard=self._chosen(self._modes, largest_guards), mode=found[0][0], switched=pairs[0], released=pairs[1]
        )

    def all_outputs(self, inputs: Sequence[Any]) -> list[Any]:
        """Return the outputs."""
        return self._joined(inputs, self._outputs)

    def _recorded(self, law: Law) -> list[Mode]:
        """Return the modes that it can come to, rising."""
        zero = np.zeros((1, 1))
        start = [zero + entry for entry in law.element.initial(law.real)]
        self._begins = law.element.start(Moment(t=zero, x=start, z=[zero] * self._count), law.real)
        count = len(law.element.ports(law.real).outputs)
        slopes, outputs = ([self._graph.signal() for _ in range(n)] for n in (self._count, count))
        moment = Moment(t=self._time, x=self.states, z=self._open, slope=slopes, y=outputs)
        pending, found = self._with_unheld(moment, self._begins, [self._begins]), set[Mode]()
        while pending:
            mode = pending.pop()
            if mode in found:
                continue
            found.add(mode)
            if len(found) > MOST_MODES:
                raise UnsuitableError(f"{self.label}: it has more than {MOST_MODES} modes")
            try:
                pending += self._following(moment, mode)
            except UnsuitableError as error:
                raise UnsuitableError(f"{self.label}: {error}") from None
        return sorted(found)

    def _following(self, moment: Moment, mode: Mode) -> list[Mode]:
        """Return the modes that may follow a mode."""
        element, values = self._element, self._values
        found = [element.release(moment, mode, values).mode]
        for number, guard in enumerate(element.guards(moment, mode, values)):
            if _may_end(guard):
                found += self._graph.choices(element.switch(number, moment, mode, values).mode)
        return self._with_unheld(moment, mode, found)

    def _with_unheld(self, moment: Moment, before: Mode, modes: list[Mode]) -> list[Mode]:
        """Return modes with those that follow where some of them cannot hold."""
        held = [mode for mode in modes if self._element.held(mode) is not None]
        return modes + [self._element.unheld(moment, mode, self._values, before=before).mode for mode in held]

    def _switch(self, guard: int, moment: Moment, mode: Mode, *, holds: bool) -> Change:
        """Return what follows a guard; an input that nothing ``holds``, or can hold, is not held."""
        change = self._element.switch(guard, moment, mode, self._values)
        if isinstance(change.mode, Signal) or self._element.held(change.mode) is None:
            return change
        if holds and change.mode in self.holding:
            return change
        return self._element.unheld(moment, change.mode, self._values, before=mode)

    def _after(self, change: Change) -> list[Any]:
        """Return mode and states after a change."""
        return [
            change.mode if isinstance(change.mode, Signal) else float(change.mode),
            *(self.states if change.x is None else change.x),
        ]

    def _outputs(self, moment: Moment, mode: Mode, values: Values) -> Sequence[Any]:
        found = list(self._element.outputs(moment, mode, values))
        held = self._element.held(mode)
        if held is not None:
            found[held] = self.hold
        return found

    def _selected(self, inputs: Sequence[Any], alternatives: Sequence[Any]) -> Any:
        del inputs  # the mode alone decides
        return self._chosen(self._modes, alternatives)

    def _chosen(self, modes: Sequence[Mode], alternatives: Sequence[Any]) -> Any:
        """Return what belongs to the mode, of one entry for each of some modes."""
        found = alternatives[0]
        for below, above, own in zip(modes, modes[1:], alternatives[1:], strict=False):
            if not same(own, found):
                found = joined(self._graph, self.mode - 0.5 * (below + above), own, found)
        return found


def recorded(law: Law, values: Values, graph: SignalGraph) -> RecordedLaw:
    """Return a law as formulas.

    Raises
    ------
    UnsuitableError
        If it is none.
    """
    kind: Callable[..., RecordedLaw] = RecordedLaw if modes_of_the_instant(law) is not None else RememberingLaw
    return kind(law, values, graph)


def _may_end(guard: Any) -> bool:
    """Whether a guard can become positive: a negative number never does."""
    return isinstance(guard, Signal) or bool(guard > 0)
