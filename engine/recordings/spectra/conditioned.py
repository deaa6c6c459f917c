"""Spectra of one input and the output, without what the other inputs explain of both: each input as if it were alone.

    S_kk·r = S_kk - S_kr S_rr⁻¹ S_rk,   S_ky·r = S_ky - S_kr S_rr⁻¹ S_ry,   S_yy·r = S_yy - S_yr S_rr⁻¹ S_ry

r are the other inputs. S_ky·r / S_kk·r is then the response to input k; each other input costs one independent average.

References
----------
J. S. Bendat, A. G. Piersol, "Random Data", 4th ed., Wiley 2010, section 7.3 (conditioned spectra).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from engine.exact.frequency.fourier import Complex, Real
from engine.recordings.spectra.crossed import Crossed, crossed

_ALONE = 1e-3
"""Share of an input's power that must be left without the others: less cannot be told from rounding and leakage."""


def conditioned(inputs: Sequence[Real], output: Real, rate: float, *, segment: int) -> list[Crossed]:
    """Return the spectra of each input with the output, without the other inputs.

    Lines on which an input is (nearly) made of the others have no power: they tell nothing of it.

    Parameters
    ----------
    inputs : sequence of ndarray, shape (samples,)
        Two or more.
    output : ndarray, shape (samples,)
    rate : float
        Samples per second.
    segment : int
        Samples of one segment.

    Raises
    ------
    SpectrumError
        As of :func:`engine.recordings.spectra.crossed.crossed`.
    """
    channels = [*inputs, output]
    size = len(channels)
    first = crossed([(channels[0], channels[0])], rate, segment=segment)
    powers = np.empty((first.frequency.size, size, size), dtype=np.complex128)
    for i in range(size):
        for j in range(i, size):
            found = crossed([(channels[i], channels[j])], rate, segment=segment)
            powers[:, i, j], powers[:, j, i] = found.xy, found.xy.conj()
    count = max(first.effective_averages - (len(inputs) - 1), 0.0)
    return [replace(_without(powers, k, first), effective_averages=count) for k in range(len(inputs))]


def _without(powers: Complex, k: int, like: Crossed) -> Crossed:
    """Return the spectra of input k and the output (the last channel) without the other inputs."""
    last = powers.shape[1] - 1
    kept, others = [k, last], [i for i in range(last) if i != k]
    between = powers[:, kept][:, :, others]
    # conj(X) Y: what is explained is S_ar S_rr⁻¹ S_rb; scaled, so that units decide on no rank
    scale = np.sqrt(np.maximum(np.einsum("lii->li", powers[:, others][:, :, others]).real, 1e-300))
    inner = powers[:, others][:, :, others] / (scale[:, :, None] * scale[:, None, :])
    left = between / scale[:, None, :]
    rest = powers[:, kept][:, :, kept] - left @ np.linalg.pinv(
        inner, rcond=_ALONE, hermitian=True
    ) @ left.conj().swapaxes(1, 2)
    alone = rest[:, 0, 0].real > _ALONE * powers[:, k, k].real
    return replace(
        like,
        xx=np.where(alone, rest[:, 0, 0].real, 0.0),
        yy=np.where(alone, np.maximum(rest[:, 1, 1].real, 0.0), 0.0),
        xy=np.where(alone, rest[:, 0, 1], 0.0),
    )
