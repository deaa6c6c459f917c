"""Which way inputs go on between their samples, told from how well each explains the measurement."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.model.between_samples import BetweenSamples
from engine.recordings.fit import Fit, compare

Samples = npt.NDArray[np.float64]

_EXACT = 1e-18
"""Squared errors below this part of the signal's are rounding: of equal ways the first is taken."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Chosen:
    """The way that fits best, and the fits of every output with each way that has a finite response."""

    way: BetweenSamples
    tried: Mapping[BetweenSamples, Mapping[str, Fit]]


def chosen(
    measured: Mapping[str, Samples],
    answers: Mapping[BetweenSamples, Mapping[str, Samples]],
    offsets: Mapping[str, float] | None,
) -> Chosen:
    """Return the way with the least squared errors, each output relative to its own size; an answer that is not finite is none.

    Parameters
    ----------
    measured : mapping of str to ndarray, shape (samples,)
    answers : mapping of BetweenSamples to mapping of str to ndarray
        At least one with finite values.
    offsets : mapping of str to float, optional
        A constant for each output; None takes the one that fits best.
    """
    fits: dict[BetweenSamples, Mapping[str, Fit]] = {}
    errors: dict[BetweenSamples, float] = {}
    for way, simulated in answers.items():
        if not all(np.isfinite(values).all() for values in simulated.values()):
            continue
        own, squares = {}, 0.0
        for name, y in measured.items():
            offset = float(np.mean(y - simulated[name])) if offsets is None else offsets[name]
            own[name] = compare(y, simulated[name] + offset)
            power = float(np.sum((y - y.mean()) ** 2)) or float(np.sum(y**2)) or 1.0
            squares += float(np.sum((y - simulated[name] - offset) ** 2)) / power
        fits[way], errors[way] = own, max(squares, _EXACT)
    return Chosen(way=min(errors, key=errors.__getitem__), tried=fits)
