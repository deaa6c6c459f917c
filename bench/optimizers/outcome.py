"""What a method made of a case, as the stored table keeps it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench.optimizers.cases_convex import Case
from optimizers.methods import minimize


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One method on one case; ``gap`` is how far it stays behind what was published, relative (negative: it is better)."""

    case: str
    method: str
    published: float
    reached: float
    gap: float
    tolerance: float
    violation: float
    met: bool
    evaluations: int
    seconds: float
    cpu_seconds: float
    source: str


def solve(case: Case, method: str, options: Mapping[str, Any] | None = None) -> Outcome:
    """Solve a case, and hold the exact optimum against what was published.

    Parameters
    ----------
    case : Case
    method : str
        Kind of the method.
    options : mapping, optional
    """
    begin, cpu = time.perf_counter(), time.process_time()
    result = minimize(method, case.problem, options)
    seconds, cpu_seconds = time.perf_counter() - begin, time.process_time() - cpu
    if case.parameter is None:
        reached = result.objective
        gap = (reached - case.published) / abs(case.published)
    else:  # a gain that is to be large
        reached = result.best[case.parameter]
        gap = (case.published - reached) / abs(case.published)
    return Outcome(
        case=case.name, method=method, published=case.published, reached=reached, gap=gap, tolerance=case.tolerance,
        violation=result.certificate.worst_violation, met=result.certificate.valid and gap <= case.tolerance,
        evaluations=result.evaluations, seconds=seconds, cpu_seconds=cpu_seconds, source=case.source,
    )  # fmt: skip
