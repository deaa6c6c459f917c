"""Where a law decides by a signal of which nothing is left: its sign turns on or off what still acts, and is that of rounding.

A groundhook law beside a base that has come to rest, a relay behind an oscillation that has died away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from engine.exact.nonlinear.switching import NEGLIGIBLE, StoppedError
from engine.model.verdicts import Verdict

if TYPE_CHECKING:
    from engine.elements._nonlinear import Mode
    from engine.exact.laws.laws import Law

Real = npt.NDArray[np.float64]

_MOVES: Final = 1e-8
"""More than this part of its largest value is left of a guard that is not 0."""
_LONG: Final = 1e-6
"""Part of the time simulated: a guard that only passes through 0 is there for less."""


class Undecided:
    """For how long guards have passed 0 without a switch, because what is left of them counts as 0."""

    def __init__(self) -> None:
        self._largest: dict[tuple[int, int], float] = {}
        self._lasted: dict[tuple[int, int], float] = {}

    def look(
        self,
        laws: Sequence[Law],
        modes: Sequence[Mode],
        guards: Sequence[tuple[int, int, Real]],
        *,
        width: float,
        now: float,
        horizon: float,
    ) -> None:
        """Look at a step of ``width`` (s) that has no event, at the guards (law, guard, values at its nodes).

        Raises
        ------
        StoppedError
            Where a law has been in the wrong mode for long, or may have been.
        """
        for number, (law, mode) in enumerate(zip(laws, modes, strict=True)):
            if not law.element.decides(mode, law.real):
                continue
            own = {guard: values for of, guard, values in guards if of == number}
            left = {guard: self._left(number, guard, values) for guard, values in own.items()}
            for guard, values in own.items():
                acts = all(part > _MOVES for other, part in left.items() if other != guard)
                wrong = values.max() > 0 or not (values.any() or law.element.stays(mode))
                lasted = self._lasted.get((number, guard), 0.0) + width
                self._lasted[number, guard] = lasted if left[guard] <= NEGLIGIBLE and acts and wrong else 0.0
                if self._lasted[number, guard] > _LONG * horizon:
                    raise StoppedError(
                        Verdict.DOUBTFUL,
                        f"which mode {law.label} is in is not known at t = {now:.6g} s: what decides is within {NEGLIGIBLE:g} of its "
                        "largest value from where it switches (give it a transition or hysteresis, or end before)",
                    )

    def _left(self, number: int, guard: int, values: Real) -> float:
        """Return how large a guard is on a step, in parts of the largest that it has been; 1 for one that has always been 0."""
        size = float(np.abs(values).max())
        largest = self._largest[number, guard] = max(self._largest.get((number, guard), 0.0), size)
        return size / largest if largest > 0 else 1.0
