"""A diagram with nonlinear laws as formulas: what drives every state, what every output is, and how fast it moves.

    x' = f(x, u, w; p),   y = g(x, u, w; p),   y' = ∂g/∂x f + ∂g/∂u u' + ∂g/∂w w',   w_i(t) = z_i(t - τ_i)

The linear blocks are joined by the sparse elimination of the linear kernels, the laws being channels of them, as on the exact
path; laws are then put in, in an order in which their inputs are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from engine.batch.kernels.assembly import Assembly, Row
from engine.batch.nonlinear.holding import held
from engine.batch.nonlinear.mode_changes import ModeChanges
from engine.batch.nonlinear.remembering import RememberingLaw, recorded
from engine.batch.nonlinear.signals import SignalGraph, largest
from engine.batch.nonlinear.slopes import slopes
from engine.model.parameters import Param
from engine.model.traced import Traced, UnsuitableError

if TYPE_CHECKING:
    from engine.diagram.diagram import Diagram

MOST_STATES: Final = 64


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """Formulas of a diagram in its parameters ``varied`` and in signals.

    Attributes
    ----------
    states, inputs, input_slopes : list
        The signals; slopes are those of the inputs in time.
    start : list
        The states at t = 0, formulas of the parameters.
    rates : list
        x'.
    outputs, output_slopes : list
        y and y', in the order of the diagram's outputs.
    heard, heard_slopes, entering, entering_slopes : list
        Signals w that come out of the delays, what goes in, z, and the slopes of both in time.
    delays : tuple of float
        τ, s: the same for all candidates.
    outside : number or None
        Positive where a law has left what its formula covers; None where none can.
    changes : ModeChanges
        What happens to modes that laws remember.
    bounds : tuple of (Param, Traced)
        Values that have physical bounds.
    pivots : tuple
        What was divided by, on the way through algebraic loops.
    """

    graph: SignalGraph
    varied: tuple[str, ...]
    states: list[Any]
    inputs: list[Any]
    input_slopes: list[Any]
    start: list[Any]
    rates: list[Any]
    outputs: list[Any]
    output_slopes: list[Any]
    heard: list[Any]
    heard_slopes: list[Any]
    entering: list[Any]
    entering_slopes: list[Any]
    delays: tuple[float, ...]
    outside: Any
    changes: ModeChanges
    bounds: tuple[tuple[Param, Traced], ...]
    pivots: tuple[Any, ...]

    @property
    def unknowns(self) -> list[Any]:
        """What is to be found where all is at rest: states and delayed signals."""
        return [*self.states, *self.heard]

    @property
    def drifts(self) -> list[Any]:
        """What is 0 there: rates, and by how much what goes into the delays differs from what comes out."""
        return [*self.rates, *(z - w for z, w in zip(self.entering, self.heard, strict=True))]

    @property
    def signals(self) -> list[Any]:
        """All that moves by itself: states, inputs and their slopes, delayed signals and their slopes; modes."""
        return [*self.states, *self.inputs, *self.input_slopes, *self.heard, *self.heard_slopes, *self.changes.modes]

    @classmethod
    def of(cls, diagram: Diagram, varied: Sequence[str]) -> Equations:
        """Return the equations of a diagram.

        Raises
        ------
        UnsuitableError
            If the diagram has delays that vary or too many states, a law that is no formula, or an algebraic loop through laws.
        """
        with np.errstate(all="ignore"):  # formulas are written with all signals at 0, where they may have no value
            return _Writer(diagram, varied).equations()


class _Writer:
    def __init__(self, diagram: Diagram, varied: Sequence[str]) -> None:
        self._varied = tuple(varied)
        self._graph = SignalGraph()
        self._traced = diagram.trace(varied, self._graph)
        if any(isinstance(length, Traced) for block in self._traced.realizations for length in block.delays.tolist()):
            raise UnsuitableError("a delay that varies")
        try:
            self._assembly = Assembly.of(self._traced, self._traced.opened)
        except ZeroDivisionError:
            raise UnsuitableError("an algebraic loop without a solution") from None
        nominal = diagram.laws()
        self._laws = [
            recorded(law, values, self._graph) for law, values in zip(nominal.laws, self._traced.laws, strict=True)
        ]
        self._entering = [law.inputs.start for law in nominal.laws]
        self._owner = [(number, k) for number, law in enumerate(nominal.laws) for k in range(_length(law.outputs))]
        self._inputs = [self._graph.signal() for _ in diagram.inputs]
        self._slopes = [self._graph.signal() for _ in diagram.inputs]
        self._heard = [self._graph.signal() for _ in self._assembly.delays]
        self._heard_slopes = [self._graph.signal() for _ in self._assembly.delays]
        self._outputs = len(diagram.outputs)
        self._linear = [self._graph.signal() for _ in range(self._assembly.states)]
        if len(self._linear) + sum(len(law.states) for law in self._laws) > MOST_STATES:
            raise UnsuitableError(f"more than {MOST_STATES} states")
        self._channels: list[Any] = [None] * len(self._owner)
        self._pending: set[int] = set()

    def equations(self) -> Equations:
        for channel in range(len(self._channels)):
            self._output(channel)
        entered = [self._inputs_of(number, [True] * self._size(number)) for number in range(len(self._laws))]
        states = [*self._linear, *(state for law in self._laws for state in law.states)]
        rates = [self._sum(row) for row in self._assembly.flow]
        start = list(_initial(self._traced.realizations))
        outside = []
        for law, given in zip(self._laws, entered, strict=True):
            rates += law.rates(given)
            start += law.initial
            beyond = None if isinstance(law, RememberingLaw) else law.outside(given)
            outside += [] if beyond is None else [beyond]
        outputs = [self._sum(row) for row in self._assembly.reads[: self._outputs]]
        entering = [self._sum(row) for row in self._assembly.entering]
        moving = [*states, *self._inputs, *self._heard]
        remembering = [
            (law, inputs) for law, inputs in zip(self._laws, entered, strict=True) if isinstance(law, RememberingLaw)
        ]

        def seeds() -> dict[int, Any]:
            pairs = zip(moving, [*rates, *self._slopes, *self._heard_slopes], strict=True)
            return {signal.node: slope for signal, slope in pairs}

        holds = held(self._graph, remembering, rates, seeds())
        rates, outputs, entering = (holds.put_in(part) for part in (rates, outputs, entering))
        found = slopes(self._graph, [*outputs, *entering], seeds())
        return Equations(
            graph=self._graph, varied=self._varied, states=states, inputs=self._inputs, input_slopes=self._slopes,
            start=start, rates=rates, outputs=outputs, output_slopes=found[: len(outputs)], heard=self._heard,
            heard_slopes=self._heard_slopes, entering=entering, entering_slopes=found[len(outputs) :],
            delays=tuple(float(length) for length in self._assembly.delays),
            outside=largest(outside) if outside else None, bounds=self._traced.bounds, pivots=tuple(self._assembly.pivots),
            changes=ModeChanges.of(
                self._graph, remembering, holds, states, seeds(), entering=entering,
                at_once={signal.node for signal in (*self._inputs, *self._heard)},
            ),
        )  # fmt: skip

    def _size(self, number: int) -> int:
        """Return how many inputs a law has."""
        bounds = [*self._entering, len(self._assembly.reads) - self._outputs]
        return int(bounds[number + 1] - bounds[number])

    def _inputs_of(self, number: int, wanted: Sequence[bool]) -> list[Any]:
        """Return the inputs of a law, None where they are not wanted."""
        first = self._outputs + self._entering[number]
        rows = self._assembly.reads[first : first + len(wanted)]
        return [self._sum(row) if want else None for row, want in zip(rows, wanted, strict=True)]

    def _sum(self, row: Row) -> Any:
        """Return a row times states, inputs, the outputs of laws and delayed signals."""
        total: Any = 0.0
        known = [*self._linear, *self._inputs]
        for column, factor in sorted(row.items()):
            own, heard = column - len(known), column - len(self._linear) - self._assembly.externals
            if own < 0:
                total = factor * known[column] + total
                continue
            signal = self._output(own) if heard < 0 else self._heard[heard]
            total = factor * signal + total
        return total

    def _output(self, channel: int) -> Any:
        if self._channels[channel] is None:
            number, k = self._owner[channel]
            law = self._laws[number]
            if channel in self._pending:
                raise UnsuitableError(f"{law.label}: an algebraic loop through it")
            self._pending.add(channel)
            self._channels[channel] = law.output(k, self._inputs_of(number, law.needs(k)))
            self._pending.remove(channel)
        return self._channels[channel]


def _initial(realizations: Sequence[Any]) -> list[Any]:
    found: list[Any] = []
    for block in realizations:
        states = block.a.shape[-1]
        found += [0.0] * states if block.initial is None else block.initial.tolist()
    return found


def _length(span: slice) -> int:
    return int(span.stop - span.start)
