"""A nonlinear law as one formula: its formulas in all modes, and a choice between them.

A law is in the mode none of whose guards is positive. Where that is always one mode, at most neighbours on their common edge, the
choice is a formula of the instant, y = g_k(x, z) with max h_k(x, z) <= 0. A jump of the states (an impact) is no formula of the
instant: such a law is followed until then, and `outside` tells. Laws that take samples are refused; those whose mode only the past
tells, or that hold an input, are in `engine.batch.nonlinear.remembering`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.nonlinear.choices import Case, beyond, same, selected
from engine.batch.nonlinear.signals import SignalGraph
from engine.elements._base import Values
from engine.elements._nonlinear import Mode, Moment
from engine.exact.laws.laws import Law
from engine.model.traced import UnsuitableError

MOST_MODES: Final = 16
_SAMPLES: Final = 256
_WAYS: Final = 32
_HALVINGS: Final = 100
_ROUNDING: Final = 1e-9


class RecordedLaw:
    """One law of a diagram, its values being formulas of the parameters.

    Parameters
    ----------
    law : Law
        With its values at the document's parameters, which tell what modes it knows.
    values : mapping
        The block's values, traced.
    graph : SignalGraph

    Attributes
    ----------
    states : list
        A signal for each of its states.
    initial : sequence
        Where they begin.

    Raises
    ------
    UnsuitableError
        If the law is no formula.
    """

    def __init__(self, law: Law, values: Values, graph: SignalGraph) -> None:
        self.label = law.label
        self._element, self._values, self._graph = law.element, values, graph
        self._count = law.inputs.stop - law.inputs.start
        self.states = [graph.signal() for _ in range(law.states.stop - law.states.start)]
        self.initial = law.element.initial(values)
        self._time = graph.signal()
        self._open = [graph.signal() for _ in range(self._count)]
        self._modes = self._recorded(law)
        self._chooses = False
        # what an output depends on is seen from its formula, written once with inputs that nothing drives
        whole = self._joined(self._open, self._outputs)
        self._needs = [self._needed(output) for output in whole]

    def needs(self, output: int) -> list[bool]:
        """Tell which inputs an output depends on at once."""
        return self._needs[output]

    def output(self, number: int, inputs: Sequence[Any]) -> Any:
        """Return an output; inputs that it does not depend on may be None."""
        given = [own if entry is None else entry for entry, own in zip(inputs, self._open, strict=True)]
        return self._joined(given, self._outputs)[number]

    def rates(self, inputs: Sequence[Any]) -> list[Any]:
        """Return the time derivative of each state."""
        found = self._joined(inputs, self._element.rates)
        for rate in found:
            self._needed(rate)
        return found

    def outside(self, inputs: Sequence[Any]) -> Any:
        """Return what becomes positive where the law leaves all modes that are formulas; None where it cannot."""
        alone = len(self._modes) == 1
        if alone and not self._element.guards(self._moment(inputs), self._modes[0], self._values):
            return None
        if not alone and not self._chooses:
            return None
        return beyond(self._graph, [Case(guards=self._guards(mode, inputs)) for mode in self._modes])

    def _recorded(self, law: Law) -> list[Mode]:
        """Return the modes that are recorded."""
        modes = modes_of_the_instant(law)
        assert modes is not None
        return modes

    def _outputs(self, moment: Moment, mode: Mode, values: Values) -> Sequence[Any]:
        return self._element.outputs(moment, mode, values)

    def _moment(self, inputs: Sequence[Any]) -> Moment:
        return Moment(t=self._time, x=self.states, z=inputs)

    def _guards(self, mode: Mode, inputs: Sequence[Any]) -> list[Any]:
        guards = list(self._element.guards(self._moment(inputs), mode, self._values))
        if not guards:
            raise UnsuitableError(f"{self.label}: what ends its modes depends on more than its inputs and states")
        return guards

    def _joined(self, inputs: Sequence[Any], of: Callable[..., Any]) -> list[Any]:
        """Return what a law says in the mode that it is in."""
        moment = self._moment(inputs)
        try:
            found = [list(of(moment, mode, self._values)) for mode in self._modes]
            return [self._selected(inputs, alternatives) for alternatives in zip(*found, strict=True)]
        except UnsuitableError as error:
            raise UnsuitableError(
                str(error) if str(error).startswith(self.label) else f"{self.label}: {error}"
            ) from None

    def _selected(self, inputs: Sequence[Any], alternatives: Sequence[Any]) -> Any:
        if all(same(own, alternatives[0]) for own in alternatives[1:]):
            return alternatives[0]
        self._chooses = True
        cases = [
            Case(guards=self._guards(mode, inputs), says=own)
            for mode, own in zip(self._modes, alternatives, strict=True)
        ]
        return selected(self._graph, cases)

    def _needed(self, entry: Any) -> list[bool]:
        signals = self._graph.needs(entry)
        if self._time.node in signals:
            raise UnsuitableError(f"{self.label}: it depends on the time")
        return [own.node in signals for own in self._open]


def modes_of_the_instant(law: Law) -> list[Mode] | None:
    """Return the modes that a law can come to without a jump of its states; None where only the past tells which one it is in."""
    element, values = law.element, law.real
    if element.period(values) is not None:
        raise UnsuitableError(f"{law.label}: it takes samples")
    zero, inputs = np.zeros((1, 1)), law.inputs.stop - law.inputs.start
    x = [zero + entry for entry in element.initial(values)]
    outputs = [zero] * len(element.ports(values).outputs)
    rest = Moment(t=zero, x=x, z=[zero] * inputs, y=outputs)
    pending = [element.start(rest, values)]
    found: list[Mode] = []
    while pending:
        mode = pending.pop(0)
        if mode in found:
            continue
        guards = element.guards(rest, mode, values)
        if element.held(mode) is not None or len(found) == MOST_MODES or (found and not guards):
            return None
        found.append(mode)
        for number, guard in enumerate(guards):
            if isinstance(guard, np.ndarray) or guard > 0:  # a guard that is a negative number never ends anything
                change = element.switch(number, rest, mode, values)
                jumps = change.x is not None and not all(np.array_equal(a, b) for a, b in zip(change.x, x, strict=True))
                if not jumps and (change.x is not None or change.mode == mode):
                    return None
                pending += [] if jumps else [change.mode]
    if (len(found) > 1 or element.guards(rest, found[0], values)) and _overlap(law, found, _anywhere(x, inputs)):
        return None
    return found


def _anywhere(x: Sequence[Any], inputs: int) -> Moment:
    """Return instants at which states and inputs are anything, from very small to very large."""
    chance = np.random.default_rng(0)

    def spread(around: Any) -> Any:
        sizes = 10.0 ** chance.uniform(-9, 9, (1, _SAMPLES)) * chance.choice([-1.0, 0.0, 1.0], (1, _SAMPLES))
        return around + sizes

    return Moment(t=np.zeros((1, _SAMPLES)), x=[spread(entry) for entry in x], z=[spread(0.0) for _ in range(inputs)])


def _overlap(law: Law, modes: Sequence[Mode], moment: Moment) -> bool:
    """Whether a law could be in two modes at the same instant: seen where the way from one of them into the other leaves the first."""
    with np.errstate(all="ignore"):
        largest = {mode: _largest(law, mode, moment) for mode in modes}
        inside = {mode: guard < 0 for mode, guard in largest.items()}
        if np.any(np.sum(list(inside.values()), axis=0) > 1):
            return True
        return any(
            _reaches_into(law, (a, b), moment, np.flatnonzero(inside[a]), np.flatnonzero(inside[b]))
            for a in modes for b in modes if a != b
        )  # fmt: skip


def _reaches_into(
    law: Law, modes: tuple[Mode, Mode], moment: Moment, begins: npt.NDArray[np.intp], ends: npt.NDArray[np.intp]
) -> bool:
    """Whether the edge of a mode, on straight ways from instants inside it to instants inside another one, lies inside the other."""
    (mode, other), count = modes, min(len(begins), len(ends), _WAYS)
    if not count:
        return False
    begins, ends = begins[:count], ends[-count:]

    def between(part: npt.NDArray[np.float64]) -> Moment:
        mixed = [
            [(1 - part) * entry[:, begins] + part * entry[:, ends] for entry in entries]
            for entries in (moment.x, moment.z)
        ]
        return Moment(t=np.zeros((1, count)), x=mixed[0], z=mixed[1])

    low, high = np.zeros(count), np.ones(count)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        outside = _largest(law, mode, between(middle)) > 0
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    there = _largest(law, other, between(low))
    size = np.maximum(
        np.abs(_largest(law, other, between(np.zeros(count)))), np.abs(_largest(law, other, between(np.ones(count))))
    )
    return bool(np.any(there < -_ROUNDING * size))


def _largest(law: Law, mode: Mode, moment: Moment) -> npt.NDArray[np.float64]:
    """Return the largest guard of a mode at instants (1, N), (N,); infinity where there are none."""
    shape = np.shape(moment.t)
    guards = [np.broadcast_to(guard, shape)[0] for guard in law.element.guards(moment, mode, law.real)]
    return np.asarray(np.max(guards, axis=0) if guards else np.full(shape[1], np.inf))
