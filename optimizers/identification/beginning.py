"""Does a recording begin at rest?   A Wald test of the free motions that a linear model leaves out.

    s = Qᵀ r,   W = sᵀ C⁻¹ s  ~  χ²(states)

r are the errors; Q spans what the free motions add to the slopes by the parameters, and C is the covariance of s, the colour of
what is left of the errors included. Source: L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, sections 3.2 and 16.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.special import chdtri

from optimizers.estimation.confidence import covariance
from optimizers.identification.answers import Samples
from optimizers.identification.comparison import Comparison, orthonormal
from optimizers.identification.linear import LinearModel
from optimizers.recorded.recording import Identification

_CHANCE: Final = 1e-4
"""How often a recording that begins at rest is suspected."""


def begun_moving(
    problem: Identification, values: dict[str, float], comparisons: Sequence[Comparison]
) -> tuple[str, ...]:
    """Return a sentence on every recording whose errors are those of a linear model that did not begin at rest.

    Parameters
    ----------
    problem : Identification
    values : dict of str to float
        Of the parameters that were found, SI.
    comparisons : sequence of Comparison
    """
    if problem.initial_states or problem.diagram.nonlinear:
        return ()
    said = []
    for comparison in comparisons:
        if comparison.experiment.windows[0] is None:
            continue
        found = _statistic(problem, values, comparison)
        if found is None or not found[0] > found[1]:
            continue
        name = comparison.experiment.name
        said.append(
            f"{f'{name} does' if name else 'the recording does'} not seem to begin at rest (Wald statistic {found[0]:.3g}, which chance "
            f"keeps below {found[1]:.3g} in 9999 of 10000): the intervals do not allow for that, ask for initial_states"
        )
    return tuple(said)


def _statistic(problem: Identification, values: dict[str, float], comparison: Comparison) -> tuple[float, float] | None:
    """Return the statistic and its limit; None where no free motion is left."""
    errors = comparison.errors(values, np.zeros(0), np.ones(len(values)))
    answer = LinearModel(problem.diagram, comparison.experiment, initial=True).answer(values, np.zeros(0))
    if errors is None or answer.free is None or not answer.free.shape[-1]:
        return None
    motions = comparison.basis(answer)
    assert motions is not None
    q = orthonormal(motions - _on(errors.jacobian, motions))
    if not q.shape[1]:
        return None
    moved = q.T @ errors.residuals
    outputs = len(comparison.signals)
    left = np.split(errors.residuals - q @ moved, outputs)
    wide = covariance(np.split(q, outputs), left)
    return float(moved @ np.linalg.pinv(wide) @ moved), float(chdtri(q.shape[1], _CHANCE))


def _on(columns: Samples, others: Samples) -> Samples:
    """Return what columns explain of others."""
    if not columns.any():
        return np.zeros_like(others)
    own = orthonormal(columns)
    return np.asarray(own @ (own.T @ others))
