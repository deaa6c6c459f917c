"""Evenly spread points of the unit cube: scrambled Sobol sequences, and Latin hypercubes.

To load `scipy.stats` is a fifth of a service's start: only who searches pays for it (a worker before its first job, `api.processes.worker`).

References
----------
A. B. Owen, J. Complexity 14 (1998) 466-489 (scrambling). M. D. McKay et al., Technometrics 21 (1979) 239-245.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.stats import qmc


def sobol_sequence(dimensions: int, rng: np.random.Generator) -> qmc.Sobol:
    """Return a scrambled Sobol sequence, which gives points of shape (count, dimensions)."""
    from scipy.stats import qmc  # noqa: PLC0415 -- see above

    return qmc.Sobol(dimensions, rng=rng)


def latin_hypercubes(dimensions: int, rng: np.random.Generator) -> qmc.LatinHypercube:
    """Return Latin hypercubes, which give points of shape (count, dimensions)."""
    from scipy.stats import qmc  # noqa: PLC0415 -- see above

    return qmc.LatinHypercube(dimensions, rng=rng)
