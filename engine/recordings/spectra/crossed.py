"""Auto- and cross-spectra of two channels, averaged over windowed, overlapping segments.

    S_xy = Σ_segments conj(X) Y,   γ² = |S_xy|² / (S_xx S_yy)

Overlapping segments are not independent: n of them are worth  n / (1 + 2 Σ_k (1 - k/n) ρ_k²),  with ρ_k the correlation
of the window with itself k segments further on.

References
----------
P. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73 (averaging, and what overlap costs).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from engine.exact.frequency.fourier import Complex, Real
from engine.model.errors import SpectrumError
from engine.recordings.spectra.sampled import Removal, WindowKind, window_of
from engine.recordings.spectra.stretches import Samples

SHORTEST = 8
"""Samples of a segment."""

_MOST_NUMBERS = 500_000
"""Samples transformed at once: 4 MB, and as much for their lines."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossed:
    """Sums over segments, lines between 0 and half the rate, both left out; ``frequency`` and ``resolution`` in rad/s.

    ``shares`` is the part of the segments that hold the input's power at a line, (Σ |X|²)² / (n Σ |X|⁴): 1 where all hold as much,
    1/2 of noise, 1/n where one holds it all.
    """

    frequency: Real
    xx: Real
    yy: Real
    xy: Complex
    shares: Real
    averages: int
    effective_averages: float
    resolution: float

    @property
    def coherence(self) -> Real:
        """γ² of each line; NaN where one of the channels holds nothing."""
        return np.abs(self.xy) ** 2 / _positive(self.xx) / _positive(self.yy)


def _positive(power: Real) -> Real:
    return np.where(power > 1e-24 * power.max(), power, np.nan)


def crossed(
    pairs: Sequence[tuple[Samples, Samples]],
    rate: float,
    *,
    segment: int,
    window: WindowKind = "hann",
    overlap: float = 0.5,
    removal: Removal = "mean",
) -> Crossed:
    """Return the averaged spectra of two channels.

    Parameters
    ----------
    pairs : sequence of (Samples, Samples)
        Input and output of each experiment: no segment lies in two.
    rate : float
        Samples per second.
    segment : int
        Samples of one segment.
    window : {"hann", "flat_top", "none"}
    overlap : float
        Of neighbouring segments, 0 <= overlap < 1.
    removal : {"nothing", "mean", "trend"}
        What is taken away from each segment first.

    Raises
    ------
    SpectrumError
        If no experiment is as long as a segment, or settings are out of their bounds.
    """
    longest = max(x.size for x, _ in pairs)
    if not SHORTEST <= segment <= longest:
        msg = (
            f"segment must be {SHORTEST} to {longest} samples ({longest / rate:g} s, the recording), "
            f"got {segment} ({segment / rate:g} s)"
        )
        raise SpectrumError(msg, at=("segment",))
    if not 0 <= overlap < 1:
        raise SpectrumError(f"overlap must be >= 0 and < 1, got {overlap:g}", at=("overlap",))
    _, weights = window_of(window, segment)
    step = segment - min(round(overlap * segment), segment - 1)
    lines = segment // 2 + 1
    xx, yy, xy = np.zeros(lines), np.zeros(lines), np.zeros(lines, dtype=np.complex128)
    squares = np.zeros(lines)
    averages, effective = 0, 0.0
    for x, y in pairs:
        if x.size < segment:
            continue
        count = 1 + (x.size - segment) // step
        averages += count
        effective += _independent(count, step, weights)
        for span in _spans(count, segment):
            stretch = slice(span.start * step, (span.stop - 1) * step + segment)
            left = _lines(x[stretch], weights, step, removal)
            right = _lines(y[stretch], weights, step, removal)
            power = np.abs(left) ** 2
            xx += power.sum(axis=0)
            squares += (power**2).sum(axis=0)
            yy += (np.abs(right) ** 2).sum(axis=0)
            xy += (left.conj() * right).sum(axis=0)
    inside = slice(1, (segment + 1) // 2)
    return Crossed(
        frequency=2 * np.pi * rate / segment * np.arange(lines, dtype=np.float64)[inside],
        xx=xx[inside],
        yy=yy[inside],
        xy=xy[inside],
        shares=(xx**2 / (averages * np.where(squares > 0.0, squares, math.inf)))[inside],
        averages=averages,
        effective_averages=effective,
        resolution=2 * np.pi * rate / segment,
    )


def _spans(count: int, segment: int) -> Iterator[slice]:
    chunk = max(1, _MOST_NUMBERS // segment)
    return (slice(start, min(start + chunk, count)) for start in range(0, count, chunk))


def _lines(values: Real, weights: Real, step: int, removal: Removal) -> Complex:
    """Return the transforms of the segments of a stretch, shape (segments, lines)."""
    parts = sliding_window_view(values, weights.size)[::step]
    if removal != "nothing":
        parts = parts - parts.mean(axis=1, keepdims=True)
    if removal == "trend":
        position = np.arange(weights.size) - (weights.size - 1) / 2
        parts = parts - np.multiply.outer(parts @ position / (position @ position), position)
    return np.asarray(np.fft.rfft(parts * weights))


def _independent(count: int, step: int, weights: Real) -> float:
    """Return how many independent segments ``count`` overlapping ones are worth."""
    shared = 0.0
    for k in range(1, count):
        if k * step >= weights.size:
            break
        correlation = float(weights[k * step :] @ weights[: -k * step] / (weights @ weights))
        shared += (1 - k / count) * correlation**2
    return count / (1 + 2 * shared)
