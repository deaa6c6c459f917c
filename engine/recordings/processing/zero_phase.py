"""Filters that run forward and backward, so that nothing is delayed.

    y = F(-z) F(z) x,   so that the magnitude is |F|², 6 dB down where |F| is 3 dB down, and the phase is 0

Both ends are continued by odd reflection over three times the number of poles.

References
----------
F. Gustafsson, IEEE Trans. Signal Processing 44 (1996) 988-992 (forward-backward filtering).
A. V. Oppenheim, R. W. Schafer, "Discrete-Time Signal Processing", 3rd ed., Pearson 2010, section 7.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Real, Record

Band = Literal["low_pass", "high_pass", "band_pass", "band_stop"]
Family = Literal["butterworth", "chebyshev1"]

MOST_ORDER = 20

#: What rounding may move of what a filter answers, and the square of a pole's distance from 1, and twice that from the unit circle,
#: below which it moves as much.
_ROUNDING, _LEAST_DISTANCE = 1e-3, 1e-12
#: No filter answers so much more than it is given, whose gain is 1 at most; rounding does, where steep filters cover decades.
_MOST_GAIN = 100.0

_BANDS: Mapping[Band, Literal["lowpass", "highpass", "bandpass", "bandstop"]] = {
    "low_pass": "lowpass",
    "high_pass": "highpass",
    "band_pass": "bandpass",
    "band_stop": "bandstop",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ZeroPhaseFilter:
    """Filter channels forward and backward.

    Parameters
    ----------
    band : {"low_pass", "high_pass", "band_pass", "band_stop"}
    frequency : float or (float, float)
        Edges of one pass, rad/s: where a Butterworth filter is 3 dB down, where a Chebyshev filter leaves its ripple.
    order : int
        Of one pass; a band has twice as many poles.
    family : {"butterworth", "chebyshev1"}
    ripple : float
        In the pass band of one pass, dB; of ``chebyshev1``.
    channels : tuple of str, optional
        All by default.
    called : str
        What the edges are called where another step has them.

    Raises
    ------
    ProcessingError
        For numbers outside of their bounds.
    """

    band: Band
    frequency: float | tuple[float, float]
    order: int = 4
    family: Family = "butterworth"
    ripple: float = 0.05
    channels: tuple[str, ...] | None = None
    called: str = "frequency"

    def __post_init__(self) -> None:
        edges = self.edges
        wanted = 2 if self.band.startswith("band") else 1
        if len(edges) != wanted:
            word = "two edges" if wanted == 2 else "one number"
            raise ProcessingError(
                f"{self.called} must be {word} for a {self.band}, got {len(edges)}", at=(self.called,)
            )
        if any(not edge > 0 for edge in edges) or (wanted == 2 and not edges[0] < edges[1]):
            shown = ", ".join(f"{edge:g}" for edge in edges)
            raise ProcessingError(f"{self.called} must be > 0 rad/s and increasing, got {shown}", at=(self.called,))
        if not 1 <= self.order <= MOST_ORDER:
            raise ProcessingError(f"order must be 1 to {MOST_ORDER}, got {self.order}", at=("order",))
        if not 0 < self.ripple <= 10:
            raise ProcessingError(f"ripple must be > 0 and <= 10 dB, got {self.ripple:g}", at=("ripple",))
        if 10 ** (self.ripple / 10) == 1:
            raise ProcessingError(
                f"ripple must be > 1e-15 dB, which float64 tells from none, got {self.ripple:g}", at=("ripple",)
            )

    @property
    def edges(self) -> tuple[float, ...]:
        """The edges of the band, rad/s."""
        return self.frequency if isinstance(self.frequency, tuple) else (self.frequency,)

    def apply(self, record: Record) -> Record:
        """Return the record with the channels filtered."""
        done = {
            name: filtered(record.values(name, complete=True), record.rate, self)
            for name in record.chosen(self.channels)
        }
        return record.changed(done)


def filtered(values: Real, rate: float, design: ZeroPhaseFilter) -> Real:
    """Return samples filtered forward and backward.

    Parameters
    ----------
    values : ndarray, shape (samples,)
    rate : float
        Samples per second.
    design : ZeroPhaseFilter

    Raises
    ------
    ProcessingError
        If an edge is not below half the rate, or so far below it that float64 does not resolve the filter; if the recording is
        too short to be continued at its ends.
    """
    # the package costs a tenth of a second, which a service that filters nothing need not pay
    from scipy.signal import sosfiltfilt  # noqa: PLC0415

    if design.edges[-1] >= np.pi * rate:
        msg = f"{design.called} must be < {np.pi * rate:g} rad/s (half the sample rate), got {design.edges[-1]:g}"
        raise ProcessingError(msg, at=(design.called,))
    relative = [edge / (np.pi * rate) for edge in design.edges]
    reach = 3 * design.order * len(relative)
    if values.size <= reach:
        raise ProcessingError(f"the recording must be > {reach} samples for this filter, got {values.size}", at=())
    sections = _sections(design, relative)
    if sections is None:
        raise _unresolved(design, relative, rate)
    found = np.asarray(sosfiltfilt(sections, values, padlen=reach), dtype=np.float64)
    if np.abs(found).max() > _MOST_GAIN * np.abs(values).max():
        raise _unresolved(design, relative, rate)
    return found


def _sections(design: ZeroPhaseFilter, relative: list[float]) -> Real | None:
    """Return the sections of second order for edges in units of half the sample rate; None where float64 does not resolve them."""
    from scipy.signal import butter, cheby1  # noqa: PLC0415 - as above

    edges = relative if len(relative) == 2 else relative[0]
    band = _BANDS[design.band]
    try:
        with np.errstate(all="ignore"):
            if design.family == "butterworth":
                found = butter(design.order, edges, btype=band, output="sos")
            else:
                found = cheby1(design.order, design.ripple, edges, btype=band, output="sos")
    except (
        ValueError,
        ZeroDivisionError,
        OverflowError,
    ):  # edges that are 0, or one, once they are divided by the rate
        return None
    first, second = found[:, 4], found[:, 5]
    resolved = np.isfinite(found).all() and min((1 + first + second).min(), (1 - second).min()) >= _LEAST_DISTANCE
    return np.asarray(found, dtype=np.float64) if resolved and _holds_constant(design, found) else None


def _holds_constant(design: ZeroPhaseFilter, sections: Real) -> bool:
    """Tell whether the sections leave of a constant what the filter leaves: in steep ones over decades rounding grows from section to section."""
    from scipy.signal import sosfiltfilt  # noqa: PLC0415 - as above

    kept = 0.0
    if design.band in {"low_pass", "band_stop"}:
        dips = design.family == "chebyshev1" and design.order % 2 == 0
        kept = 10 ** (-design.ripple / 10) if dips else 1.0
    reach = 6 * len(sections)
    left = sosfiltfilt(sections, np.ones(2 * reach), padlen=reach)
    return bool(np.abs(left - kept).max() <= _ROUNDING)


def _unresolved(design: ZeroPhaseFilter, relative: list[float], rate: float) -> ProcessingError:
    shown = ", ".join(f"{edge:g}" for edge in design.edges)
    least = np.log(max(relative[0], 1e-300)), np.log(0.5)
    if len(relative) == 2:
        rule = "far enough from 0 and from each other that float64 resolves the filter"
    else:
        for _ in range(40):  # where it begins to, to a part in a million
            middle = sum(least) / 2
            least = (least[0], middle) if _sections(design, [float(np.exp(middle))]) is not None else (middle, least[1])
        rule = f">= {1.01 * np.exp(least[1]) * np.pi * rate:.3g} rad/s, below which float64 does not resolve the filter"
    return ProcessingError(
        f"{design.called} must be {rule} at {rate:g} samples/s (decimate first, or take a lower order), got {shown}",
        at=(design.called,),
    )
