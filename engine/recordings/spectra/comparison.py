"""A simulated frequency response beside the measured one.

    deviation = 20 lg |H_model / H_measured| dB,     relative error = 100 ||H_measured - H_model|| / ||H_measured||

A line agrees when the model lies in the circle around the measurement that holds the truth with the probability chosen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.exact.frequency.fourier import Complex, Real
from engine.recordings.spectra.frf import MOST_UNCERTAIN, Frf


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """How a model's frequency response differs from the measured one.

    ``deviation`` in dB and ``phase_deviation`` in rad, line by line (model against measurement); ``within_percent`` of the
    lines agree (None without a random error).
    """

    deviation: Real
    phase_deviation: Real
    median_deviation: float
    worst_deviation: float
    worst_frequency: float
    relative_error_percent: float
    within_percent: float | None


def compared(measured: Frf, simulated: Complex, *, level: float = 0.95) -> Comparison:
    """Return the differences.

    Parameters
    ----------
    measured : Frf
    simulated : ndarray of complex, shape (lines,)
        At the same frequencies, in the same unit.
    level : float
        Probability.
    """
    there = np.isfinite(measured.value) & (np.abs(measured.value) > 0) & (np.abs(simulated) > 0)
    ratio = np.full(there.size, np.nan, dtype=np.complex128)
    ratio[there] = simulated[there] / measured.value[there]
    deviation = 20 * np.log10(np.abs(ratio))
    known = deviation[there]
    worst = int(np.argmax(np.where(there, np.abs(deviation), -1.0)))
    distance = np.linalg.norm(measured.value[there] - simulated[there]) / np.linalg.norm(measured.value[there])
    return Comparison(
        deviation=deviation,
        phase_deviation=np.angle(ratio),
        median_deviation=float(np.median(np.abs(known))) if known.size else np.nan,
        worst_deviation=float(np.abs(deviation[worst])),
        worst_frequency=float(measured.frequency[worst]),
        relative_error_percent=float(100 * distance),
        within_percent=_within(measured, ratio, there, level),
    )


def _within(
    measured: Frf, ratio: Complex, there: np.ndarray[tuple[int], np.dtype[np.bool_]], level: float
) -> float | None:
    if measured.magnitude_error is None or measured.phase_error is None or not there.any():
        return None
    from scipy.stats import f  # noqa: PLC0415 - a third of a second

    wide = np.sqrt(2 * float(f.ppf(level, 2, measured.freedom)))
    along = np.minimum(measured.magnitude_error[there], MOST_UNCERTAIN)
    across = np.minimum(measured.phase_error[there], MOST_UNCERTAIN)
    away = np.log(ratio[there])
    inside = (away.real / np.maximum(along, 1e-15)) ** 2 + (away.imag / np.maximum(across, 1e-15)) ** 2 <= wide**2
    return float(100 * inside.mean())
