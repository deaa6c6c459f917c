"""Choices between formulas, made where the formulas differ: what they have in common is computed once.

    choose(d, f(a), f(b)) = f(choose(d, a, b)),   choose(d, -a, b) = ± choose(d, a, b)

A law that is written mode by mode says almost the same in all of them; a sign or a limit is what is chosen.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from engine.batch.nonlinear.signals import Signal, SignalGraph, choose, largest, least
from engine.model.traced import Op, Traced

_LEAVES: Final = frozenset({Op.CONSTANT, Op.PARAMETER, Op.PAIR})
_COMMUTE: Final = frozenset({Op.ADD, Op.MUL})


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """What a law says where none of its guards is positive."""

    guards: Sequence[Any]
    says: Any = None


def selected(graph: SignalGraph, cases: Sequence[Case]) -> Any:
    """Return what the case says whose guards are not positive; a law has at least one, and never two that disagree."""
    if all(same(case.says, cases[0].says) for case in cases[1:]):
        return cases[0].says
    found = _divided(graph, cases)
    if found is not None:
        decider, above, below = found
        return joined(graph, decider, selected(graph, above), selected(graph, below))
    result = cases[0].says
    for case in cases[1:]:
        if not same(case.says, result):
            result = joined(graph, largest(case.guards), result, case.says)
    return result


def beyond(graph: SignalGraph, cases: Sequence[Case]) -> Any:
    """Return what is positive where every case has a positive guard; None where that cannot be."""
    if any(not case.guards for case in cases):
        return None
    found = _divided(graph, cases)
    if found is None:
        return least([largest(case.guards) for case in cases])
    decider, above, below = found
    parts = [beyond(graph, part) for part in (above, below)]
    if parts[0] is None and parts[1] is None:
        return None
    return choose(decider, *(-1.0 if part is None else part for part in parts))


def same(a: Any, b: Any) -> bool:
    """Whether two numbers are the same formula, or the same number."""
    if isinstance(a, Traced) and isinstance(b, Traced):
        return a.node == b.node
    return not isinstance(a, Traced) and not isinstance(b, Traced) and bool(a == b)


def joined(graph: SignalGraph, decider: Any, positive: Any, otherwise: Any) -> Any:
    """Return ``positive`` where ``decider`` is positive, else ``otherwise``, in as few operations as their likeness allows."""
    if not (isinstance(decider, Traced) and isinstance(positive, Traced) and isinstance(otherwise, Traced)):
        return choose(decider, positive, otherwise)
    return _Joining(graph, decider)(positive.node, otherwise.node)


class _Joining:
    """Formulas joined under one decision, each pair of nodes once."""

    def __init__(self, graph: SignalGraph, decider: Traced) -> None:
        self._graph, self._decider = graph, decider
        self._known: dict[tuple[int, int], Any] = {}

    def __call__(self, a: int, b: int) -> Any:
        if a == b:
            return self._graph.number(a)
        if (a, b) not in self._known:
            plain = choose(self._decider, self._graph.number(a), self._graph.number(b))
            self._known[a, b] = min([plain, *self._alike(a, b)], key=self._rows)
        return self._known[a, b]

    def _alike(self, a: int, b: int) -> Iterable[Any]:
        """Yield the choice made further down, where the outermost operations allow it."""
        (op, *left), (other, *right) = self._graph.nodes[a], self._graph.nodes[b]
        if op is Op.NEG and other is not Op.NEG:
            joint = self(left[0], b)
            yield choose(self._decider, -joint, joint)
        elif other is Op.NEG and op is not Op.NEG:
            joint = self(a, right[0])
            yield choose(self._decider, joint, -joint)
        elif op is Op.CHOOSE and other is Op.CHOOSE:
            (_, *own), (_, *theirs) = self._graph.nodes[left[1]], self._graph.nodes[right[1]]
            yield choose(*(self(x, y) for x, y in zip((left[0], *own), (right[0], *theirs), strict=True)))
        elif op is other and op not in _LEAVES:
            orders = [right, right[::-1]] if op in _COMMUTE else [right]
            for order in orders:
                pairs = [(x, y) for x, y in zip(left, order, strict=True) if x >= 0]
                yield self._graph.apply(op, *(self(x, y) for x, y in pairs))

    def _rows(self, entry: Any) -> int:
        """Return how many operations on signals a formula takes."""
        seen: set[int] = set()
        pending = [entry.node] if isinstance(entry, Signal) else []
        while pending:
            node = pending.pop()
            op, first, second = self._graph.nodes[node]
            if node in seen or not (op is Op.PAIR or self._graph.moves(node)):
                continue
            seen.add(node)
            if op not in {Op.CONSTANT, Op.PARAMETER}:
                pending += [k for k in (first, second) if k >= 0]
        return len(seen)


def _divided(graph: SignalGraph, cases: Sequence[Case]) -> tuple[Any, list[Case], list[Case]] | None:
    """Return a guard by whose sign the cases fall into two, and those where it is positive and where it is not."""
    for guard in cases[0].guards if len(cases) > 1 else ():
        above: list[Case] = []
        below: list[Case] = []
        for case in cases:
            own = [k for k in case.guards if same(k, guard)]
            opposite = [k for k in case.guards if _opposite(graph, k, guard)]
            left = [k for k in case.guards if not any(k is entry for entry in (*own, *opposite))]
            if bool(own) == bool(opposite):
                break
            (below if own else above).append(Case(guards=left, says=case.says))
        else:
            if above:
                return guard, above, below
    return None


def _opposite(graph: SignalGraph, a: Any, b: Any) -> bool:
    """Whether one number is seen to be the other one with the opposite sign."""
    if not (isinstance(a, Traced) and isinstance(b, Traced)):
        return False
    (op, *left), (other, *right) = graph.nodes[a.node], graph.nodes[b.node]
    if op is Op.NEG or other is Op.NEG:
        return (op is Op.NEG and left[0] == b.node) or (other is Op.NEG and right[0] == a.node)
    return op is Op.SUB and other is Op.SUB and left == right[::-1]
