"""Where a law jumps with the sign of a signal of which nothing is left: that sign is the one of rounding.

A groundhook law beside a base that has come to rest, a relay behind an oscillation that has died away.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.switching import NEGLIGIBLE, StoppedError
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.elements._nonlinear import Mode
    from engine.exact.laws.system import NonlinearSystem
    from engine.exact.nonlinear.steps import Step

Real = npt.NDArray[np.float64]

_MATTERS: Final = 1e-8
"""A jump, or what is left of the other factor, matters from this part of the largest value on."""
_LONG: Final = 1e-6
"""Part of the time simulated: a guard that only passes through 0 is there for less."""


class Undecided:
    """For how long guards have passed 0 without a switch, because what is left of them counts as 0.

    Parameters
    ----------
    system : NonlinearSystem
        With real values.
    """

    def __init__(self, system: NonlinearSystem) -> None:
        self._system = system
        self._largest: dict[tuple[int, int], float] = defaultdict(float)
        self._lasted: dict[tuple[int, int], float] = defaultdict(float)
        self._said: dict[int, Real] = {}

    def look(self, step: Step, modes: Sequence[Mode], *, width: float, now: float, horizon: float) -> None:
        """Look at a step without an event of which ``width`` (s) is taken.

        Raises
        ------
        StoppedError
            Where a law has been in the wrong mode for long, or may have been.
        """
        own: dict[int, dict[int, Real]] = defaultdict(dict)
        for number, guard, values in step.guards:
            law = self._system.laws[number]
            if law.element.across(guard, modes[number], law.real) is not None:
                own[number][guard] = values
        for number, guards in own.items():
            law, mode = self._system.laws[number], modes[number]
            said = np.concatenate(
                [_sizes(step.nodes.flow.v[0][:, law.outputs]), _sizes(step.nodes.flow.f[0][:, law.states])]
            )
            self._said[number] = np.maximum(self._said.get(number, 0.0), said)
            left = {guard: self._left(number, guard, values) for guard, values in guards.items()}
            for guard, values in guards.items():
                others = [part for other, part in left.items() if other != guard]
                acts = not law.element.product or all(part > _MATTERS for part in others)
                wrong = values.max() > 0 or not (values.any() or law.element.stays(mode))
                gone = left[guard] <= NEGLIGIBLE and acts and wrong
                self._lasted[number, guard] = self._lasted[number, guard] + width if gone else 0.0
                if self._lasted[number, guard] > _LONG * horizon and self._jumps(step, number, guard, mode):
                    raise StoppedError(
                        Verdict.DOUBTFUL,
                        f"which mode {law.label} is in is not known at t = {now:.6g} s: what decides is within {NEGLIGIBLE:g} of "
                        "its largest value from where it switches (give it a transition or hysteresis, or end before)",
                    )

    def _left(self, number: int, guard: int, values: Real) -> float:
        """Return how large a guard is on a step, in parts of the largest that it has been; 1 for one that has always been 0."""
        size = float(np.abs(values).max())
        largest = self._largest[number, guard] = max(self._largest[number, guard], size)
        return size / largest if largest > 0 else 1.0

    def _jumps(self, step: Step, number: int, guard: int, mode: Mode) -> bool:
        """Return whether outputs or rates beyond a guard differ from those on this side by what matters of their largest values."""
        law, nodes = self._system.laws[number], step.nodes
        seen = self._system.seen(number, nodes.at, nodes.flow.e, nodes.flow.v, nodes.slope)
        beyond = law.element.across(guard, mode, law.real)
        assert beyond is not None
        here, there = (
            np.concatenate([_entries(of(seen, m, law.real)) for of in (law.element.outputs, law.element.rates)])
            for m in (mode, beyond)
        )
        return bool((np.abs(there - here) > _MATTERS * self._said[number]).any())


def _sizes(values: Any) -> Real:
    """Return the largest size of each column."""
    return np.asarray(np.abs(np.real(values)).max(axis=0, initial=0.0))


def _entries(signals: Sequence[Any]) -> Real:
    """Return the value of each signal at the end of a step."""
    return np.array([float(np.ravel(np.real(signal))[-1]) for signal in signals])
