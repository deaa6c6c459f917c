"""Another sample rate, a rational multiple of the old one.

    y = (x with up - 1 zeros between samples) * h, one of ``down`` kept

h is a linear-phase low pass with its edge at half the lower one of both rates: a sinc of 20 of its periods under a Kaiser
window (β = 5, side lobes below -50 dB). The line through both ends is taken away first and put back, so that a
recording which does not begin and end at 0 does not ring there.

References
----------
R. E. Crochiere, L. R. Rabiner, "Multirate Digital Signal Processing", Prentice Hall 1983, section 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Real, Record
from engine.recordings.processing.uneven import METHODS, evened

MOST_FACTOR = 1000
"""Largest part of the ratio: 44100 samples/s from 48000 needs 147."""

_SAME = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Resample:
    """Bring every channel to another sample rate.

    Parameters
    ----------
    rate : float
        Samples per second.
    method : str, optional
        How samples at uneven instants are interpolated, "linear" (by default) or "cubic".
    longest : float, optional
        Longest distance of two samples at uneven instants that is bridged, s; ten times the median one by default.
    """

    rate: float
    method: str | None = None
    longest: float | None = None

    def __post_init__(self) -> None:
        if self.method is not None and self.method not in METHODS:
            raise ProcessingError(f"method must be one of {', '.join(METHODS)}, got {self.method!r}", at=("method",))
        if self.longest is not None and not self.longest > 0:
            raise ProcessingError(f"longest must be > 0 s, got {self.longest:g}", at=("longest",))
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise ProcessingError(f"rate must be > 0 samples/s, got {self.rate:g}", at=("rate",))

    def apply(self, record: Record) -> Record:
        """Return the record at the new rate.

        Raises
        ------
        ProcessingError
            For a rate that is no simple ratio, missing samples, an interpolation where there is nothing to interpolate.
        """
        for name, value in (("method", self.method), ("longest", self.longest)):
            if value is not None:
                msg = (
                    f"{name} must be left out for even samples, which are filtered and not interpolated, got {value!r}"
                )
                raise ProcessingError(msg, at=(name,))
        ratio = self._ratio(record.rate)
        channels = {name: resampled(record.values(name, complete=True), ratio) for name in record.channels}
        return replace(record, rate=record.rate * float(ratio), channels=channels)

    def evened(self, time: Real, channels: Mapping[str, Real], units: Mapping[str, str]) -> Record:
        """Return an even record of samples at uneven instants ``time`` (n,), s, which rise.

        Raises
        ------
        ProcessingError
            As `engine.recordings.processing.uneven.evened`.
        """
        method = self.method or "linear"
        found = {
            name: evened(time, values, rate=self.rate, method=method, longest=self.longest)
            for name, values in channels.items()
        }
        return Record(rate=self.rate, channels=found, units=units, begin=float(time[0]))

    def _ratio(self, old: float) -> Fraction:
        wanted = self.rate / old
        ratio = Fraction(wanted).limit_denominator(MOST_FACTOR) if np.isfinite(wanted) else Fraction(0)
        if not 0 < ratio.numerator <= MOST_FACTOR or abs(float(ratio) / wanted - 1) > _SAME:
            msg = (
                f"rate must be a/b of the recording's {old:.10g} samples/s with whole a and b <= {MOST_FACTOR}, "
                f"got {self.rate:.10g}"
            )
            raise ProcessingError(msg, at=("rate",))
        return ratio


def resampled(values: Real, ratio: Fraction) -> Real:
    """Return samples at ``ratio`` times their rate; the first sample stays where it is.

    Parameters
    ----------
    values : ndarray, shape (samples,)
    ratio : fractions.Fraction

    Returns
    -------
    ndarray, shape (ceil(samples * ratio),)
    """
    from scipy.signal import resample_poly  # noqa: PLC0415 - a tenth of a second

    found = resample_poly(values, ratio.numerator, ratio.denominator, padtype="line")
    return np.asarray(found, dtype=np.float64)
