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

    def __post_init__(self) -> None:
        edges = self.edges
        wanted = 2 if self.band.startswith("band") else 1
        if len(edges) != wanted:
            word = "two edges" if wanted == 2 else "one number"
            raise ProcessingError(f"frequency must be {word} for a {self.band}, got {len(edges)}", at=("frequency",))
        if any(not edge > 0 for edge in edges) or (wanted == 2 and not edges[0] < edges[1]):
            shown = ", ".join(f"{edge:g}" for edge in edges)
            raise ProcessingError(f"frequency must be > 0 rad/s and increasing, got {shown}", at=("frequency",))
        if not 1 <= self.order <= MOST_ORDER:
            raise ProcessingError(f"order must be 1 to {MOST_ORDER}, got {self.order}", at=("order",))
        if not 0 < self.ripple <= 10:
            raise ProcessingError(f"ripple must be > 0 and <= 10 dB, got {self.ripple:g}", at=("ripple",))

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
        If an edge is not below half the rate, or the recording is too short to be continued at its ends.
    """
    # the package costs a tenth of a second, which a service that filters nothing need not pay
    from scipy.signal import butter, cheby1, sosfiltfilt  # noqa: PLC0415

    if design.edges[-1] >= np.pi * rate:
        msg = f"frequency must be < {np.pi * rate:g} rad/s (half the sample rate), got {design.edges[-1]:g}"
        raise ProcessingError(msg, at=("frequency",))
    relative = [edge / (np.pi * rate) for edge in design.edges]
    edges = relative if len(relative) == 2 else relative[0]
    poles = design.order * len(relative)
    reach = 3 * poles
    if values.size <= reach:
        raise ProcessingError(f"the recording must be > {reach} samples for this filter, got {values.size}", at=())
    if design.family == "butterworth":
        sections = butter(design.order, edges, btype=_BANDS[design.band], output="sos")
    else:
        sections = cheby1(design.order, design.ripple, edges, btype=_BANDS[design.band], output="sos")
    return np.asarray(sosfiltfilt(sections, values, padlen=reach), dtype=np.float64)
