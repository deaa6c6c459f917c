"""Frequency response functions from averaged spectra.

    H1 = S_xy / S_xx        noise on the response leaves it unbiased, noise on the input makes it too small
    H2 = S_yy / S_yx        the other way round: noise on the response makes it too large
    Hv = sqrt(H1 H2)        noise on both, the same part of each: the total least squares of channels scaled to equal power

(the phase is the same in all three). Hv as defined here does not depend on the units of the channels. Random errors, with
n independent averages:

    var ln|H1| = var ln|H2| = var arg H = (1 - γ²) / (2 (n - 1) γ²),      var ln|Hv| = (1 - γ²) / (2 (n - 1))

References
----------
J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., Wiley 2010, sections 7.2 (errors of coherence) and 9.2 (of H).
G. T. Rocklin, J. Crowley, H. Vold, Proc. 3rd IMAC (1985) 272-278 (H1, H2, Hv).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from engine.exact.frequency.fourier import Complex
from engine.model.errors import SpectrumError
from engine.recordings.spectra.crossed import Crossed, crossed
from engine.recordings.spectra.doubts import delay_doubts, leakage_doubts, resonance_doubts, sweep_doubts
from engine.recordings.spectra.frf import Doubt, Frf, check_changing
from engine.recordings.spectra.sampled import Removal, WindowKind, window_of
from engine.recordings.spectra.stretches import Samples

Estimator = Literal["H1", "H2", "Hv"]

_FEWEST = 1.5
"""Independent averages below which the scatter of the segments says nothing about the error."""


def averaged_frf(
    pairs: Sequence[tuple[Samples, Samples]],
    rate: float,
    *,
    estimator: Estimator = "H1",
    segment: int,
    window: WindowKind = "hann",
    overlap: float = 0.5,
    removal: Removal = "mean",
) -> Frf:
    """Return a frequency response function from averaged segments.

    Parameters
    ----------
    pairs : sequence of (Samples, Samples)
        Input and output of each experiment.
    rate : float
        Samples per second.
    estimator : {"H1", "H2", "Hv"}
    segment, window, overlap, removal
        As of :func:`engine.recordings.spectra.crossed.crossed`.

    Raises
    ------
    SpectrumError
        If a channel is constant, or a setting is out of its bounds.
    """
    for x, y in pairs:
        if x.size != y.size:
            raise SpectrumError(f"input and output must be of the same length, got {x.size} and {y.size} samples")
    for name, experiments in zip(("input", "output"), zip(*pairs, strict=True), strict=True):
        check_changing(name, experiments)
    found = crossed(pairs, rate, segment=segment, window=window, overlap=overlap, removal=removal)
    frf = estimated(found, estimator)
    doubts: list[Doubt] = []
    if frf.magnitude_error is None:
        detail = (
            f"coherence and errors need several segments, but {segment / rate:g} s fill {found.averages} of them: "
            "shorter segments, or more overlap, tell how certain this is"
        )
        doubts.append(Doubt(kind="averages", detail=detail))
    if window == "none":
        doubts += leakage_doubts(pairs, segment)
    else:
        doubts += sweep_doubts([x for x, _ in pairs if x.size >= segment], rate, segment)
    doubts += resonance_doubts(frf)
    doubts += delay_doubts(found, segment / rate)
    facts, _ = window_of(window, segment)
    return replace(frf, line_width=facts.noise_bandwidth, doubts=tuple(doubts))


def estimated(found: Crossed, estimator: Estimator) -> Frf:
    """Return the frequency response function that averaged spectra stand for, without a look at its doubts."""
    value = _values(found, estimator)
    telling = found.effective_averages >= _FEWEST
    coherence = np.clip(found.coherence, 0.0, 1.0) if telling else None
    magnitude_error = phase_error = None
    if coherence is not None:
        freedom = 2 * (found.effective_averages - 1)
        lost = 1 - coherence
        phase_error = np.sqrt(lost / (freedom * np.maximum(coherence, 1e-12)))
        magnitude_error = np.sqrt(lost / freedom) if estimator == "Hv" else phase_error
    return Frf(
        frequency=found.frequency,
        value=value,
        coherence=coherence,
        magnitude_error=magnitude_error,
        phase_error=phase_error,
        freedom=2 * max(found.effective_averages - 1, 0.0),
        averages=found.averages,
        effective_averages=found.effective_averages,
        resolution=found.resolution,
    )


def _values(found: Crossed, estimator: Estimator) -> Complex:
    driven = np.where(found.xx > 1e-24 * found.xx.max(), found.xx, np.nan)
    if estimator == "H1":
        with np.errstate(invalid="ignore"):  # a complex number over NaN is one more NaN, and a warning
            return np.asarray(found.xy / driven)
    turn = np.exp(1j * np.angle(found.xy))
    if estimator == "Hv":
        return np.asarray(np.sqrt(found.yy / driven) * turn)
    common = np.abs(found.xy)
    return np.asarray(found.yy / np.where(common > 0, common, np.nan) * turn)
