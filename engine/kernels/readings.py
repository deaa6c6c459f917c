"""From what a kernel reads off responses and curves to metrics by name: definitions are those of `engine.metrics`."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from engine.kernels import events as r
from engine.kernels import sampling as s
from engine.kernels import spectrum as f

Real = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

NEGLIGIBLE = 1e-9
"""A difference below this part of the signal is not a difference."""
BARELY = 1e-8
"""A peak that exceeds the final value by less than this part has no instant that the curve defines."""
_UNDECIDED = 0.1
"""Nearer to that than this part of it, the exact path decides."""

TIME_READINGS: Mapping[str, int] = MappingProxyType(
    {
        "rise_time": s.RISE, "settling_time": s.SETTLE_2, "response_time": s.SETTLE_5, "overshoot": s.HIGHEST,
        "undershoot": s.LOWEST, "peak": s.HIGHEST | s.LOWEST, "peak_time": s.HIGHEST | s.LOWEST | s.WHEN,
        "max_velocity": s.HIGHEST | s.LOWEST, "max_acceleration": s.HIGHEST | s.LOWEST, "control_effort": s.HIGHEST | s.LOWEST,
        "steady_state_error": 0,
    }
)  # fmt: skip
"""What each metric needs of a response."""
LOOP_READINGS: Mapping[str, int] = MappingProxyType(
    {
        "gain_margin": f.GAIN, "phase_margin": f.PHASE, "delay_margin": f.DELAY, "sensitivity_peak": f.SENSITIVITY,
        "complementary_peak": f.COMPLEMENTARY,
    }
)  # fmt: skip
PATH_READINGS: Mapping[str, int] = MappingProxyType(
    {"bandwidth": f.BANDWIDTH, "compliance_peak": f.PEAK, "control_sensitivity_peak": f.PEAK}
)


def _has(sums: Real, bits: int) -> Flags:
    """Whether any of the bits is part of each sum; what was never written has none."""
    return np.asarray((np.where(np.isnan(sums), 0.0, sums).astype(int) & bits) != 0)


def time_value(metric: str, reading: Real, reference: float) -> tuple[Real, Flags]:
    """Return a metric (B,) and who is doubtful, from readings (B, READINGS); NaN where the metric does not exist."""
    final, size = reading[:, r.FINAL], reading[:, r.SIZE]
    needs = TIME_READINGS[metric]
    doubt = _has(reading[:, r.DOUBT], needs)
    relative = np.abs(final) > NEGLIGIBLE * size
    match metric:
        case "rise_time":
            value = reading[:, r.T_90] - reading[:, r.T_10]
        case "settling_time":
            value = reading[:, r.T_2]
        case "response_time":
            value = reading[:, r.T_5]
        case "overshoot" | "undershoot":
            over = metric == "overshoot"
            furthest = reading[:, r.TOP_VALUE if over else r.BOTTOM_VALUE]
            value = (furthest - final) / final if over else -furthest / final
            value = np.where(value <= NEGLIGIBLE, 0.0, value)
        case "steady_state_error":
            return reference - final, doubt
        case "peak_time":
            value, undecided = _peak_time(reading)
            return value, doubt | undecided
        case _:
            return _magnitude(reading), doubt
    return np.where(relative & np.isfinite(final), value, np.nan), doubt


def _largest(reading: Real) -> tuple[Real, Real, Real]:
    """Return how far the response gets upwards, downwards and in the end, as absolute values; -1 where it does not."""
    top, bottom = np.abs(reading[:, r.TOP_VALUE]), np.abs(reading[:, r.BOTTOM_VALUE])
    top = np.where(top > 1e299, -1.0, top)
    bottom = np.where(bottom > 1e299, -1.0, bottom)
    return top, bottom, np.abs(reading[:, r.FINAL])


def _magnitude(reading: Real) -> Real:
    """Return the largest absolute value; the final value where that is only approached."""
    top, bottom, limit = _largest(reading)
    largest = np.maximum(top, bottom)
    return np.where(limit >= largest * (1 - 1e-13), limit, largest)


def _peak_time(reading: Real) -> tuple[Real, Flags]:
    """Return the instant of the largest absolute value, NaN where there is none, and who cannot be decided here."""
    top, bottom, limit = _largest(reading)
    largest = np.maximum(top, bottom)
    excess = largest - limit
    time = np.where(top >= bottom, reading[:, r.TOP_TIME], reading[:, r.BOTTOM_TIME])
    return np.where(excess <= BARELY * largest, np.nan, time), np.abs(
        excess - BARELY * largest
    ) < _UNDECIDED * BARELY * largest


def frequency_value(metric: str, reading: Real) -> tuple[Real, Flags]:
    """Return a metric (B,) and who is doubtful, from readings (B, READINGS) of a curve; infinite where nothing crosses."""
    needs = LOOP_READINGS.get(metric) or PATH_READINGS[metric]
    doubt = _has(reading[:, f.DOUBT], needs)
    match metric:
        case "gain_margin":
            return reading[:, f.GAIN_MARGIN], doubt
        case "phase_margin":
            return reading[:, f.PHASE_MARGIN], doubt
        case "delay_margin":
            return reading[:, f.DELAY_MARGIN], doubt
        case "sensitivity_peak":
            return reading[:, f.MS], doubt
        case "complementary_peak":
            return reading[:, f.MT], doubt
        case "bandwidth":
            flat = np.abs(reading[:, f.AT_REST]) <= NEGLIGIBLE * reading[:, f.HIGHEST]
            return np.where(flat, np.nan, reading[:, f.FIRST_FALL]), doubt
        case _:
            return reading[:, f.HIGHEST], doubt
