"""Where a search for parameters begins: the given start, then anywhere within finite bounds or a decade round it.

Where that ends in a place that is no answer, the best of many points round the given start are begun from, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from optimizers.identification.answers import Samples
from optimizers.recorded.recording import Identification

_LOOKED_AT: Final = 20
"""Points for each parameter."""
_FOLLOWED: Final = 3


def first_start(problem: Identification) -> Samples:
    """Return the coordinates of the given start, shape (parameters,)."""
    return np.array([unknown.coordinate(unknown.start) for unknown in problem.unknowns])


def further_starts(problem: Identification, rng: np.random.Generator) -> Iterator[Samples]:
    """Return the starts behind the first one, drawn at random."""
    for _ in range(problem.starts - 1):
        x = []
        for unknown in problem.unknowns:
            if math.isfinite(unknown.lower) and math.isfinite(unknown.upper):
                low, high = unknown.coordinate(unknown.lower), unknown.coordinate(unknown.upper)
                x.append(float(rng.uniform(low, high)))
            else:
                value = (unknown.start or 1.0) * 10 ** float(rng.uniform(-1, 1))
                x.append(unknown.coordinate(min(max(value, unknown.lower), unknown.upper)))
        yield np.array(x)


def promising_starts(
    problem: Identification, cost: Callable[[Samples], float], rng: np.random.Generator, *, most: int
) -> Samples:
    """Return the best of many points within a decade round the given start and within the bounds, shape (few, parameters).

    Parameters
    ----------
    problem : Identification
    cost : callable
        Of a point; infinite where there is no model.
    rng : numpy.random.Generator
    most : int
        Points that may be looked at; none are returned for 0.
    """
    points = []
    for _ in range(min(most, _LOOKED_AT * len(problem.unknowns))):
        x = []
        for unknown in problem.unknowns:
            value = (unknown.start or min(unknown.upper, 1.0)) * 10 ** float(rng.uniform(-1, 1))
            x.append(unknown.coordinate(min(max(value, unknown.lower), unknown.upper)))
        points.append(np.array(x))
    found = sorted(((cost(x), k) for k, x in enumerate(points)), key=lambda one: one[0])
    return np.array([points[k] for value, k in found[:_FOLLOWED] if math.isfinite(value)])
