"""Metrics of many sampled curves, by the definitions of `engine.metrics`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from engine.batch.nonlinear.curves import NEARLY, RESOLVED, STILL, Curves, Flags, Reading, Real
from engine.exact.time.tail_of_integral import has_ended
from engine.metrics import catalogue
from engine.model.metric_options import USUAL_BAND

NEGLIGIBLE: Final = 1e-9
"""A difference below this part of the signal is not a difference."""


def _way(curves: Curves) -> Reading:
    """Return the way from the beginning to the end, NaN where there is none to speak of, and whose end is not known here."""
    way = curves.final - curves.initial
    real = np.abs(way) > NEGLIGIBLE * curves.size
    return np.where(curves.ended & real, way, np.nan), ~curves.ended


def _rise_time(curves: Curves) -> Reading:
    way, doubt = _way(curves)
    sign = np.sign(np.nan_to_num(way))
    low, unsure_low = curves.first_passage(curves.initial + 0.1 * way, sign)
    high, unsure_high = curves.first_passage(curves.initial + 0.9 * way, sign)
    return high - low, doubt | unsure_low | unsure_high


def settled_within(band: float) -> Callable[[Curves], Reading]:
    """Return what reads the last entry into ± band of the way around the final value."""

    def read(curves: Curves) -> Reading:
        way, doubt = _way(curves)
        half = band * np.abs(way)
        time, unsure = curves.last_outside(np.where(np.isnan(half), 0.0, half))
        return np.where(np.isnan(way), np.nan, time - curves.start), doubt | unsure & ~np.isnan(way)

    return read


def _overshoot(curves: Curves) -> Reading:
    way, doubt = _way(curves)
    top, _, bottom, _ = curves.extremes
    beyond = np.where(way > 0, top - curves.final, bottom - curves.final) / way
    return _from_zero(beyond), doubt | (curves.bend > RESOLVED * np.abs(way))


def _undershoot(curves: Curves) -> Reading:
    way, doubt = _way(curves)
    top, _, bottom, _ = curves.extremes
    below = np.where(way > 0, curves.initial - bottom, curves.initial - top) / way
    return _from_zero(below), doubt


def _from_zero(ratio: Real) -> Real:
    return np.where(ratio <= NEGLIGIBLE, 0.0, ratio)


def _largest(curves: Curves) -> tuple[Real, Real, Flags]:
    top, top_at, bottom, bottom_at = curves.extremes
    high = top >= -bottom
    value, at = np.where(high, top, -bottom), np.where(high, top_at, bottom_at)
    if curves.duration is not None:  # nothing beyond it counts
        return value, at, curves.bend > RESOLVED * value
    value = np.where(curves.settled, np.maximum(value, np.abs(curves.final)), value)
    # how far a swing without end is followed, the exact path knows
    return value, at, ~curves.settled | curves.steady | (curves.bend > RESOLVED * value)


def _peak(curves: Curves) -> Reading:
    value, _, doubt = _largest(curves)
    return value, doubt


def _peak_time(curves: Curves) -> Reading:
    value, at, doubt = _largest(curves)
    barely = (curves.duration is None) & curves.settled & (value - np.abs(curves.final) <= NEARLY * value)
    _, b, turned, _ = curves.turning
    rivals = np.bincount(b[np.abs(turned) >= (1 - NEARLY) * value[b]], minlength=len(value)) > 1
    return at - curves.start, doubt | barely | rivals | curves.cornered


def _steady_state_error(curves: Curves) -> Reading:
    if curves.target is None:
        return np.full(len(curves.size), np.nan), np.ones(len(curves.size), dtype=bool)
    return np.where(curves.ended, curves.target - curves.final, np.nan), ~curves.ended


def _integral(of: Callable[[Real, Real], Real]) -> Callable[[Curves], Reading]:
    def read(curves: Curves) -> Reading:
        value = curves.integral(of)
        if curves.duration is not None:
            return value, np.zeros(len(value), dtype=bool)
        errors = curves.errors[:, 0]
        rest = np.abs(errors[-1]) > STILL * np.abs(errors).max(axis=0)
        ended = has_ended(curves.times, errors, curves.last, lambda e, t: np.abs(of(e, t)))
        return value, ~curves.still | rest | ~ended  # the exact path says whether what is left is an error or rounding

    return read


def read(metric: str, curves: Curves, band: float = USUAL_BAND, *, unsettled: bool = True) -> Reading:
    """Return a metric of `METRICS`.

    ``band`` is that of a settling time; ``unsettled`` says whether the values will do of who has not settled in the time asked for.
    """
    with np.errstate(all="ignore"):  # what has no value is NaN
        value, doubt = settled_within(band)(curves) if metric == "settling_time" else METRICS[metric](curves)
    if unsettled or metric not in SETTLED_ONLY:
        return value, doubt
    moving = curves.ended & ~curves.settled & ~curves.stuck
    return np.where(moving, np.nan, value), (doubt | ~curves.ended) & ~moving | curves.stuck


METRICS: Mapping[str, Callable[[Curves], Reading]] = MappingProxyType(
    {
        "rise_time": _rise_time, "settling_time": settled_within(0.02), "response_time": settled_within(0.05),
        "overshoot": _overshoot, "undershoot": _undershoot, "peak": _peak, "peak_time": _peak_time,
        "max_velocity": _peak, "max_acceleration": _peak, "control_effort": _peak,
        "steady_state_error": _steady_state_error,
        "iae": _integral(lambda e, _: np.abs(e)), "ise": _integral(lambda e, _: e * e),
        "itae": _integral(lambda e, t: t * np.abs(e)),
    }
)  # fmt: skip
SETTLED_ONLY: Final = frozenset(
    kind for kind, of in METRICS.items() if of is _peak or getattr(catalogue()[kind], "of_the_end", False)
)
"""Those that have no value where the output goes on moving and that will not do."""
TIMES: Final = frozenset({"rise_time", "settling_time", "response_time", "peak_time"})
RATIOS: Final = frozenset({"overshoot", "undershoot"})
INTEGRALS: Final = frozenset({"iae", "ise", "itae"})
