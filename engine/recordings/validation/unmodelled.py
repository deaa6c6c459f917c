"""The frequencies at which the input still explains the residual, and the mode of the structure that may look out of it.

    γ² = |S_ue|² / (S_uu S_ee)     where nothing is left:  P(γ² > c) = (1 - c)^(n - 1),   n independent averages

A line holds something when its γ² exceeds the c that all driven lines together exceed by chance once in a hundred recordings.
That law asks nothing of the input (a chirp is in one or two of the segments) nor of the colour of the noise, only that the noise
stays the same from segment to segment: hum of the mains is no finding, however strong.

What the model lacks there, relative to what it does, may have the shape of a resonance:

    S_ue / S_uŷ ≈ (b2 s² + b1 s + b0) / (s² + 2 d w s + w²)

which is then a mode that the model does not have, or has elsewhere.

References
----------
G. C. Carter, "Coherence and time delay estimation", Proc. IEEE 75 (1987) 236-255 (the law of γ² where nothing is shared).
C. K. Sanathanan, J. Koerner, IEEE Trans. Autom. Control 8 (1963) 56-58 (fitting a quotient of polynomials).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from engine.exact.frequency.fourier import Complex, Real
from engine.recordings.spectra.conditioned import conditioned
from engine.recordings.spectra.crossed import Crossed, crossed
from engine.recordings.validation.comparison import Comparison
from engine.recordings.validation.spectrum import DRIVEN, MOST_INPUTS, SEGMENTS, long_and_moving

FALSE_ALARMS = 0.01
"""Probability of a finding in a recording in which there is nothing to find."""
_NEIGHBOURS = 3
"""Lines from one finding to the next of the same band: a line between them may miss by chance."""
_FEWEST_LINES = 6
"""Of a band that are to tell five numbers of a resonance."""
_HIGHEST_DAMPING = 0.3
_ALIKE = 0.6
"""Share of what a band holds that its resonance must explain, and of what a smooth correction of as many numbers leaves of it."""
_ITERATIONS = 30


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Resonance:
    """What a model lacks around one frequency, relative to what it does, as a quotient of polynomials in s.

    Attributes
    ----------
    frequency : float
        Undamped angular frequency, rad/s.
    damping_ratio : float
    numerator : ndarray, shape (3,)
        b2, b1, b0; the denominator is s² + 2 d w s + w².
    """

    frequency: float
    damping_ratio: float
    numerator: Real

    @property
    def denominator(self) -> Real:
        """1, 2 d w, w²."""
        return np.array([1.0, 2.0 * self.damping_ratio * self.frequency, self.frequency**2])


@dataclass(frozen=True, slots=True, kw_only=True)
class Unmodelled:
    """A band in which the input explains a part of the residual.

    Attributes
    ----------
    source : str
        The input.
    lower, upper, frequency : float
        Ends of the band and where the part is strongest, rad/s.
    rms : float
        Of the part, unit of the output.
    share_percent : float
        Of the part in the power of the residual.
    relative : float
        At ``frequency``, size of the part beside the response of the model.
    resonance : Resonance or None
        Where the band has the shape of one.
    """

    source: str
    lower: float
    upper: float
    frequency: float
    rms: float
    share_percent: float
    relative: float
    resonance: Resonance | None


def unmodelled(comparison: Comparison) -> tuple[Unmodelled, ...]:
    """Return the bands in which an input explains what the model leaves, the strongest first.

    None for a short window, for more than six inputs, and for inputs that are made of each other.

    Parameters
    ----------
    comparison : Comparison
    """
    count = len(comparison.inputs)
    residual = comparison.residual
    if not 1 <= count <= MOST_INPUTS or not long_and_moving(comparison) or not np.ptp(residual) > 0.0:
        return ()
    rate, segment = 1.0 / comparison.sample_time, comparison.measured.size // SEGMENTS
    inputs = list(comparison.inputs.values())
    left, model = (
        [crossed([(inputs[0], signal)], rate, segment=segment)]
        if count == 1
        else conditioned(inputs, signal, rate, segment=segment)
        for signal in (residual, comparison.simulated)
    )
    found = [
        band
        for source, of_residual, of_model in zip(comparison.inputs, left, model, strict=True)
        for band in _bands(source, of_residual, of_model, power=float(np.var(residual)), tests=count)
    ]
    return tuple(sorted(found, key=lambda band: -band.rms))


def told(name: str, found: Sequence[Unmodelled]) -> tuple[str, ...]:
    """Return a sentence on each resonance that was found.

    Parameters
    ----------
    name : str
        Of the output.
    found : sequence of Unmodelled
    """
    return tuple(
        f"{name} swings at {band.resonance.frequency / (2 * np.pi):.4g} Hz (damping ratio {band.resonance.damping_ratio:.2g}) "
        f"as the model does not: there, {band.source} still explains {band.share_percent:.3g} % of the residual, and up to "
        f"{100 * band.relative:.3g} % of the response is missing: a mode of the structure that the model lacks, or has elsewhere"
        for band in found
        if band.resonance is not None
    )


def threshold(lines: int, averages: float, *, tests: int = 1) -> float:
    """Return the coherence that the strongest of some lines exceeds by chance once in a hundred recordings."""
    return float(1.0 - (FALSE_ALARMS / (max(lines, 1) * tests)) ** (1.0 / (averages - 1.0)))


def _bands(source: str, left: Crossed, model: Crossed, *, power: float, tests: int) -> list[Unmodelled]:
    averages = left.effective_averages
    driven = (left.xx >= DRIVEN * left.xx.max()) & (left.xx > 0.0) & (np.abs(model.xy) > 0.0)
    if averages <= 2.0 or not driven.any():
        return []
    coherence = np.where(driven, np.nan_to_num(left.coherence), 0.0)
    hits = np.flatnonzero(coherence > threshold(int(driven.sum()), averages, tests=tests))
    if not hits.size:
        return []
    # By chance 1/n of a noise looks coherent.
    shared = np.clip((averages * coherence - 1.0) / (averages - 1.0), 0.0, 1.0) * left.yy
    total = float(left.yy.sum())
    found = []
    for lines in np.split(hits, np.flatnonzero(np.diff(hits) > _NEIGHBOURS) + 1):
        band = slice(int(lines[0]), int(lines[-1]) + 1)
        strongest = band.start + int(np.argmax(shared[band]))
        share = float(shared[band].sum()) / total
        found.append(
            Unmodelled(
                source=source,
                lower=float(left.frequency[band.start]),
                upper=float(left.frequency[band.stop - 1]),
                frequency=float(left.frequency[strongest]),
                rms=float(np.sqrt(share * power)),
                share_percent=100.0 * share,
                relative=float(np.abs(left.xy[strongest] / model.xy[strongest])),
                resonance=_resonance(left, model, driven, band),
            )
        )
    return found


def _resonance(left: Crossed, model: Crossed, driven: npt.NDArray[np.bool_], band: slice) -> Resonance | None:
    """Return the resonance that a band has the shape of; None where it has another one."""
    lines = np.flatnonzero(driven[band]) + band.start
    if lines.size < _FEWEST_LINES:
        return None
    lacks = left.xy[lines] / model.xy[lines]
    noise = np.maximum(1.0 - np.nan_to_num(left.coherence[lines]), 1e-6) * left.yy[lines]
    certainty = np.abs(model.xy[lines]) / np.sqrt(noise * left.xx[lines])
    found = _quotient(left.frequency[lines], lacks, certainty)
    if found is None:
        return None
    resonance, value = found
    inside = left.frequency[band.start] <= resonance.frequency <= left.frequency[band.stop - 1]
    missed = np.sum(np.abs(certainty * (lacks - value)) ** 2)
    # of a model that is wrong everywhere a band is left where all else is drowned: any curve with five numbers bends to it
    smooth = np.sum(np.abs(certainty * (lacks - _polynomial(left.frequency[lines], lacks, certainty))) ** 2)
    return resonance if inside and missed <= (1.0 - _ALIKE) * smooth else None


def _polynomial(frequency: Real, value: Complex, certainty: Real) -> Complex:
    """Fit c4 s⁴ + c3 s³ + c2 s² + c1 s + c0, each line by its certainty."""
    s = 1j * frequency / frequency[-1]
    powers = s[:, None] ** np.arange(5)
    matrix, right = powers * certainty[:, None], value * certainty
    found = np.linalg.lstsq(np.vstack([matrix.real, matrix.imag]), np.hstack([right.real, right.imag]), rcond=None)[0]
    return np.asarray(powers @ found)


def _quotient(frequency: Real, value: Complex, certainty: Real) -> tuple[Resonance, Complex] | None:
    """Fit (b2 s² + b1 s + b0) / (s² + a1 s + a0), each line by its certainty; None where it does not swing."""
    unit = float(np.sqrt(frequency[0] * frequency[-1]))
    s = 1j * frequency / unit
    denominator = np.ones_like(s)
    found = np.zeros(5)
    for _ in range(_ITERATIONS):
        weight = certainty / np.maximum(np.abs(denominator), 1e-9)
        matrix = np.column_stack([s**2, s, np.ones_like(s), -value * s, -value]) * weight[:, None]
        right = value * s**2 * weight
        found = np.linalg.lstsq(np.vstack([matrix.real, matrix.imag]), np.hstack([right.real, right.imag]), rcond=None)[
            0
        ]
        denominator = s**2 + found[3] * s + found[4]
    if found[3] <= 0.0 or found[4] <= 0.0:
        return None
    natural = float(np.sqrt(found[4]))
    damping = float(found[3] / (2.0 * natural))
    if damping > _HIGHEST_DAMPING:
        return None
    fitted = (found[0] * s**2 + found[1] * s + found[2]) / denominator
    numerator = found[:3] * np.array([1.0, unit, unit**2])
    return Resonance(frequency=natural * unit, damping_ratio=damping, numerator=numerator), fitted
