"""The last step of a search by fast evaluations: what the exact engine finds violated is tightened, and descended again."""

from __future__ import annotations

import numpy as np

from optimizers.evaluation.certificate import certificate_of
from optimizers.evaluation.compared import exactly
from optimizers.evaluation.evaluate import Evaluator, Local
from optimizers.problem import Vector
from optimizers.search.companion import descend_beside
from optimizers.search.search import SAFETY, STATIONARY, Descent, Tracker
from optimizers.search.successive_linear_programming import Polish

_ROUNDS = 3
_EVALUATIONS, _SIMULATED = 60, 15
"""Evaluations with slopes of a descent, at most; and so many for each variable where compiled kernels do not give them."""
_TRUSTED = 1e-4
"""Relative difference of fast and exact objective from which on the fast one is not believed."""


def polish(tracker: Tracker, margins: Vector, *, evaluations: int) -> None:
    """Polish the best point until it is stationary, in a bounded number of rounds.

    Along a bent ridge slopes alone creep; a descent that learns its curvature makes the way.

    Raises
    ------
    Stopped
        When cancelled or out of budget.
    """
    for number in range(_ROUNDS):
        assert tracker.best is not None
        before = tracker.rank
        if number:
            Descent(tracker, margins).run(tracker.best, evaluations=evaluations)
        Polish(tracker, margins).run(tracker.best, evaluations=evaluations)
        if (tracker.stationarity or 0.0) <= STATIONARY or not tracker.rank < before:
            return


def descend_to_proof(tracker: Tracker, margins: Vector) -> None:
    """Tighten ``margins`` (G,) until the best point holds for the exact engine, in a bounded number of rounds.

    Fast metrics are right to about 1e-7, which a bound that is active does not forgive. Where the objective itself turns out to
    be another one, fast evaluations led the search astray, and the rest of the way is made by exact ones.

    Raises
    ------
    Stopped
        When cancelled or out of budget.
    """
    _mistrust(tracker, margins)
    _tighten(tracker, margins)
    if tracker.best is None or tracker.rank[0] > 0:
        return
    proven = tracker.best, tracker.rank, tracker.stationarity
    descend_beside(tracker, tracker.best, evaluations=_affordable(tracker))
    if tracker.best is not proven[0] and not tracker.evaluator.exact.certificate(_values(tracker)).valid:
        tracker.best, tracker.rank, tracker.stationarity = proven
    if tracker.stationarity is None:  # the best point is a later one than the last proof
        Polish(tracker, margins).run(tracker.best, evaluations=1)


def _affordable(tracker: Tracker) -> int:
    """Return how many evaluations with slopes a descent may take."""
    evaluator = tracker.evaluator
    return _EVALUATIONS if evaluator.compiled else min(_EVALUATIONS, _SIMULATED * len(evaluator.problem.axes))


def _values(tracker: Tracker) -> dict[str, float]:
    assert tracker.best is not None
    return dict(tracker.evaluator.problem.values(tracker.best))


def _tighten(tracker: Tracker, margins: Vector) -> None:
    """Tighten ``margins`` (G,) and descend until the best point holds, in a bounded number of rounds."""
    problem = tracker.evaluator.problem
    for _ in range(_ROUNDS):
        if tracker.best is None or tracker.rank[0] > 0:
            return
        rows = tracker.evaluator.exact.at(problem.values(tracker.best))
        certificate = certificate_of(problem, [[measured for measured, _ in row] for row in rows])
        if certificate.valid:
            return
        for proof in certificate.goals:
            if proof.violation > 0:
                margins[proof.goal] += 1.5 * proof.violation + SAFETY
        # Points found with less margin no longer count: not even the one that the descent starts from.
        start, tracker.rank = tracker.best, (np.inf, np.inf)
        tracker.margins = np.maximum(margins - SAFETY, 0.0)
        Descent(tracker, margins).run(start, evaluations=_affordable(tracker))
        Polish(tracker, margins).run(tracker.best, evaluations=_affordable(tracker))


class _Exactly(Evaluator):
    """An evaluator whose slopes and values come from the exact path."""

    def local(self, position: Vector) -> Local | None:
        """Return values and slopes at one point, or None where a metric has no value in some scenario."""
        self.evaluations += 1
        point = self.problem.values(position)
        rows = self.exact.at(point)
        reach = np.array([axis.slope(point[axis.parameter]) for axis in self.problem.axes])
        values, slopes = exactly(self.problem.goals, rows, len(reach))
        if np.isnan(values).any():
            return None
        slopes = slopes * reach
        slopes[~np.isfinite(slopes)] = 0.0
        return Local(values=values, slopes=slopes)


def _mistrust(tracker: Tracker, margins: Vector) -> None:
    """Go on with exact evaluations where the objective of the best point is not what fast ones say."""
    if tracker.best is None or tracker.rank[0] > 0:
        return
    exactly = _Exactly(tracker.evaluator.problem, exact=tracker.evaluator.exact)
    found = exactly.local(tracker.best)
    if found is None:
        return
    objective = float(exactly.objectives(found.values).max())
    if abs(objective - tracker.rank[1]) <= _TRUSTED * abs(objective):
        return
    start, tracker.rank = tracker.best, (np.inf, np.inf)
    exactly.evaluations = tracker.evaluator.evaluations
    tracker.evaluator, fast = exactly, tracker.evaluator
    try:
        descend_beside(tracker, start, evaluations=_affordable(tracker))
        Descent(tracker, margins).run(start, evaluations=_affordable(tracker))
        Polish(tracker, margins).run(start if tracker.best is None else tracker.best, evaluations=_affordable(tracker))
    finally:
        fast.evaluations = exactly.evaluations
        tracker.evaluator = fast
