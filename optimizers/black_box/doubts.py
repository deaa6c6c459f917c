"""What is doubtful about samples, and about the model without a diagram that was made from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from engine.recordings.fit import compare
from optimizers.recorded.recorded_data import doubted_data, doubted_samples
from optimizers.recorded.recording import RecordedExperiment

Samples = npt.NDArray[np.float64]

UNJUDGED: Final = (
    "no input moves where the model is validated: its order is judged by what it explains where it was estimated (move the input "
    "again there, or choose the windows)"
)
_LITTLE: Final = 10.0
"""Percent of fit."""


def doubts(
    experiment: RecordedExperiment, together: int, pairs: Mapping[str, tuple[Samples, Samples]], delay: int, most: int
) -> tuple[str, ...]:
    """Return a sentence on each.

    Parameters
    ----------
    experiment : RecordedExperiment
        As it was recorded.
    together : int
        Samples of a mean.
    pairs : mapping of output to (ndarray, ndarray)
        Measured and simulated signals where the model was estimated.
    delay, most : int
        What was found, and the largest one, in means.
    """
    said = [*doubted_data(experiment)]
    if together > 1:
        h = experiment.recording.sample_time
        said.append(
            f"the recording is sampled far faster than anything moves in it: the model and its fits are of means of {together} samples "
            f"each, {together * h:.3g} s apart, and so fine is the delay"
        )
    if delay == most > 0:
        said.append(f"the delay came to rest at largest_delay ({most} samples): the recording asks for more room")
    for name, (measured, simulated) in pairs.items():
        said += doubted_samples(measured, simulated, name)
        fit = compare(measured, simulated).fit_percent
        if fit is not None and fit < _LITTLE:
            said.append(
                f"the model explains little of {name} (fit {fit:.3g} %, where the mean of what was measured has 0): do not use it "
                "before you know why"
            )
    return tuple(said)
