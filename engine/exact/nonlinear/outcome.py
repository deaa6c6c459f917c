"""What comes of following a nonlinear response: the record as far as it goes, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from engine.elements._nonlinear import Mode
from engine.exact.nonlinear.pieces import Record
from engine.exact.time.curve import Curve
from engine.model.verdicts import Verdict

Array = npt.NDArray[Any]
Real = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """A response as far as it goes.

    ``verdict`` is OK where the end was reached; ``advice`` says what stopped it else. ``error`` is the estimated error of
    the outputs relative to their largest value, ``events`` the number of located changes of mode; ``smooth`` is False
    where a guard was only touched, so that derivatives hold on one side only. ``after`` (lanes, outputs) are the outputs just
    after an end that was reached: a sample that is taken there counts, as those before it.
    """

    record: Record
    after: Array | None
    state: Array
    modes: tuple[Mode, ...]
    verdict: Verdict
    advice: str
    error: float
    events: int
    steps: int
    smooth: bool
    limits: tuple[Real, Real]

    @property
    def end(self) -> float:
        """Last instant, s."""
        return float(self.record.edges[-1][0].real)

    def output(self, index: int) -> Curve:
        """Return output ``index`` as a curve; rounding does not take it beyond its limits."""
        found = self.record.curve(self.record.y, index)
        low, high = (bound[index] for bound in self.limits)
        excess = np.clip(found.values.real, low, high) - found.values.real
        return Curve(edges=found.edges, values=found.values + excess) if np.any(excess) else found

    def input(self, index: int) -> Curve:
        """Return input ``index`` as a curve."""
        return self.record.curve(self.record.u, index)
