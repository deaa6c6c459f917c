"""Spectra estimated from samples: of recordings, and of whatever is known at equal intervals only.

    amplitude_k = 2 |Σ_n w_n x_n e^{-j2πkn/N}| / Σ_n w_n             so that a sine of amplitude A on line k reads A
    density_k   = 2 |Σ_n w_n x_n e^{-j2πkn/N}|² / (rate Σ_n w_n²)    so that ∫ density dω/2π is the mean square

(the factor 2 only between the ends of the axis). Several overlapping segments are averaged as powers.

References
----------
P. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73 (averaged, overlapping segments).
F. Harris, Proc. IEEE 66 (1978) 51-83 (windows, coherent gain, equivalent noise bandwidth).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from engine.model.errors import SpectrumError

Real = npt.NDArray[np.float64]

WindowKind = Literal["flat_top", "hann", "none"]
Removal = Literal["nothing", "mean", "trend"]
Quantity = Literal["amplitude", "density"]

_COSINES: dict[WindowKind, tuple[float, ...]] = {
    "flat_top": (0.21557895, 0.41663158, 0.277263158, 0.083578947, 0.006947368),
    "hann": (0.5, 0.5),
    "none": (1.0,),
}
"""Of the windows as sums of cosines; the flat top of D'Antona and Ferrero, "Digital Signal Processing for Measurement Systems", 2006, p. 70."""
_AT_ONCE = 1 << 19
"""Samples that are windowed and transformed together: 4 MB, whatever the length of the recording."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """A window and what it does to a spectrum.

    ``coherent_gain`` is the mean of its weights; ``noise_bandwidth`` the width, in lines, of the ideal filter that lets
    as much noise pass as one line does.
    """

    kind: WindowKind
    coherent_gain: float
    noise_bandwidth: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """An estimated spectrum.

    Parameters
    ----------
    frequency : ndarray, shape (lines,)
        rad/s.
    value : ndarray, shape (lines,)
        Amplitude, in the unit of the signal; or density, in its square per Hz.
    phase : ndarray or None
        Of each line at the first sample (cosine), rad; None where segments are averaged, and of a density.
    resolution : float
        Distance of lines, rad/s.
    highest : float
        End of the axis: half the sample rate, rad/s.
    averages : int
        Segments.
    window : Window
    """

    frequency: Real
    value: Real
    phase: Real | None
    resolution: float
    highest: float
    averages: int
    window: Window


def window_of(kind: WindowKind, length: int) -> tuple[Window, Real]:
    """Return a window and its weights, shape (length,), periodic as a discrete transform wants them.

    Examples
    --------
    >>> window, _ = window_of("hann", 1024)
    >>> window.coherent_gain, window.noise_bandwidth
    (0.5, 1.5)
    """
    weights = np.empty(length)
    for start in range(0, length, _AT_ONCE):
        part = weights[start : start + _AT_ONCE]
        angle = np.arange(start, start + part.size) * (2 * np.pi / length) - np.pi
        part[:] = sum(factor * np.cos(k * angle) for k, factor in enumerate(_COSINES[kind]))
    gain = float(weights.mean())
    bandwidth = float(length * (weights**2).sum() / weights.sum() ** 2)
    return Window(kind=kind, coherent_gain=gain, noise_bandwidth=bandwidth), weights


def spectrum(
    values: Real,
    rate: float,
    *,
    quantity: Quantity = "amplitude",
    window: WindowKind = "flat_top",
    segment: int | None = None,
    overlap: float = 0.5,
    removal: Removal = "nothing",
) -> Spectrum:
    """Return the one-sided spectrum of samples.

    Parameters
    ----------
    values : ndarray, shape (samples,)
    rate : float
        Samples per second.
    quantity : {"amplitude", "density"}
        What a line shows: the amplitude of a sine there, or the mean square per Hz.
    window : {"flat_top", "hann", "none"}
        Flat-top reads amplitudes right between lines too (to 0.1 %), Hann separates lines that are close; none is exact
        for a whole number of periods.
    segment : int, optional
        Samples of one segment; all by default.
    overlap : float
        Of neighbouring segments, as a part of one, 0 <= overlap < 1.
    removal : {"nothing", "mean", "trend"}
        What is taken away from each segment first.

    Raises
    ------
    SpectrumError
        If there are too few samples, or settings are out of their bounds.
    """
    length = len(values) if segment is None else segment
    if not 8 <= length <= len(values):
        raise SpectrumError(f"segment must be 8 to {len(values)} samples, got {length}", at=("segment",))
    if not 0 <= overlap < 1:
        raise SpectrumError(f"overlap must be >= 0 and < 1, got {overlap:g}", at=("overlap",))
    facts, weights = window_of(window, length)
    shared = min(round(overlap * length), length - 1)
    parts = sliding_window_view(values, length)[:: length - shared]
    averages = len(parts)
    total, phase = np.zeros(length // 2 + 1), None
    together = max(1, _AT_ONCE // length)
    for start in range(0, averages, together):
        lines = np.fft.rfft(_removed(parts[start : start + together], removal) * weights)
        if averages == 1 and quantity == "amplitude":
            phase = np.angle(lines[0])
        for line in lines:
            total += line.real**2 + line.imag**2
    total /= averages
    # at 0 and at half the rate a line has no partner at -ω
    paired = slice(1, -1 if length % 2 == 0 else None)
    if quantity == "amplitude":
        value = np.sqrt(total, out=total)
        value /= weights.sum()
    else:
        value = total
        value /= rate * (weights**2).sum()
    value[paired] *= 2.0
    return Spectrum(
        frequency=2 * np.pi * rate / length * np.arange(length // 2 + 1, dtype=np.float64), value=value, phase=phase,
        resolution=2 * np.pi * rate / length, highest=np.pi * rate, averages=averages, window=facts,
    )  # fmt: skip


def averaged_spectrum(
    experiments: Sequence[Real], rate: float, *, segment: int | None = None, **settings: Any
) -> Spectrum:
    """Return the spectrum of several experiments, averaged over the segments of all: none lies in two.

    Parameters
    ----------
    experiments : sequence of ndarray, shapes (samples,)
    rate : float
        Samples per second.
    segment : int, optional
        Samples of one segment; the shortest experiment by default. Experiments that are shorter are left out.
    settings
        The other ones of :func:`spectrum`.

    Raises
    ------
    SpectrumError
        If no experiment is as long as a segment, or settings are out of their bounds.
    """
    if len(experiments) == 1:
        return spectrum(experiments[0], rate, segment=segment, **settings)
    length = min(values.size for values in experiments) if segment is None else segment
    usable = [values for values in experiments if values.size >= length] or [max(experiments, key=len)]
    found = [spectrum(values, rate, segment=length, **settings) for values in usable]
    power = 2 if settings.get("quantity", "amplitude") == "amplitude" else 1
    counts = np.array([each.averages for each in found])
    mean = counts @ np.array([each.value**power for each in found]) / counts.sum()
    value = np.asarray(mean ** (1 / power), dtype=np.float64)
    return replace(found[0], value=value, phase=None, averages=int(counts.sum()))


def _removed(values: Real, removal: Removal) -> Real:
    if removal == "nothing":
        return values
    # the package costs a tenth of a second, which a service that analyses nothing need not pay
    from scipy.signal import detrend  # noqa: PLC0415

    return np.asarray(detrend(values, type="constant" if removal == "mean" else "linear"), dtype=np.float64)


def band_mean_square(density: Spectrum, low: float, high: float) -> float:
    """Return the mean square in a band of an estimated density, in the squared unit of the signal.

    A line stands for a cell as wide as the resolution around its frequency; at both ends of the axis for half a cell.

    Parameters
    ----------
    density : Spectrum
        Of quantity ``density``.
    low, high : float
        rad/s.
    """
    half = density.resolution / 2
    bottom = np.maximum(density.frequency - half, 0.0)
    top = np.minimum(density.frequency + half, density.highest)
    # the power of a line at an end of the axis lies in half a cell
    height = density.value * density.resolution / (top - bottom)
    inside = np.clip(np.minimum(top, high) - np.maximum(bottom, low), 0.0, None)
    return float((height * inside).sum() / (2 * np.pi))
