"""Laws without memory that act at samples alone, beside samplers.

What sees nothing but what one sampler holds changes when that does; what nobody but one sampler asks for counts when that samples.
Either has one state more, its output, which jumps right behind that sampler, or right before it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.elements._sampler import Sampler
from engine.exact.laws.system import NonlinearSystem
from engine.exact.sampled_data import transport
from engine.exact.sampled_data.jumps import times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from engine.exact.laws.laws import Law

Flags = npt.NDArray[np.bool_]

_BESIDE: Final = 0.25
"""How far behind a sampler, or before it, a law stands in the order of what acts together; the next one in a row half as far again."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Turn:
    """When a law acts: at the instants of a ``clock``, among those that act together by ``turn`` and ``number``."""

    clock: transport.Clock
    turn: int
    number: float


def with_outputs(system: NonlinearSystem) -> NonlinearSystem:
    """Return a system in which each law without memory has one state, its output."""
    first, laws = system.linear_states, []
    for law in system.laws:
        count = law.states.stop - law.states.start if issubclass(law.element, Sampler) else 1
        laws.append(replace(law, states=slice(first, first + count)))
        first += count
    return NonlinearSystem(system.matrices, laws, system.inputs, system.outputs)


def turns(system: NonlinearSystem, outputs: Sequence[int]) -> dict[int, Turn] | None:
    """Return when each law without memory acts, by its number; None where one does not act at samples alone.

    Parameters
    ----------
    system : NonlinearSystem
        Of samplers and laws without memory.
    outputs : sequence of int
        Those that are looked at.
    """
    m = {name: np.any(matrix != 0, axis=0) for name, matrix in system.matrices.items() if matrix.ndim == 3}
    others = [k for k, law in enumerate(system.laws) if not issubclass(law.element, Sampler)]
    if any(system.laws[k].element.limiting(system.laws[k].values) is None for k in others):
        return None
    found: dict[int, Turn] = {}
    behind = _behind(system.laws, others, m)
    for depth, (k, sampler) in enumerate(behind.items()):
        found[k] = _turn(system, sampler, behind=True, number=sampler + _BESIDE * (2 - 0.5**depth))
    asked = [k for k in others if k not in behind]
    before = _before(system.laws, asked, m, outputs)
    for depth, (k, sampler) in enumerate(before.items()):
        found[k] = _turn(system, sampler, behind=False, number=sampler - _BESIDE * (2 - 0.5**depth))
    return found if len(found) == len(others) else None


def _behind(laws: Sequence[Law], others: Sequence[int], m: dict[str, Flags]) -> dict[int, int]:
    """Return the laws that see what one sampler holds, or what such a law makes of it, with that sampler; who is seen comes first."""
    found: dict[int, int] = {}
    for _ in others:
        for k in others:
            row = laws[k].inputs.start
            if k in found or any(m[name][row].any() for name in ("c3", "d31", "d32")):
                continue
            seen = [j for j, law in enumerate(laws) if m["d33"][row, law.outputs].any()]
            sources = {found.get(j, j) for j in seen}
            if len(sources) == 1 and issubclass(laws[source := sources.pop()].element, Sampler):
                found[k] = source
    return found


def _before(laws: Sequence[Law], asked: Sequence[int], m: dict[str, Flags], outputs: Sequence[int]) -> dict[int, int]:
    """Return the laws for which one sampler asks, or a law of such, with that sampler; who is asked last comes first."""
    found: dict[int, int] = {}
    for _ in asked:
        for k in asked:
            column = laws[k].outputs.start
            shown = m["b3"][:, column].any() or m["d13"][list(outputs), column].any() or m["d23"][:, column].any()
            if k in found or shown or m["d32"][laws[k].inputs.start].any():
                continue
            askers = [j for j, law in enumerate(laws) if m["d33"][law.inputs, column].any()]
            sources = {found.get(j, j) for j in askers}
            if len(sources) == 1 and issubclass(laws[source := sources.pop()].element, Sampler):
                found[k] = source
    return found


def _turn(system: NonlinearSystem, sampler: int, *, behind: bool, number: float) -> Turn:
    law, lanes = system.laws[sampler], system.lanes
    period, late = law.element.period(law.values), times(law.element.latency(law.values), lanes)
    assert period is not None
    clock = transport.Clock(
        label=law.label, period=times(period, lanes), first=times(law.element.offset(law.values), lanes)
    )
    if behind and np.any(late):
        return Turn(clock=clock.moved(late), turn=0, number=number)
    return Turn(clock=clock, turn=1, number=number)
