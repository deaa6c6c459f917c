"""What happens to the modes that the laws of a diagram remember, as formulas: when they end, what follows, what inputs that jump do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from engine.batch.nonlinear.choices import same
from engine.batch.nonlinear.holding import Holds
from engine.batch.nonlinear.remembering import Memory, RememberingLaw
from engine.batch.nonlinear.signals import SignalGraph
from engine.batch.nonlinear.slopes import slopes
from engine.model.traced import UnsuitableError

Remembering = tuple[RememberingLaw, Sequence[Any]]
"""A law and its inputs."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Changes:
    """What happens at once: ``pairs`` of a signal, a mode or a state, and what it becomes.

    For each law ``guards`` are positive where it happens, and ``residuals`` tell how far an input that begins to be held is from where it
    is held, in the unit of the guard before.
    """

    pairs: list[tuple[Any, Any]]
    guards: list[Any]
    residuals: list[Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class ModeChanges:
    """Formulas of the laws that remember their modes.

    Attributes
    ----------
    modes, begins : list
        The mode of each law, and what it is at rest.
    switched : Changes
        Where a mode ends while inputs move,
    settled : Changes
        in an instant in which it is not known how they move, as behind a jump,
    released : Changes
        and before they jump.
    fitting : list
        The mode that follows where nothing moves.
    """

    modes: list[Any]
    begins: list[float]
    switched: Changes
    settled: Changes
    released: Changes
    fitting: list[Any]

    @classmethod
    def of(
        cls, graph: SignalGraph, laws: Sequence[Remembering], holds: Holds, states: Sequence[Any], seeds: dict[int, Any],
        *, entering: Sequence[Any], at_once: set[int],
    ) -> ModeChanges:  # fmt: skip
        """Return the changes of laws with these inputs.

        Parameters
        ----------
        graph : SignalGraph
        laws : sequence of (RememberingLaw, inputs)
        holds : Holds
        states : sequence
            All of the diagram.
        seeds : dict of int to number
            The time derivative of each signal, by its node.
        entering : sequence
            What goes into the delays.
        at_once : set of int
            Nodes of what may jump by itself.

        Raises
        ------
        UnsuitableError
            If what jumps with a mode goes into a delay: nobody knows beforehand when it comes out.
        """
        moving: list[Memory] = []
        still: list[Memory] = []
        fitting: list[Any] = []
        for law, given in laws:
            if law.jumps and any(law.mode.node in graph.needs(entry) for entry in entering):
                raise UnsuitableError(f"{law.label}: it jumps, and that goes into a delay")
            inputs, outputs = holds.put_in(given), holds.put_in(law.all_outputs(given))
            jumps = any(graph.needs(entry) & at_once for entry in inputs)
            moving.append(law.memory(inputs, slopes(graph, inputs, seeds), jumps=jumps, outputs=outputs))
            still.append(law.memory(inputs, (), jumps=jumps, outputs=outputs, jumped=True))
            fitting.append(law.memory(inputs, (), jumps=jumps, outputs=outputs).mode)
        own = [law for law, _ in laws]
        return cls(
            modes=[law.mode for law in own], begins=[float(law.begins) for law in own],
            switched=_changes(own, moving, holds, states), settled=_changes(own, still, holds, states),
            released=Changes(pairs=[pair for memory in moving for pair in memory.released], guards=[], residuals=[]),
            fitting=fitting,
        )  # fmt: skip


def _changes(
    laws: Sequence[RememberingLaw], memories: Sequence[Memory], holds: Holds, states: Sequence[Any]
) -> Changes:
    pairs = [pair for memory in memories for pair in memory.switched]
    changed = {signal.node for signal, _ in pairs}
    for number, state in enumerate(states):
        total = state
        for law, memory in zip(laws, memories, strict=True):
            total = total + holds.entered(law, memory.mode, number)
        if not same(total, state):
            if state.node in changed:
                raise UnsuitableError("a state that a law sets is moved by what another one begins to hold")
            pairs.append((state, total))
    return Changes(
        pairs=pairs, guards=[memory.guard for memory in memories],
        residuals=[holds.away(law, memory.mode) for law, memory in zip(laws, memories, strict=True)],
    )  # fmt: skip
