"""What a set of points says about several objectives: who dominates whom, the volume that is covered, the knee.

Objectives are minimised here. Relative to the front's own box, ideal 0 and nadir 1,

    hypervolume = volume of { z in [0, 1]^m : some point of the front is <= z },   knee = argmax (1 - Σ_i z_i)

so the knee is the point that lies furthest on the good side of the plane through the ends of the front.

References
----------
I. Das, "On characterizing the 'knee' of the Pareto curve", Structural Optimization 18 (1999) 107-115; E. Zitzler, L. Thiele,
"Multiobjective evolutionary algorithms", IEEE Trans. Evolutionary Computation 3 (1999) 257-271.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]


def undominated(values: Matrix) -> npt.NDArray[np.bool_]:
    """Return which rows of ``values`` (B, m) no other row beats; of equal rows the first."""
    stay = np.zeros(len(values), dtype=bool)
    kept = np.empty_like(values)
    count = 0
    # In this order no row can beat an earlier one.
    for row in np.lexsort((*values.T[::-1],)):
        if not (kept[:count] <= values[row]).all(axis=1).any():
            kept[count] = values[row]
            count += 1
            stay[row] = True
    return stay


def scaled(values: Matrix) -> Matrix:
    """Return rows relative to their box: 0 the best and 1 the worst of each column, 0 where all are equal."""
    low, high = values.min(axis=0), values.max(axis=0)
    return np.asarray((values - low) / np.where(high > low, high - low, 1.0))


def knee(values: Matrix) -> int:
    """Return the row of a front (B, m) that lies furthest on the good side of the plane through its ends."""
    return int(np.argmin(scaled(values).sum(axis=1)))


def hypervolume(values: Matrix) -> float:
    """Return the share of a front's own box that it dominates; 0 for one point."""
    points = scaled(values)
    return _volume(points[undominated(points)], np.ones(points.shape[1])) if len(values) > 1 else 0.0


def _volume(points: Matrix, reference: Matrix) -> float:
    """Return the volume between points and a reference, slice by slice along the last coordinate."""
    points = points[(points < reference).all(axis=1)]
    if not len(points):
        return 0.0
    if points.shape[1] == 1:
        return float(reference[0] - points.min())
    order = np.argsort(points[:, -1])
    points = points[order]
    edges = np.append(points[:, -1], reference[-1])
    total = 0.0
    for k in range(len(points)):
        height = edges[k + 1] - edges[k]
        if height > 0:
            total += height * _volume(points[: k + 1, :-1], reference[:-1])
    return total
