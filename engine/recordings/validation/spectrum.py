"""The same comparison in the frequency domain: measured and simulated responses to the recorded input, line by line.

    unexplained = 100 sqrt(Σ (1 - γ²) S_yy n / (n - 1) / Σ S_yy · var y / mean y²)

Both responses are estimated in the same way from the same input (averaged H1), so that what the estimator does to one it does
to the other; a nonlinear model is compared at the amplitudes of the recording. Only lines count about which the recording
tells something: a coherence of at least 0.7, and an input within 50 dB of its strongest line.

What a linear model of this input does not explain is noise, another input, or nonlinear: a model that misses no more than that
gains little by other values of its parameters. It is an estimate, too large where what happens in one segment goes on in the
next (steps, slow systems).

References
----------
J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., Wiley 2010, sections 6.1 (coherent output) and 9.2 (errors).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from engine.exact.frequency.fourier import Complex
from engine.recordings.spectra import comparison as spectra
from engine.recordings.spectra.averaged import averaged_frf, estimated
from engine.recordings.spectra.conditioned import conditioned
from engine.recordings.spectra.crossed import Crossed, crossed
from engine.recordings.spectra.frf import Confidence, Frf, confidence
from engine.recordings.spectra.sampled import window_of
from engine.recordings.validation.comparison import Comparison

SEGMENTS = 8
LEVEL = 0.95
_COHERENT = 0.7
DRIVEN = 1e-5
"""Of the power of the strongest line of the input: among thousands of lines of noise some look coherent by chance."""
MOST_INPUTS = 6
"""All pairs of channels are transformed; and each further input costs an average of the some fifteen."""
_SHORTEST = 512
"""Samples of a window below which eight segments hold too few lines."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyDomain:
    """Measured and simulated frequency responses where the recording tells something.

    Attributes
    ----------
    source : str
        The input.
    measured : Frf
        Its lines of enough coherence.
    bounds : Confidence or None
        Of the measured one.
    simulated : ndarray of complex, shape (lines,)
    comparison : engine.recordings.spectra.comparison.Comparison
    lines : int
        Of all coherences.
    unexplained_percent : float or None
        Relative error that a linear model of the only input leaves, judged from the coherence.
    """

    source: str
    measured: Frf
    bounds: Confidence | None
    simulated: Complex
    comparison: spectra.Comparison
    lines: int
    unexplained_percent: float | None


def frequency_domain(comparison: Comparison) -> FrequencyDomain | None:
    """Return the comparison of the frequency responses.

    None for several inputs (see :func:`by_input`), a short window, a channel that does not change, or where no line is coherent.

    Parameters
    ----------
    comparison : Comparison
    """
    if len(comparison.inputs) != 1 or not long_and_moving(comparison):
        return None
    ((source, u),) = comparison.inputs.items()
    rate, segment = 1.0 / comparison.sample_time, comparison.measured.size // SEGMENTS
    frf = averaged_frf([(u, comparison.measured)], rate, segment=segment)
    model = averaged_frf([(u, comparison.simulated)], rate, segment=segment)
    powers = crossed([(u, comparison.measured)], rate, segment=segment)
    return _compared(source, frf, model, powers, _unexplained(comparison, powers))


def by_input(comparison: Comparison) -> dict[str, FrequencyDomain]:
    """Return the comparison for each of several inputs, without what the others explain of it and of the output.

    Inputs that are made of each other on all lines (displacement and velocity of one motion) cannot be told apart, and are
    left out, as are those about which no line tells anything; nothing for one input (see :func:`frequency_domain`).

    Parameters
    ----------
    comparison : Comparison
    """
    if not 2 <= len(comparison.inputs) <= MOST_INPUTS or not long_and_moving(comparison):
        return {}
    rate, segment = 1.0 / comparison.sample_time, comparison.measured.size // SEGMENTS
    inputs = list(comparison.inputs.values())
    of_measured = conditioned(inputs, comparison.measured, rate, segment=segment)
    of_model = conditioned(inputs, comparison.simulated, rate, segment=segment)
    width = window_of("hann", segment)[0].noise_bandwidth
    found = {}
    for source, powers, model in zip(comparison.inputs, of_measured, of_model, strict=True):
        frf = replace(estimated(powers, "H1"), line_width=width)
        one = _compared(source, frf, estimated(model, "H1"), powers, None)
        if one is not None:
            found[source] = one
    return found


def long_and_moving(comparison: Comparison) -> bool:
    """Return whether a window holds enough samples for eight segments, and every signal changes."""
    signals = (*comparison.inputs.values(), comparison.measured, comparison.simulated)
    return comparison.measured.size >= _SHORTEST and all(_changes(signal) for signal in signals)


def _compared(source: str, frf: Frf, model: Frf, powers: Crossed, unexplained: float | None) -> FrequencyDomain | None:
    """Return the comparison on the lines about which the recording tells something; None where there is none."""
    if frf.coherence is None:
        return None
    told = np.isfinite(frf.value) & np.isfinite(model.value) & (powers.xx >= DRIVEN * powers.xx.max())
    told &= frf.coherence >= _COHERENT
    if not told.any():
        return None
    assert frf.magnitude_error is not None
    assert frf.phase_error is not None
    measured = replace(
        frf,
        frequency=frf.frequency[told],
        value=frf.value[told],
        coherence=frf.coherence[told],
        magnitude_error=frf.magnitude_error[told],
        phase_error=frf.phase_error[told],
    )
    simulated = model.value[told]
    return FrequencyDomain(
        source=source,
        measured=measured,
        bounds=confidence(measured, LEVEL),
        simulated=simulated,
        comparison=spectra.compared(measured, simulated, level=LEVEL),
        lines=frf.frequency.size,
        unexplained_percent=unexplained,
    )


def _changes(signal: np.ndarray[tuple[int], np.dtype[np.float64]]) -> bool:
    return bool(np.ptp(signal) > 1e-12 * np.abs(signal).max())


def _unexplained(comparison: Comparison, found: Crossed) -> float | None:
    n = found.effective_averages
    if n <= 1.5:
        return None
    lost = np.where(np.isfinite(found.coherence), 1.0 - np.clip(found.coherence, 0.0, 1.0), 1.0)
    share = min(float((lost * found.yy).sum() / found.yy.sum()) * n / (n - 1.0), 1.0)
    y = comparison.measured
    return float(100 * np.sqrt(share * y.var() / np.mean(y**2)))
