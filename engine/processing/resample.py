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

from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from engine.errors import ProcessingError
from engine.processing.record import Real, Record

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
    """

    rate: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise ProcessingError(f"rate must be > 0 samples/s, got {self.rate:g}", at=("rate",))

    def apply(self, record: Record) -> Record:
        """Return the record at the new rate."""
        ratio = self._ratio(record.rate)
        channels = {name: resampled(record.values(name, complete=True), ratio) for name in record.channels}
        return replace(record, rate=record.rate * float(ratio), channels=channels)

    def _ratio(self, old: float) -> Fraction:
        wanted = self.rate / old
        ratio = Fraction(wanted).limit_denominator(MOST_FACTOR)
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
