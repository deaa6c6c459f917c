"""Whether the repetitions of a drive go on where the one before has ended: only then is their mean that of a steady state.

turn = w |L - n T|,   L the length of a repetition, T the period of the drive, n whole, w the fastest of its sines
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_TURN = 0.01
"""rad: a sine then jumps by 1 % of its amplitude."""


def joints(document: Mapping[str, Any], facts: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Return the warning of a measurement whose repetitions hold no whole periods of its drive, at the rate that there was.

    Parameters
    ----------
    document : mapping
        Of an acquisition as it is stored.
    facts : mapping, optional
        What the agent said of the latest attempt.
    """
    told, periodic = document["told"], document.get("periodic")
    if told["averages"] < 2 or not periodic:
        return []
    facts = facts or {}
    samples, rate = (facts.get("repeats") or {}).get("length"), facts.get("actual_rate")
    if not (isinstance(samples, int) and isinstance(rate, int | float) and rate > 0):  # facts are an agent's own
        rate, samples = told["sample_rate"], round(told["duration"] * told["sample_rate"])
    length, period = samples / rate, periodic["period"]
    off = abs(length - max(round(length / period), 1) * period)
    if periodic["fastest"] * off <= _TURN:
        return []
    had = f"{length:.9g} s are {length / period:.6g} of {period:.6g} s, at {rate:.10g} samples/s"
    remedy = "choose a duration, and a sample_rate that the hardware has, so that whole periods are whole samples"
    detail = f"repetitions must hold whole periods of the drive, {had}: it jumps where they join, and their mean is that of no steady state; {remedy}"
    return [{"pointer": "/duration", "level": "warning", "detail": detail}]
