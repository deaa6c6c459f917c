"""Does a recording begin at rest?   A Wald test of the free motions that a linear model leaves out.

    s = Qᵀ r,   W = sᵀ C⁻¹ s  ~  χ²(states)

r are the errors; Q spans what the free motions add to the slopes by the parameters, and C is the covariance of s, the colour of
what is left of the errors included. Source: L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, sections 3.2 and 16.4.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.special import chdtri

from optimizers.estimation.confidence import covariance
from optimizers.identification.answers import Samples
from optimizers.identification.comparison import Comparison, orthonormal
from optimizers.identification.linear import LinearModel
from optimizers.recorded.recording import Identification, RecordedExperiment

_CHANCE: Final = 1e-4
"""How often a recording that begins at rest is suspected."""
_LONGEST: Final = 20_000
"""Samples that are looked at: a free motion is at the beginning, and a long recording fills the memory as it is."""


def begun_moving(problem: Identification, values: dict[str, float]) -> tuple[str, ...]:
    """Return a sentence on every recording whose errors are those of a linear model that did not begin at rest.

    Parameters
    ----------
    problem : Identification
    values : dict of str to float
        Of the parameters that were found, SI.
    """
    if problem.initial_states or problem.diagram.nonlinear:
        return ()
    said = []
    for experiment in problem.experiments:
        found = _statistic(problem, values, experiment)
        if found is None or not found[0] > found[1]:
            continue
        name = experiment.name
        said.append(
            f"{f'{name} does' if name else 'the recording does'} not seem to begin at rest (Wald statistic {found[0]:.3g}, which chance "
            f"keeps below {found[1]:.3g} in 9999 of 10000): the intervals do not allow for that, ask for initial_states"
        )
    return tuple(said)


def _statistic(
    problem: Identification, values: dict[str, float], experiment: RecordedExperiment
) -> tuple[float, float] | None:
    """Return the statistic and its limit; None where no free motion is left."""
    begun = _beginning(experiment)
    if begun is None:
        return None
    comparison = Comparison(begun, LinearModel(problem.diagram, begun, initial=False), offsets=problem.offsets)
    errors = comparison.errors(values, np.zeros(0), np.ones(len(values)))
    known, (one, *_) = replace(begun, values={**begun.values, **values}), values  # one lane is enough
    answer = LinearModel(problem.diagram, known, initial=True).answer({one: values[one]}, np.zeros(0))
    if errors is None or answer.free is None or not answer.free.shape[-1]:
        return None
    motions = comparison.basis(answer)
    assert motions is not None
    q = orthonormal(motions - _on(errors.jacobian, motions))
    if not q.shape[1]:
        return None
    residuals = errors.residuals - _on(errors.jacobian, errors.residuals[:, None])[:, 0]
    moved = q.T @ residuals
    outputs = len(comparison.signals)
    left = np.split(residuals - q @ moved, outputs)
    wide = covariance(np.split(q, outputs), left)
    return float(moved @ np.linalg.pinv(wide) @ moved), float(chdtri(q.shape[1], _CHANCE))


def _beginning(experiment: RecordedExperiment) -> RecordedExperiment | None:
    """Return what a free motion is looked for in; None where nothing is estimated from it."""
    whole, window = experiment.recording, experiment.windows[0]
    recording = replace(
        whole,
        inputs={name: signal[:_LONGEST] for name, signal in whole.inputs.items()},
        outputs={name: signal[:_LONGEST] for name, signal in whole.outputs.items()},
    )
    if window is None or not window[0] < recording.end:
        return None
    window = window[0], min(window[1], recording.end)
    part = recording.within(window)
    if any(np.ptp(signal[part]) == 0 for signal in recording.outputs.values()):
        return None
    return replace(experiment, recording=recording, estimation=window, validation=None)


def _on(columns: Samples, others: Samples) -> Samples:
    """Return what columns explain of others."""
    if not columns.any():
        return np.zeros_like(others)
    own = orthonormal(columns)
    return np.asarray(own @ (own.T @ others))
