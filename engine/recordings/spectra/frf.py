"""A measured frequency response function, with what its random error is.

H(jω) = Y(jω) / X(jω),   ln|H| and arg H each within ± t σ,   t of Student's distribution
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from engine.exact.frequency.fourier import Complex, Real
from engine.model.errors import SpectrumError
from engine.recordings.spectra.stretches import Samples, extremes

MOST_UNCERTAIN = 30.0
"""Largest half width of a band of ln|H|: beyond it nothing is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Doubt:
    """A systematic error that the confidence band does not show; ``frequency`` in rad/s where it has a place."""

    kind: str
    detail: str
    frequency: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Frf:
    """A response over an input, line by line.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        rad/s.
    value : ndarray of complex, shape (lines,)
        Unit of the response per unit of the input; NaN where the input holds nothing.
    coherence : ndarray or None
        γ², 0 to 1: what part of the response the input explains linearly; None where nothing tells.
    magnitude_error, phase_error : ndarray or None
        Standard deviation of ln|H| and of arg H (rad); None where nothing tells.
    freedom : float
        Degrees of freedom behind the errors.
    averages : int
        Segments, periods, or parts of a step.
    effective_averages : float
        Independent segments that would be as certain.
    resolution : float or None
        Distance of lines, rad/s; None where they were chosen one by one.
    line_width : float
        Lines that share their random error: the noise bandwidth of a window, 1 without.
    doubts : tuple of Doubt
    """

    frequency: Real
    value: Complex
    coherence: Real | None = None
    magnitude_error: Real | None = None
    phase_error: Real | None = None
    freedom: float = 0.0
    averages: int = 1
    effective_averages: float = 1.0
    resolution: float | None = None
    line_width: float = 1.0
    doubts: tuple[Doubt, ...] = field(default=())

    def within(self, low: float, high: float) -> Frf:
        """Return the lines between two angular frequencies.

        Raises
        ------
        SpectrumError
            If there is none.
        """
        inside = (self.frequency >= low) & (self.frequency <= high)
        if not inside.any():
            first, last = self.frequency[0], self.frequency[-1]
            msg = f"band must hold lines of {first:g} to {last:g} rad/s, got [{low:g}, {high:g}]"
            raise SpectrumError(msg, at=("band",))
        doubts = tuple(doubt for doubt in self.doubts if doubt.frequency is None or low <= doubt.frequency <= high)
        return replace(
            self,
            frequency=self.frequency[inside],
            value=self.value[inside],
            coherence=_picked(self.coherence, inside),
            magnitude_error=_picked(self.magnitude_error, inside),
            phase_error=_picked(self.phase_error, inside),
            doubts=doubts,
        )

    def times(self, factor: Complex) -> Frf:
        """Return this function with every line multiplied by an exact factor."""
        return replace(self, value=self.value * factor)


def _picked(values: Real | None, inside: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Real | None:
    return None if values is None else values[inside]


@dataclass(frozen=True, kw_only=True, eq=False)
class Confidence:
    """Bounds that hold the truth line by line with a probability ``level``; magnitudes, and rad."""

    level: float
    magnitude_lower: Real
    magnitude_upper: Real
    phase_lower: Real
    phase_upper: Real


def confidence(frf: Frf, level: float = 0.95) -> Confidence | None:
    """Return the bounds of magnitude and of phase (unwrapped), None where nothing tells the random error.

    Parameters
    ----------
    frf : Frf
    level : float
        Probability, > 0 and < 1.

    Raises
    ------
    SpectrumError
        For a level that is none.
    """
    if not 0 < level < 1:
        raise SpectrumError(f"confidence must be > 0 and < 1, got {level:g}", at=("confidence",))
    if frf.magnitude_error is None or frf.phase_error is None:
        return None
    from scipy.stats import t  # noqa: PLC0415 - a third of a second

    times = float(t.ppf((1 + level) / 2, frf.freedom))
    wide = np.minimum(times * frf.magnitude_error, MOST_UNCERTAIN)
    turned = np.minimum(times * frf.phase_error, np.pi)
    magnitude, phase = np.abs(frf.value), unwrapped(frf.value)
    return Confidence(
        level=level,
        magnitude_lower=magnitude * np.exp(-wide),
        magnitude_upper=magnitude * np.exp(wide),
        phase_lower=phase - turned,
        phase_upper=phase + turned,
    )


def unwrapped(value: Complex) -> Real:
    """Return the phase of consecutive lines without jumps, rad; lines that hold nothing are passed over."""
    phase = np.angle(value)
    there = np.isfinite(phase)
    phase[there] = np.unwrap(phase[there])
    return phase


def check_pair(x: Real, y: Real) -> None:
    """Refuse two channels that have no frequency response function.

    Raises
    ------
    SpectrumError
        If they differ in length, or one of them never changes.
    """
    if x.shape != y.shape or x.ndim != 1:
        raise SpectrumError(f"input and output must be of the same length, got {x.size} and {y.size} samples")
    for name, values in (("input", x), ("output", y)):
        check_changing(name, [values])


def check_changing(name: str, experiments: Sequence[Samples]) -> None:
    """Refuse a channel that is the same all the time.

    Raises
    ------
    SpectrumError
        At ``name``.
    """
    ends = [extremes(values) for values in experiments if values.size]
    low, high = min((low for low, _ in ends), default=0.0), max((high for _, high in ends), default=0.0)
    if high - low <= 1e-14 * max(high, -low):
        raise SpectrumError(f"{name} must change, got a constant channel", at=(name,))
