"""Is something at its limit?   Signals that rest at their largest value, and a speed that is never exceeded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.recordings.validation.comparison import Comparison, Signal, rate
from engine.recordings.validation.remedy import Remedy, worthwhile

_FEWEST = 0.005
"""Share of the samples at an end from which on a signal counts as clipped."""
_FLAT = 1e-9
_BAND = 0.05
_EXCEEDS = 1.15


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limit:
    """A signal at an end of its range.

    Attributes
    ----------
    level : float
        The end, unit of the signal.
    at : ndarray of bool, shape (samples,)
        Where it is there.
    """

    level: float
    at: np.ndarray[tuple[int], np.dtype[np.bool_]]


def clipped(signal: Signal) -> Limit | None:
    """Return the end of its range at which a signal stays for three samples or longer, None where it does not.

    A peak is reached and left; a converter, a valve or a commanded current at its limit repeats one value.

    Parameters
    ----------
    signal : ndarray, shape (samples,)
    """
    span = float(np.ptp(signal))
    if span <= 1e-14 * float(np.abs(signal).max(initial=0.0)):
        return None
    found = None
    for level in (float(signal.max()), float(signal.min())):
        at = np.abs(signal - level) <= _FLAT * span
        held = at[2:] & at[1:-1] & at[:-2] if at.size > 2 else at[:0]
        resting = np.zeros(at.size, dtype=bool)
        resting[:-2] |= held
        resting[1:-1] |= held
        resting[2:] |= held
        if resting.mean() >= _FEWEST and (found is None or resting.sum() > found.at.sum()):
            found = Limit(level=level, at=resting)
    return found


def saturation(comparison: Comparison) -> Remedy | None:
    """Return the limit at which most of the error arises; None where there is none."""
    candidates: list[tuple[str, str, Limit]] = []
    own = clipped(comparison.measured)
    # a model that rests there too knows the limit
    if own is not None and not _rests(comparison.simulated, own):
        candidates.append(
            (comparison.name, "a sensor or converter at the end of its range, or a stop that the model lacks", own)
        )
    speed = _speed_limit(comparison)
    if speed is not None:
        candidates.append(
            (f"the speed of {comparison.name}", "a valve, supply or amplifier at its limit that the model lacks", speed)
        )
    best: Remedy | None = None
    for name, cause, limit in candidates:
        left = comparison.relative_error(np.where(limit.at, 0.0, comparison.residual))
        if left is None or not worthwhile(left, comparison.present_error):
            continue
        if best is None or left < best.relative_error_percent:
            share = 100 * float(limit.at.mean())
            best = Remedy(
                kind="saturation",
                relative_error_percent=left,
                values={"level": limit.level, "share_percent": share},
                sentence=f"{name} rests at {limit.level:.4g} during {share:.3g} % of the window: {cause}.",
            )
    return best


def _rests(simulated: Signal, limit: Limit) -> bool:
    there = simulated[limit.at]
    return bool(np.ptp(there) <= 1e-3 * np.ptp(simulated)) if np.ptp(simulated) > 0 else True


def _speed_limit(comparison: Comparison) -> Limit | None:
    """Return where the measured speed stays at its largest value while the model's goes beyond."""
    measured = comparison.velocity
    size = np.abs(measured)
    top = float(np.quantile(size, 0.995))
    fastest = float(np.quantile(np.abs(rate(comparison.simulated, comparison.sample_time)), 0.995))
    if top <= 0.0 or fastest < _EXCEEDS * top:
        return None
    at = size >= (1 - _BAND) * top
    # a sine is within 5 % of its largest speed for a fifth of the time: a limit holds for longer
    if at.mean() < 0.25:
        return None
    return Limit(level=top, at=at)
