"""Fewer samples: one of several, after a low pass that lets nothing through that would be folded back.

    y_n = (F(-z) F(z) x)_{k+qn},   F Chebyshev I with its edge at 0.8 of the new half rate

The first sample kept is x_0, or that with which x_{N-1} is the last one.

References
----------
IEEE, "Programs for Digital Signal Processing", Wiley 1979, chapter 8 (decimation by an IIR filter).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from engine.model.errors import ProcessingError
from engine.recordings.processing.record import Real, Record
from engine.recordings.processing.zero_phase import MOST_ORDER, ZeroPhaseFilter, filtered

MOST_FACTOR = 100
"""Beyond it the filter's poles crowd at 1; two steps are better than one long before."""

_EDGE = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Decimate:
    """Keep one sample of ``factor``, of every channel.

    Parameters
    ----------
    factor : int
    order : int
        Of one pass of the Chebyshev filter, which runs forward and backward.
    ripple : float
        In the pass band of one pass, dB.
    keep : {"first", "last"}
        Which end of the recording is certainly kept.
    """

    factor: int
    order: int = 8
    ripple: float = 0.05
    keep: Literal["first", "last"] = "first"

    def __post_init__(self) -> None:
        if not 2 <= self.factor <= MOST_FACTOR:
            raise ProcessingError(f"factor must be 2 to {MOST_FACTOR}, got {self.factor}", at=("factor",))
        if not 1 <= self.order <= MOST_ORDER:
            raise ProcessingError(f"order must be 1 to {MOST_ORDER}, got {self.order}", at=("order",))
        if not 0 < self.ripple <= 10:
            raise ProcessingError(f"ripple must be > 0 and <= 10 dB, got {self.ripple:g}", at=("ripple",))

    def apply(self, record: Record) -> Record:
        """Return the record at a lower rate."""
        channels = {
            name: decimated(
                record.values(name, complete=True), self.factor, order=self.order, ripple=self.ripple, keep=self.keep
            )
            for name in record.channels
        }
        first = _first(record.samples, self.factor, self.keep)
        begin = record.begin + first / record.rate
        return replace(record, rate=record.rate / self.factor, channels=channels, begin=begin)


def decimated(
    values: Real, factor: int, *, order: int = 8, ripple: float = 0.05, keep: Literal["first", "last"] = "first"
) -> Real:
    """Return one sample of ``factor`` after the low pass that this needs.

    Parameters
    ----------
    values : ndarray, shape (samples,)
    factor, order, ripple, keep
        As of :class:`Decimate`.

    Returns
    -------
    ndarray, shape (ceil(samples / factor),)

    Raises
    ------
    ProcessingError
        If there are too few samples for the filter.
    """
    # at a rate of 1 the new half rate is π/factor rad/s
    low = ZeroPhaseFilter(
        band="low_pass", frequency=_EDGE * np.pi / factor, order=order, family="chebyshev1", ripple=ripple
    )
    return filtered(values, 1.0, low)[_first(values.size, factor, keep) :: factor].copy()


def _first(samples: int, factor: int, keep: Literal["first", "last"]) -> int:
    return 0 if keep == "first" else (samples - 1) % factor
