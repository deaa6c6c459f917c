"""The last step of a search by fast evaluations: what the exact engine finds violated is tightened, and descended again."""

from __future__ import annotations

import numpy as np

from optimizers.certificate import certificate_of
from optimizers.problem import Vector
from optimizers.search import SAFETY, Descent, Tracker

_ROUNDS = 3
_EVALUATIONS = 60


def descend_to_proof(tracker: Tracker, margins: Vector) -> None:
    """Tighten ``margins`` (G,) until the best point holds for the exact engine, in a bounded number of rounds.

    Fast metrics are right to about 1e-7, which a bound that is active does not forgive.

    Raises
    ------
    Stopped
        When cancelled or out of budget.
    """
    problem = tracker.evaluator.problem
    for _ in range(_ROUNDS):
        if tracker.best is None or tracker.rank[0] > 0:
            return
        rows = tracker.evaluator.exact(problem.values(tracker.best))
        certificate = certificate_of(problem, [[measured for measured, _ in row] for row in rows])
        if certificate.valid:
            return
        for proof in certificate.goals:
            if proof.violation > 0:
                margins[proof.goal] += 1.5 * proof.violation + SAFETY
        # Points found with less margin no longer count: not even the one that the descent starts from.
        start, tracker.rank = tracker.best, (np.inf, np.inf)
        tracker.margins = np.maximum(margins - SAFETY, 0.0)
        Descent(tracker, margins).run(start, evaluations=_EVALUATIONS)
