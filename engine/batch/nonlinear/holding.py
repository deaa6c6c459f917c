"""What laws hold: the output that keeps a surface at 0, and the impulse that brings it there.

    s' = b + a h = 0,   h = -b/a;   x⁺ = x - g s/a,   g = ∂f/∂h

s is the surface of a mode that holds, h the output held, f the rates of the states. Where a is 0 the output moves nothing, and the mode
does not hold.

References
----------
A. F. Filippov, "Differential Equations with Discontinuous Righthand Sides", Kluwer 1988, chapter 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from engine.batch.nonlinear.choices import same
from engine.batch.nonlinear.remembering import RememberingLaw
from engine.batch.nonlinear.signals import SignalGraph, choose
from engine.batch.nonlinear.slopes import slopes, substituted
from engine.elements._nonlinear import Mode
from engine.model.traced import UnsuitableError


@dataclass(frozen=True, kw_only=True, eq=False)
class _Hold:
    """One mode that holds: what the output then ``takes``, how far the surface is ``away`` from 0, and what states change by."""

    mode: Mode
    takes: Any
    away: Any
    impulse: list[Any]


class Holds:
    """What the laws of a diagram hold; see :func:`held`."""

    def __init__(self, graph: SignalGraph, holds: Mapping[RememberingLaw, Sequence[_Hold]]) -> None:
        self._graph, self._holds = graph, holds
        self._taken = {  # a law that holds nothing never comes to a mode that would
            law.hold.node: law.among_held([hold.takes for hold in own]) if own else 0.0 for law, own in holds.items()
        }

    def put_in(self, numbers: Sequence[Any]) -> list[Any]:
        """Return numbers with what it takes in place of the outputs that are held."""
        return substituted(self._graph, numbers, self._taken) if self._taken else list(numbers)

    def away(self, law: RememberingLaw, after: Any) -> Any:
        """Return how far from 0 the surface is that a law comes to hold when the mode ``after`` follows; else 0."""
        return self._entered(law, after, [hold.away for hold in self._holds[law]])

    def entered(self, law: RememberingLaw, after: Any, state: int) -> Any:
        """Return by how much a state, by its number, changes when the mode ``after`` follows."""
        return self._entered(law, after, [hold.impulse[state] for hold in self._holds[law]])

    def _entered(self, law: RememberingLaw, after: Any, numbers: Sequence[Any]) -> Any:
        total: Any = 0.0
        for hold, number in zip(self._holds[law], self.put_in(numbers), strict=True):
            comes, stays = (0.25 - (mode - hold.mode) * (mode - hold.mode) for mode in (after, law.mode))
            total = choose(comes, choose(stays, 0.0, number), total)
        return total


def held(
    graph: SignalGraph, laws: Sequence[tuple[RememberingLaw, Sequence[Any]]], rates: Sequence[Any], seeds: Mapping[int, Any]
) -> Holds:  # fmt: skip
    """Return what laws with these inputs hold; modes that do not hold are struck off `RememberingLaw.holding`.

    Parameters
    ----------
    graph : SignalGraph
    laws : sequence of (RememberingLaw, inputs)
    rates : sequence
        Of all states, with the outputs that are held as signals.
    seeds : mapping of int to number
        The time derivative of each signal, by its node.

    Raises
    ------
    UnsuitableError
        If two laws hold what moves together, or one what it moves at once.
    """
    found: dict[RememberingLaw, list[_Hold]] = {}
    for law, inputs in laws:
        others = {other.hold.node for other, _ in laws if other is not law}
        found[law] = []
        for mode in law.holding:
            surface, here = law.surface(mode, inputs), {law.mode.node: float(mode)}
            (moved,) = slopes(graph, [surface], seeds)
            surface, rate, *flow = substituted(graph, [surface, moved, *rates], here)
            gain, *pushed = slopes(graph, [rate, *flow], {law.hold.node: 1.0})
            if same(gain, 0.0):
                continue
            if any(graph.needs(entry) & {law.hold.node, *others} for entry in (surface, gain, *pushed)):
                raise UnsuitableError(f"{law.label}: what it holds follows an output at once, or not in proportion")
            if graph.needs(rate) & others:
                raise UnsuitableError(f"{law.label}: another law holds what moves with it")
            (free,) = substituted(graph, [rate], {law.hold.node: 0.0})
            impulse = [-(surface / gain) * entry for entry in pushed]
            found[law].append(_Hold(mode=mode, takes=-(free / gain), away=surface, impulse=impulse))
        law.holding[:] = [hold.mode for hold in found[law]]
    return Holds(graph, found)
