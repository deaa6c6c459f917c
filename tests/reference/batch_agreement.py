"""Every number of a screening held against the exact path, candidate by candidate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from engine.analysis.study import MetricRequest, measure
from engine.batch.screening import Screened
from engine.diagram.diagram import Diagram
from engine.model.verdicts import Verdict

TOLERANCE = 1e-7
ABSOLUTE = frozenset({"overshoot", "undershoot", "steady_state_error", "ie"})
"""Differences that may vanish: compared on the scale of a command of size one, or on their own where that is larger."""
FLAT = {"peak_time": 1e-6}
"""At a turning point the value is flat: its instant is known to the square root of what the value is known to."""


@dataclass
class Comparison:
    """What was compared: ``compared`` numbers, ``doubtful`` left to the exact path; ``wrong`` says which disagree and how."""

    compared: int = 0
    doubtful: int = 0
    wrong: list[str] = field(default_factory=list)

    @property
    def share_doubtful(self) -> float:
        return self.doubtful / max(self.compared + self.doubtful, 1)


def compare(
    diagram: Diagram,
    requests: Sequence[MetricRequest],
    overrides: Mapping[str, npt.NDArray[np.float64]],
    screened: Screened,
    rows: Sequence[int] | None = None,
) -> Comparison:
    """Hold the rows of a screening against `measure` at 1e-7, but for what it flags as doubtful itself."""
    found = Comparison()
    for row in range(len(screened.valid)) if rows is None else rows:
        point = {name: float(values[row]) for name, values in overrides.items()}
        exact = measure(diagram, requests, overrides=point)
        for column, (request, (measured, _)) in enumerate(zip(requests, exact, strict=True)):
            value = screened.values[row, column]
            if screened.doubtful[row, column]:
                found.doubtful += 1
                continue
            found.compared += 1
            if not _agree(request.metric, measured.value, measured.verdict, float(value)):
                found.wrong.append(
                    f"{request.metric} of candidate {row} {point}: exact {measured.value!r} ({measured.verdict}), "
                    f"screened {value!r}, growth {screened.growth[row]:g}"
                )
    return found


def _agree(metric: str, exact: float | None, verdict: Verdict, value: float) -> bool:
    if exact is None:
        return not np.isfinite(value)
    if verdict is not Verdict.OK and not np.isfinite(value):
        return True
    scale = max(1.0, abs(exact)) if metric in ABSOLUTE else abs(exact)
    return bool(abs(value - exact) <= FLAT.get(metric, TOLERANCE) * scale)
