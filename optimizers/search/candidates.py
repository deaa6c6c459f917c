"""The undominated among all points that a search for a front has met, and how a state keeps arrays."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np

from optimizers.evaluation.certificate import TOLERANCE
from optimizers.evaluation.evaluate import Assessment, Matrix
from optimizers.problem import Across, Problem, Sense, Vector
from optimizers.search.fronts import knee, undominated

_ARCHIVE = 400
"""More undominated points than this are thinned out to half of it: each new point is compared with all."""
_WORST = 1e30
"""Stands for an objective that has no value."""


def packed(rows: Matrix) -> str:
    """Return the numbers of a matrix, exactly, as a text."""
    return base64.b64encode(np.ascontiguousarray(rows, dtype=np.float64).tobytes()).decode()


def unpacked(text: str, columns: int) -> Matrix:
    """Return the matrix (B, columns) that `packed` made a text of."""
    return np.frombuffer(base64.b64decode(text), dtype=np.float64).reshape(-1, columns).copy()


class Candidates:
    """The undominated among all points that met every goal: ``positions`` (B, V) and ``values`` (B, m), minimised."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.positions = np.empty((0, len(problem.axes)))
        self.values = np.empty((0, len(problem.objectives)))

    def document(self) -> list[str]:
        """Return the points in plain texts."""
        return [packed(self.positions), packed(self.values)]

    def restore(self, document: Sequence[str]) -> None:
        """Be what such texts tell."""
        positions, values = document
        self.positions = unpacked(positions, self.positions.shape[1])
        self.values = unpacked(values, self.values.shape[1])

    def minimised(self, metrics: Matrix) -> Matrix:
        """Return the objectives (B, m), smaller is better, of metric values (B, S, G) over all scenarios."""
        signs = [-1.0 if self.problem.goals[g].sense is Sense.MAXIMIZE else 1.0 for g in self.problem.objectives]
        signed = metrics[:, :, list(self.problem.objectives)] * np.array(signs)
        together = signed.mean(axis=1) if self.problem.across is Across.MEAN else signed.max(axis=1)
        return np.asarray(np.nan_to_num(together, nan=_WORST, posinf=_WORST, neginf=-_WORST))

    def offer(self, positions: Matrix, found: Assessment) -> None:
        """Take note of points; only those that meet every goal and are not dominated stay."""
        values = self.minimised(found.values)
        good = (found.violation <= TOLERANCE) & ~np.isnan(found.objective)
        positions, values = positions[good], values[good]
        fresh = ~(self.values[:, None] <= values).all(axis=2).any(axis=0)
        positions, values = positions[fresh], values[fresh]
        fresh = undominated(values)
        positions, values = positions[fresh], values[fresh]
        stay = ~(values[:, None] <= self.values).all(axis=2).any(axis=0)
        self.positions = np.vstack([self.positions[stay], positions])
        self.values = np.vstack([self.values[stay], values])
        if len(self.values) > _ARCHIVE:
            self.thin(_ARCHIVE // 2)

    def replace(self, old: Vector, position: Vector, found: Assessment) -> None:
        """Put a better point in the place of one of these; it stays where the new one breaks a goal."""
        stay = ~(self.positions == old).all(axis=1)
        if found.violation[0] <= TOLERANCE and not np.isnan(found.objective[0]):
            self.positions, self.values = self.positions[stay], self.values[stay]
            self.offer(position[None], found)

    def thin(self, count: int) -> None:
        """Keep at most ``count`` points, spread evenly: the ends, the knee, then always the one furthest from the others."""
        if len(self.values) <= count:
            return
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        places = (self.values - low) / np.where(high > low, high - low, 1.0)
        kept = list(dict.fromkeys([*self.values.argmin(axis=0).tolist(), knee(self.values)]))[:count]
        distance = np.min([np.abs(places - places[k]).max(axis=1) for k in kept], axis=0)
        while len(kept) < count:
            kept.append(int(distance.argmax()))
            distance = np.minimum(distance, np.abs(places - places[kept[-1]]).max(axis=1))
        self.positions, self.values = self.positions[kept], self.values[kept]
