"""Equations as programs: what is the same at all instants is computed once for a candidate, the rest is a tape.

A row of a tape is (operation, three operands, result), all but the first being registers. Registers are the states, the inputs with
their slopes, the delayed signals with theirs, the modes that laws remember, the numbers computed once, then temporaries, which are used again as soon as their last reader is done, so that
a tape works in the processor's nearest memory. Constants are numbers computed once: two diagrams of one structure have the same tape.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.batch.nonlinear.arithmetic import Code, Formulas
from engine.batch.nonlinear.equations import Equations
from engine.batch.nonlinear.mode_changes import Changes
from engine.batch.nonlinear.signals import SignalGraph
from engine.model.traced import Op, nodes_of

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangeTape:
    """A tape, and which registers (changes,) are then ``given`` what it has ``made`` in others; ``residuals`` and ``guards`` are registers, too.

    See `engine.batch.nonlinear.mode_changes`.
    """

    tape: Whole
    made: Whole
    given: Whole
    residuals: Whole
    guards: Whole


@dataclass(frozen=True, kw_only=True, eq=False)
class Program:
    """What a march runs.

    Attributes
    ----------
    whole : ndarray of int, shape (K, 5)
        The tape at the beginning of a step, with everything that is read off there.
    rates_only : ndarray of int, shape (K, 5)
        The tape of the other stages.
    rates : ndarray of int, shape (states,)
        Registers of x' after either of them.
    read : ndarray of int
        Registers of what is read off: y and y' of each output watched, and what tells that a law has been left.
    entering : ndarray of int, shape (2 m,)
        Registers of what goes into the m delays, and of the slopes of that.
    guards : ndarray of int
        Registers of what tells that a mode ends, after the tape `whole`.
    switched, settled, released : ChangeTape
        What happens to modes and states then, in an instant behind a jump, and before inputs jump.
    states, inputs, once, registers : int
        How many there are, inputs counted with their slopes, of what is computed once, of registers altogether.
    """

    whole: Whole
    rates_only: Whole
    rates: Whole
    read: Whole
    entering: Whole
    guards: Whole
    switched: ChangeTape
    settled: ChangeTape
    released: ChangeTape
    states: int
    inputs: int
    once: int
    registers: int

    @property
    def first_once(self) -> int:
        """The first register of what is computed once."""
        return self.first_mode + len(self.guards)

    @property
    def first_mode(self) -> int:
        """The first register of the modes that laws remember."""
        return self.states + self.inputs + len(self.entering)

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """What two programs of the same structure have in common."""
        arrays = (self.whole, self.rates_only, self.rates, self.read, self.entering, self.guards)
        return (*(array.tobytes() for array in arrays), self.states, self.inputs, self.once, self.registers)


class Compiled:
    """A program with the formulas of what is computed once for a candidate.

    Parameters
    ----------
    equations : Equations
    watched : sequence of int
        Outputs of the diagram whose curves are wanted.

    Attributes
    ----------
    program : Program
    begins : ndarray, shape (modes,)
        The modes at the beginning.
    """

    def __init__(self, equations: Equations, watched: Sequence[int]) -> None:
        graph = equations.graph
        slopes = equations.output_slopes
        read = [number for output in watched for number in (equations.outputs[output], slopes[output])]
        read.append(-1.0 if equations.outside is None else equations.outside)
        states, inputs, heard = len(equations.states), 2 * len(equations.inputs), 2 * len(equations.heard)
        modes = len(equations.changes.modes)
        register = {signal.node: k for k, signal in enumerate(equations.signals)}
        rates, ends = nodes_of(graph, equations.rates), len(equations.rates) + len(read)
        reads = nodes_of(
            graph, [*read, *equations.entering, *equations.entering_slopes, *equations.changes.switched.guards]
        )
        changes = equations.changes.switched, equations.changes.settled, equations.changes.released
        after = [
            nodes_of(graph, [*(new for _, new in change.pairs), *change.residuals, *change.guards])
            for change in changes
        ]
        wanted = [*rates, *reads, *(node for nodes in after for node in nodes)]
        once = [node for node in _leaves(equations, wanted) if node not in register]
        first = states + inputs + heard + modes + len(once)
        register.update({node: first - len(once) + k for k, node in enumerate(once)})
        parts = [
            equations.start, [graph.number(node) for node in once], [value for _, value in equations.bounds],
            equations.pivots,
        ]  # fmt: skip
        self._start = Formulas(graph, [entry for part in parts for entry in part])
        self._cuts = np.cumsum([len(part) for part in parts])[:-1]
        self.begins = np.array(equations.changes.begins)
        # The rates come first in both tapes and end up in the same registers.
        rate_rows, rate_places, least = _tape(equations, rates, register, first)
        whole, places, last = _tape(equations, [*rates, *reads], register, first)
        tapes = [_tape(equations, nodes, register, first) for nodes in after]
        switched, settled, released = (
            _change_tape(rows, places, change, register)
            for (rows, places, _), change in zip(tapes, changes, strict=True)
        )
        self.program = Program(
            whole=whole, rates_only=rate_rows, rates=np.array(places[: len(rates)]),
            read=np.array(places[len(rates) : ends]),
            entering=np.array(places[ends : len(places) - modes], dtype=np.int64),
            guards=np.array(places[len(places) - modes :], dtype=np.int64),
            switched=switched, settled=settled, released=released, states=states, inputs=inputs, once=len(once),
            registers=max(least, last, *(count for *_, count in tapes)),
        )  # fmt: skip
        assert rate_places == places[: len(rates)]

    def start(self, points: Real) -> tuple[Real, Real, Real, Real]:
        """Return the states at t = 0, what is computed once, the values with bounds and the pivots, each (·, B), of (B, varied)."""
        with np.errstate(all="ignore"):
            found = self._start(points.T)
        first, second, third, fourth = np.split(found, self._cuts)
        return first, second, third, fourth


def _change_tape(rows: Whole, places: Sequence[int], change: Changes, register: Mapping[int, int]) -> ChangeTape:
    count = len(change.pairs)
    made, residuals, guards = np.split(np.array(places, dtype=np.int64), [count, count + len(change.residuals)])
    given = np.array([register[own.node] for own, _ in change.pairs], dtype=np.int64)
    return ChangeTape(tape=rows, made=made, given=given, residuals=residuals, guards=guards)


def _leaves(equations: Equations, targets: Sequence[int]) -> list[int]:
    """Return the nodes that do not move and that something moving, or a target, is made of."""
    graph = equations.graph
    found: dict[int, None] = {}
    for node in _needed(equations, targets):
        op = graph.nodes[node][0]
        if op is Op.PAIR or not graph.moves(node):
            continue
        if op not in {Op.CONSTANT, Op.PARAMETER}:
            found.update({k: None for k in _operands(graph, node) if not graph.moves(k)})
    found.update({node: None for node in targets if not graph.moves(node)})
    return sorted(found)


def _needed(equations: Equations, targets: Sequence[int]) -> list[int]:
    """Return all moving nodes that the targets are made of, operands first."""
    graph = equations.graph
    needed: set[int] = set()
    pending = [node for node in targets if graph.moves(node)]
    while pending:
        node = pending.pop()
        if node in needed or node < 0 or not (graph.nodes[node][0] is Op.PAIR or graph.moves(node)):
            continue
        needed.add(node)
        op, first, second = graph.nodes[node]
        if op not in {Op.CONSTANT, Op.PARAMETER}:
            pending += (first, second)
    return sorted(needed)


def _tape(
    equations: Equations, targets: Sequence[int], register: dict[int, int], first: int
) -> tuple[Whole, list[int], int]:
    """Return the rows that compute ``targets``, the register of each of them, and how many registers there are."""
    graph = equations.graph
    order = [k for k in _needed(equations, targets) if k not in register and graph.nodes[k][0] is not Op.PAIR]
    asked = set(targets)
    rows = _fused(graph, order, asked)
    readers: dict[int, int] = {}
    for number, (_, operands, _) in enumerate(rows):
        readers.update(dict.fromkeys(operands, number))
    place = dict(register)
    # Targets keep registers of their own, in the order in which they are asked for, whatever else is computed.
    kept: list[int] = []
    following = first
    copies = []
    for number, node in enumerate(targets):
        # the march overwrites the states while it reads the rates: a rate that is a state is copied
        if node not in place or (number < len(equations.states) and place[node] < len(equations.states)):
            if node in place:
                copies.append((int(Code.COPY), place[node], following))
            else:
                place[node] = following
            kept.append(following)
            following += 1
        else:
            kept.append(place[node])
    free: list[int] = []
    found: list[list[int]] = []
    for number, (code, operands, node) in enumerate(rows):
        sources = [place[k] for k in operands]
        free += [place[k] for k in set(operands) if readers[k] == number and k not in register and k not in asked]
        if node not in place:
            if not free:
                free.append(following)
                following += 1
            place[node] = free.pop()
        found.append([int(code), *sources, *[sources[0]] * (3 - len(sources)), place[node]])
    found += [[code, source, source, source, to] for code, source, to in copies]
    return np.array(found, dtype=np.int64).reshape(-1, 5), kept, following


def _fused(graph: SignalGraph, order: Sequence[int], asked: set[int]) -> list[tuple[Code, tuple[int, ...], int]]:
    """Return (operation, operands, node) of each row; a product that is only added to something is one row with the sum."""
    made = {node: (Code(int(graph.nodes[node][0])), _operands(graph, node)) for node in order}
    uses = Counter(k for _, operands in made.values() for k in operands)
    alone = {k for k, (code, _) in made.items() if code == Code.MUL and uses[k] == 1 and k not in asked}
    swallowed: set[int] = set()
    for node, (code, operands) in made.items():
        if code not in {Code.ADD, Code.SUB}:
            continue
        a, b = operands
        if a in alone:
            made[node] = (Code.MULTIPLY_ADD if code == Code.ADD else Code.MULTIPLY_SUBTRACT, (*made[a][1], b))
            swallowed.add(a)
        elif b in alone:
            made[node] = (Code.MULTIPLY_ADD if code == Code.ADD else Code.SUBTRACT_PRODUCT, (*made[b][1], a))
            swallowed.add(b)
    return [(code, operands, node) for node, (code, operands) in made.items() if node not in swallowed]


def _operands(graph: SignalGraph, node: int) -> tuple[int, ...]:
    op, first, second = graph.nodes[node]
    if op is Op.CHOOSE:
        return (first, *graph.nodes[second][1:])
    return (first, second) if second >= 0 else (first,)
