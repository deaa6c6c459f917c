"""The polish: sequential linear programming in a trust region, with the slopes of nearby points kept as cuts.

A peak metric is the largest of several peaks, f(x) = max_k f_k(x), and at an optimum two of them are often equal: the slope
of f then jumps, and a method that believes in one slope per metric creeps. Nearby points know the other peaks,

    minimise γ + ρ t   subject to   f(x_j) + ∇f(x_j)·(x + d - x_j) ≤ γ,   excess(x_j) + ∇excess(x_j)·(x + d - x_j) ≤ t

for the present point x and its neighbours x_j, with |d| ≤ Δ and t ≥ 0; the objective is the largest of its parts already.

References
----------
J. E. Kelley, "The cutting-plane method for solving convex programs", J. SIAM 8 (1960) 703-712; R. Fletcher, E. Sainz de la
Maza, "Nonlinear programming and nonsmooth optimization by successive linear programming", Math. Programming 43 (1989) 235-256.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from optimizers.evaluation.constraint_violation import excess, excess_slopes
from optimizers.evaluation.evaluate import Local, Matrix
from optimizers.problem import Vector
from optimizers.search.search import NEAR, STATIONARY, Tracker

_WIDEST, _FINEST = 0.1, 1e-8
"""Radii of the trust region, as parts of the range of each variable: the widest, and where the polish ends."""
_REMEMBERED = 24
_PENALTY = 1e2
"""What an excess of 1 relative to its bound costs, in units of the objective."""
_GAIN = 1e-9
_SHARES = (1.0, 0.1, 0.01)
"""Parts of the moves of a proof for which it looks for a gain: the cuts of a bent ridge may hide one from wide moves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cut:
    """What one point knows: values and slopes of the objectives (R,), (R, V) and of the excesses (C,), (C, V)."""

    x: Vector
    objective: Vector
    objective_slopes: Matrix
    excess: Vector
    excess_slopes: Matrix


class Polish:
    """Moves a good point to the optimum next to it, kinks included.

    Parameters
    ----------
    tracker : Tracker
    margins : ndarray, shape (G,)
        Relative distance that each goal keeps from its bounds.
    """

    def __init__(self, tracker: Tracker, margins: Vector) -> None:
        self._tracker = tracker
        self._evaluator = tracker.evaluator
        self._margins = margins
        goals = self._evaluator.problem.goals
        self._bounds = [(g, bound, sign) for g, goal in enumerate(goals) if goal.hard for bound, sign in goal.bounds]
        self._scale = 1.0

    def run(self, start: Vector, *, evaluations: int, radius: float = 0.01) -> None:
        """Polish from ``start``; the tracker remembers the best point passed, and what the slopes still promise there.

        Raises
        ------
        Stopped
            When cancelled or out of budget.
        """
        first = self._tracker.local(start)
        if first is None:
            self._tracker.prove(start, np.inf)
            return
        self._scale = max(float(np.abs(self._evaluator.objectives(first.values)).max()), 1e-300)
        here = self._cut(start, first)
        known = [here]
        for _ in range(evaluations - 1):
            step, predicted = self._step(here, known, radius)
            if radius < _FINEST or predicted <= _GAIN:
                # That alone is no proof: on a ridge a region becomes narrow, and cuts from around its bend promise nothing.
                wide = [share * NEAR for share, gain in self._promised(here, known).items() if gain > STATIONARY]
                if not wide:
                    break
                radius = wide[0]
                step, predicted = self._step(here, known, radius)
            x = np.clip(here.x + step, 0.0, 1.0)
            found = self._tracker.local(x)
            if found is None:
                radius = 0.25 * float(np.abs(step).max())
                continue
            there = self._cut(x, found)
            known = [*known[1 - _REMEMBERED :], there]
            gained = _merit(here) - _merit(there)
            if gained > 0.7 * predicted and np.abs(step).max() > 0.9 * radius:
                radius = min(2 * radius, _WIDEST)
            elif gained < 0.2 * predicted:
                radius = 0.5 * min(radius, float(np.abs(step).max()) or radius)
            if gained > 0:
                here = there
        self._tracker.prove(here.x, max(0.0, *self._promised(here, known).values()))

    def _promised(self, here: _Cut, known: list[_Cut]) -> dict[float, float]:
        """Return the gain for moves of 1 % as each part of such a move promises it, by part."""
        return {share: self._step(here, known, share * NEAR)[1] / share for share in _SHARES}

    def _cut(self, x: Vector, local: Local) -> _Cut:
        """Return objective and excesses with their slopes, relative to the objective at the start and to the bounds."""
        beyond = [excess(local.values[:, g], bound, sign) + self._margins[g] for g, bound, sign in self._bounds]
        slopes = [excess_slopes(local.values[:, g], local.slopes[:, g], bound, sign) for g, bound, sign in self._bounds]
        return _Cut(
            x=x,
            objective=self._evaluator.objectives(local.values) / self._scale,
            objective_slopes=self._evaluator.objective_slopes(local) / self._scale,
            excess=np.concatenate(beyond) if beyond else np.zeros(0),
            excess_slopes=np.concatenate(slopes) if slopes else np.zeros((0, len(x))),
        )

    @staticmethod
    def _step(here: _Cut, known: list[_Cut], radius: float) -> tuple[Vector, float]:
        """Return the step and the gain of the merit that the cuts promise."""
        n = len(here.x)
        rows, limits = [], []
        # After many steps without a gain the present point is no longer among the last ones.
        for cut in known if any(cut is here for cut in known) else [here, *known]:
            away = here.x - cut.x
            if cut is not here and np.abs(away).max() > 3 * radius:
                continue
            # A cut must not say more of the present point than is known: its curvature would.
            objective = np.minimum(cut.objective + cut.objective_slopes @ away, here.objective)
            excess = np.minimum(cut.excess + cut.excess_slopes @ away, here.excess)
            rows.append(np.hstack([cut.objective_slopes, np.tile([-1.0, 0.0], (len(objective), 1))]))
            rows.append(np.hstack([cut.excess_slopes, np.tile([0.0, -1.0], (len(excess), 1))]))
            limits += [-objective, -excess]
        lower = np.maximum(-radius, -here.x)
        upper = np.minimum(radius, 1.0 - here.x)
        found = linprog(
            np.append(np.zeros(n), [1.0, _PENALTY]), A_ub=np.vstack(rows), b_ub=np.concatenate(limits),
            bounds=[*zip(lower, upper, strict=True), (None, None), (0.0, None)], method="highs",
        )  # fmt: skip
        if found.x is None or found.fun is None:
            return np.zeros(n), 0.0
        return np.asarray(found.x[:n]), _merit(here) - float(found.fun)


def _merit(cut: _Cut) -> float:
    """Return the objective of the worst scenario, with the largest excess as a penalty."""
    return float(cut.objective.max()) + _PENALTY * max(float(cut.excess.max(initial=0.0)), 0.0)
