"""Which sample rates a recording may have: from one sample in eleven days to what no converter reaches."""

from __future__ import annotations

LEAST_RATE, MOST_RATE = 1e-6, 1e12
"""Samples per second. Beyond them the instants of samples, n / rate, would soon be no numbers."""


def refusal(rate: float) -> str:
    """Return why a rate cannot be that of a recording, "" where it can.

    >>> refusal(1e-300)
    'sample_rate must be 1e-06 ... 1e+12 samples/s, got 1e-300'
    """
    if LEAST_RATE <= rate <= MOST_RATE:
        return ""
    return f"sample_rate must be {LEAST_RATE:g} ... {MOST_RATE:g} samples/s, got {rate:g}"
