"""The real arithmetic of a diagram as a tape: a list of operations on registers, run for eight candidates at a time.

Registers are numbered parameters first, then constants, then results in their order. The tape is data, so a new diagram
compiles nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from engine.batch.kernels.compiled import LANES, compiled
from engine.batch.kernels.vector import load, root, select, store
from engine.model.traced import Op, Traced, nodes_of

if TYPE_CHECKING:
    from engine.model.traced import Graph

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]


class Tape(NamedTuple):
    """``operations`` (K, 3): operation and two registers; ``constants`` (C,); ``parameters``: how many there are."""

    operations: Whole
    constants: Real
    parameters: int


class Registers:
    """The tape of the numbers asked for, and in which register each of them ends up."""

    def __init__(self, graph: Graph, wanted: Sequence[Traced | float], parameters: int) -> None:
        targets = nodes_of(graph, wanted)
        needed: set[int] = set()
        pending = list(targets)
        while pending:
            node = pending.pop()
            if node in needed or node < 0:
                continue
            needed.add(node)
            op, first, second = graph.nodes[node]
            if op < Op.CONSTANT:
                pending += (first, second)
        constants = [node for node in sorted(needed) if graph.nodes[node][0] is Op.CONSTANT]
        results = [node for node in sorted(needed) if graph.nodes[node][0] < Op.CONSTANT]
        self._place: dict[int, int] = {
            node: graph.nodes[node][1] for node in needed if graph.nodes[node][0] is Op.PARAMETER
        }
        self._place.update({node: parameters + k for k, node in enumerate(constants)})
        self._place.update({node: parameters + len(constants) + k for k, node in enumerate(results)})
        rows = [
            (int(op), self._place[first], self._place[second] if second >= 0 else 0)
            for op, first, second in (graph.nodes[node] for node in results)
        ]
        self.tape = Tape(
            operations=np.array(rows, dtype=np.int32).reshape(-1, 3),
            constants=np.array([graph.values[node] for node in constants]),
            parameters=parameters,
        )
        self._graph = graph

    @property
    def count(self) -> int:
        """Number of registers."""
        return self.tape.parameters + len(self.tape.constants) + len(self.tape.operations)

    def of(self, number: Traced | float) -> int:
        """Return the register of a number that was asked for."""
        return self._place[nodes_of(self._graph, [number])[0]]


@compiled
def run(tape: Tape, registers: Real) -> None:
    """Fill the registers (count, LANES) behind the parameters."""
    base = tape.parameters
    for k in range(tape.constants.shape[0]):
        store(registers, tape.constants[k], base + k)
    base += tape.constants.shape[0]
    for k in range(tape.operations.shape[0]):
        op, a, b, to = tape.operations[k, 0], tape.operations[k, 1], tape.operations[k, 2], base + k
        x, y = load(registers, a), load(registers, b)
        if op == 0:
            store(registers, x + y, to)
        elif op == 1:
            store(registers, x - y, to)
        elif op == 2:
            store(registers, x * y, to)
        elif op == 3:
            store(registers, x / y, to)
        elif op == 4:
            store(registers, -x, to)
        elif op == 5:
            store(registers, root(x), to)
        elif op == 10:
            store(registers, select(x == 0.0, 1.0, 0.0), to)
        else:
            for lane in range(LANES):
                value = registers[a, lane]
                if op == 6:
                    registers[to, lane] = math.exp(value)
                elif op == 7:
                    registers[to, lane] = math.log(value)
                elif op == 8:
                    registers[to, lane] = math.sin(value)
                else:
                    registers[to, lane] = math.cos(value)
