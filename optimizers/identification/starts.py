"""Where a search for parameters begins: the given start, then anywhere within finite bounds or a decade round it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from optimizers.identification.answers import Samples
from optimizers.recording import Identification


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
