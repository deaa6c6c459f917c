"""The conic solvers behind one door: a problem is solved, or there is a word for why not."""

from __future__ import annotations

import warnings
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import cvxpy as cp

_SETTINGS: dict[str, dict[str, Any]] = {
    "CLARABEL": {"tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10, "time_limit": 5.0},
    "SCS": {"eps_abs": 1e-7, "eps_rel": 1e-7, "max_iters": 20_000, "time_limit_secs": 5.0},
}
"""An interior-point method first, which is exact; a first-order method where that finds no way."""


class Solved(StrEnum):
    """How a conic problem ended."""

    OPTIMAL = "optimal"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    FAILED = "failed"


def solve(problem: cp.Problem) -> Solved:
    """Solve a convex problem; its variables then have their values where the answer is ``optimal``."""
    import cvxpy as cp  # noqa: PLC0415 - costs a second, and only this method needs it

    answers = {
        cp.OPTIMAL: Solved.OPTIMAL,
        cp.OPTIMAL_INACCURATE: Solved.OPTIMAL,  # every caller checks what it is given on the exact path
        cp.INFEASIBLE: Solved.INFEASIBLE,
        cp.INFEASIBLE_INACCURATE: Solved.INFEASIBLE,
        cp.UNBOUNDED: Solved.UNBOUNDED,
        cp.UNBOUNDED_INACCURATE: Solved.UNBOUNDED,
    }
    for name, settings in _SETTINGS.items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a solution may be inaccurate is told by the status
            try:
                problem.solve(solver=name, **settings)
            except cp.error.SolverError:
                continue
        found = answers.get(problem.status, Solved.FAILED)
        if found is not Solved.FAILED:
            return found
    return Solved.FAILED
