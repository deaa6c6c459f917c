"""From what a kernel reads off responses and curves to metrics and their slopes: definitions are those of `engine.metrics`.

A metric that does not exist is NaN, one that is never reached infinite. Slopes are vectors, one direction to a lane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from engine.batch.kernels import events as r
from engine.batch.kernels import scan_state as s
from engine.batch.kernels import spectrum_program as f
from engine.batch.kernels.compiled import compiled
from engine.batch.kernels.vector import load, store

Real = npt.NDArray[np.float64]
Whole = npt.NDArray[np.int32]
Flags = npt.NDArray[np.bool_]

NEGLIGIBLE: Final = 1e-9
"""A difference below this part of the signal is not a difference."""
BARELY: Final = 1e-8
"""A peak that exceeds the final value by less than this part has no instant that the curve defines."""
_UNDECIDED: Final = 0.1
"""Nearer to that than this part of it, the exact path decides."""
_ABSENT: Final = 1e299

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
    {"bandwidth": f.BANDWIDTH, "compliance_peak": f.PEAK, "control_sensitivity_peak": f.PEAK, "resonance_peak": f.PEAK}
)

(
    _RISE_TIME, _SETTLING_TIME, _RESPONSE_TIME, _OVERSHOOT, _UNDERSHOOT, _LARGEST, _PEAK_TIME, _ERROR,
    _GAIN_MARGIN, _PHASE_MARGIN, _DELAY_MARGIN, _SENSITIVITY_PEAK, _COMPLEMENTARY_PEAK, _BANDWIDTH, _HIGHEST,
) = range(15)  # fmt: skip
_CODES: Final[Mapping[str, int]] = MappingProxyType(
    {
        "rise_time": _RISE_TIME, "settling_time": _SETTLING_TIME, "response_time": _RESPONSE_TIME,
        "overshoot": _OVERSHOOT, "undershoot": _UNDERSHOOT, "peak": _LARGEST, "peak_time": _PEAK_TIME,
        "max_velocity": _LARGEST, "max_acceleration": _LARGEST, "control_effort": _LARGEST,
        "steady_state_error": _ERROR, "gain_margin": _GAIN_MARGIN, "phase_margin": _PHASE_MARGIN,
        "delay_margin": _DELAY_MARGIN, "sensitivity_peak": _SENSITIVITY_PEAK,
        "complementary_peak": _COMPLEMENTARY_PEAK, "bandwidth": _BANDWIDTH, "compliance_peak": _HIGHEST,
        "control_sensitivity_peak": _HIGHEST, "resonance_peak": _HIGHEST,
    }
)  # fmt: skip

COLUMN, CODE, SOURCE, NEEDS = range(4)
"""A row of a reading list: the column of the results, the metric, the response or curve it is read off, and what it needs."""


def reading_list(columns: Mapping[int, tuple[int, str]]) -> Whole:
    """Return what `read` is told, (columns, 4), of column -> (response or curve, metric)."""
    needs = {**TIME_READINGS, **LOOP_READINGS, **PATH_READINGS}
    rows = [(column, _CODES[metric], source, needs[metric]) for column, (source, metric) in columns.items()]
    return np.array(rows, dtype=np.int32).reshape(-1, 4)


@compiled
def read(
    wanted: Whole, references: Real, readings: Real, growth: Real, valid: Flags, rows: Any, values: Real, doubtful: Flags
) -> None:  # fmt: skip
    """Enter metrics of candidates into the results.

    Parameters
    ----------
    wanted : ndarray, shape (columns, 4)
        Of one reading list.
    references : ndarray, shape (sources,)
        The command's final value, of responses.
    readings : ndarray, shape (B, sources, READINGS)
    growth, valid : ndarray, shape (all,)
    rows : ndarray, shape (B,)
        Where among all candidates these are.
    values, doubtful : ndarray, shape (all, R)
        Written.
    """
    for b in range(rows.shape[0]):
        row = rows[b]
        unsure = valid[row] and math.isnan(growth[row])
        for k in range(wanted.shape[0]):
            column, code, source = wanted[k, COLUMN], wanted[k, CODE], wanted[k, SOURCE]
            reading = readings[b, source]
            of_time = code <= _ERROR
            mark = reading[r.DOUBT if of_time else f.DOUBT]
            doubt = (not math.isnan(mark)) and (int(mark) & wanted[k, NEEDS]) != 0
            if of_time:
                value = _time_value(code, reading, references[source])
                doubt = doubt or (code == _PEAK_TIME and _undecided(reading))
            else:
                value = _frequency_value(code, reading)
            values[row, column], doubtful[row, column] = value, doubt or unsure


@compiled
def _time_value(code: int, reading: Real, reference: float) -> Any:
    final, size = reading[r.FINAL], reading[r.SIZE]
    if code == _ERROR or math.isnan(final):
        return reference - final
    if code == _LARGEST:
        top, bottom = _far(reading[r.TOP_VALUE]), _far(reading[r.BOTTOM_VALUE])
        largest = max(top, bottom)
        return abs(final) if _approached(largest, final) else largest
    if code == _PEAK_TIME:
        top, bottom = _far(reading[r.TOP_VALUE]), _far(reading[r.BOTTOM_VALUE])
        largest = max(top, bottom)
        if largest - abs(final) <= BARELY * largest:
            return math.nan
        return reading[r.TOP_TIME] if top >= bottom else reading[r.BOTTOM_TIME]
    if not (abs(final) > NEGLIGIBLE * size) or abs(final) == math.inf:
        return math.nan
    if code == _RISE_TIME:
        return reading[r.T_90] - reading[r.T_10]
    if code == _SETTLING_TIME:
        return reading[r.T_2]
    if code == _RESPONSE_TIME:
        return reading[r.T_5]
    ratio = (reading[r.TOP_VALUE] - final) / final if code == _OVERSHOOT else -reading[r.BOTTOM_VALUE] / final
    return 0.0 if ratio <= NEGLIGIBLE else ratio


@compiled
def _far(extreme: float) -> float:
    """Return how far a response gets in one direction, as an absolute value; -1 where it does not go there."""
    return -1.0 if abs(extreme) > _ABSENT else abs(extreme)


@compiled
def _approached(largest: float, final: float) -> bool:
    """Whether the final value is the largest, which is then only approached."""
    return abs(final) >= largest * (1 - 1e-13)


@compiled
def _undecided(reading: Real) -> Any:
    """Whether a peak stands out so little or so much that its instant cannot be told to exist here."""
    largest = max(_far(reading[r.TOP_VALUE]), _far(reading[r.BOTTOM_VALUE]))
    return abs(largest - abs(reading[r.FINAL]) - BARELY * largest) < _UNDECIDED * BARELY * largest


@compiled
def _frequency_value(code: int, reading: Real) -> Any:
    if code == _GAIN_MARGIN:
        return reading[f.GAIN_MARGIN]
    if code == _PHASE_MARGIN:
        return reading[f.PHASE_MARGIN]
    if code == _DELAY_MARGIN:
        return reading[f.DELAY_MARGIN]
    if code == _SENSITIVITY_PEAK:
        return reading[f.MS]
    if code == _COMPLEMENTARY_PEAK:
        return reading[f.MT]
    if code == _BANDWIDTH:
        flat = abs(reading[f.AT_REST]) <= NEGLIGIBLE * reading[f.HIGHEST]
        return math.nan if flat else reading[f.FIRST_FALL]
    return reading[f.HIGHEST]


@compiled
def time_slope(code: int, reading: Real, slopes: Real) -> Any:
    """Return the slopes of a metric, from those of the readings (READINGS, LANES)."""
    final, d_final = reading[r.FINAL], load(slopes, r.FINAL)
    if code == _RISE_TIME:
        return load(slopes, r.T_90) - load(slopes, r.T_10)
    if code == _SETTLING_TIME:
        return load(slopes, r.T_2)
    if code == _RESPONSE_TIME:
        return load(slopes, r.T_5)
    if code == _ERROR:
        return -d_final
    top, bottom = reading[r.TOP_VALUE], reading[r.BOTTOM_VALUE]
    if code in (_OVERSHOOT, _UNDERSHOOT):
        furthest = top if code == _OVERSHOOT else bottom
        ratio = (top - final) / final if code == _OVERSHOOT else -bottom / final
        moved = load(slopes, r.TOP_VALUE if code == _OVERSHOOT else r.BOTTOM_VALUE)
        sign = 1.0 if code == _OVERSHOOT else -1.0
        some = 1.0 if ratio > NEGLIGIBLE else 0.0
        return some * sign * (moved - furthest / final * d_final) / final
    upwards = _far(top) >= _far(bottom)
    if code == _PEAK_TIME:
        return load(slopes, r.TOP_TIME if upwards else r.BOTTOM_TIME)
    if _approached(max(_far(top), _far(bottom)), final):
        return (1.0 if final >= 0.0 else -1.0) * d_final
    extreme = top if upwards else bottom
    return (1.0 if extreme >= 0.0 else -1.0) * load(slopes, r.TOP_VALUE if upwards else r.BOTTOM_VALUE)


@compiled
def frequency_slope(code: int, slopes: Real) -> Any:
    """Return the slopes of a metric, from those of the readings (READINGS, LANES)."""
    if code == _GAIN_MARGIN:
        return load(slopes, f.GAIN_MARGIN)
    if code == _PHASE_MARGIN:
        return load(slopes, f.PHASE_MARGIN)
    if code == _DELAY_MARGIN:
        return load(slopes, f.DELAY_MARGIN)
    if code == _SENSITIVITY_PEAK:
        return load(slopes, f.MS)
    if code == _COMPLEMENTARY_PEAK:
        return load(slopes, f.MT)
    if code == _BANDWIDTH:
        return load(slopes, f.FIRST_FALL)
    return load(slopes, f.HIGHEST)


@compiled
def enter_slopes(wanted: Whole, readings: Real, slopes: Real, results: Real) -> None:
    """Enter the slopes (R, LANES) of the metrics of one list, from readings (sources, READINGS) and their slopes."""
    for k in range(wanted.shape[0]):
        code, source = wanted[k, CODE], wanted[k, SOURCE]
        if code <= _ERROR:
            found = time_slope(code, readings[source], slopes[source])
        else:
            found = frequency_slope(code, slopes[source])
        store(results, found, wanted[k, COLUMN])
