"""The inner velocity loop in batched numpy, written by hand for this loop: what an expert would do without this engine.

Step responses on a grid of 1000 samples by one matrix exponential per candidate, y_k = C E^k x_0 with E = exp(M h), where M holds
the dynamics and the constant input; frequency responses on 200 points as products of block responses. Crossings are
interpolated linearly on the grids, which is what limits the accuracy.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench.inner_velocity_loop import DURATION, FREQUENCIES, SAMPLES

Real = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]

CHUNK: Final = 128  # candidates at once: their matrices stay in the cache
STEP: Final = DURATION / (SAMPLES - 1)
BLOCK: Final = 32  # SAMPLES <= BLOCK**2
VALVE_FREQUENCY: Final = 300.0
VALVE_DAMPING: Final = 0.7
PLANT_FREQUENCY: Final = 40.0
PLANT_DAMPING: Final = 0.2
SENSOR: Final = 0.002
STATES: Final = 8
DROP: Final = 10 ** (-3 / 20)

_S = 1j * FREQUENCIES
_LOG = np.log(FREQUENCIES)
_VALVE = VALVE_FREQUENCY**2 / (_S**2 + 2 * VALVE_DAMPING * VALVE_FREQUENCY * _S + VALVE_FREQUENCY**2)
_VELOCITY = _VALVE * PLANT_FREQUENCY**2 / (_S**2 + 2 * PLANT_DAMPING * PLANT_FREQUENCY * _S + PLANT_FREQUENCY**2)
_SENSOR = 1 / (1 + SENSOR * _S)


def evaluate(candidates: Mapping[str, Real]) -> dict[str, Real]:
    """Return the ten results of every candidate; NaN where a metric does not exist."""
    (count,) = {len(values) for values in candidates.values()}
    parts = [
        _chunk({name: values[start : start + CHUNK] for name, values in candidates.items()})
        for start in range(0, count, CHUNK)
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _chunk(values: Mapping[str, Real]) -> dict[str, Real]:
    with np.errstate(all="ignore"):  # what overflows is unstable and has no metrics
        a, b, outputs = closed_loop(values)
        position, acceleration, stable = step_response(a, b, outputs)
        rest = -np.linalg.solve(a, b[:, :, None])[:, :, 0]
        final = np.einsum("bi,bi->b", outputs[:, 0], rest)
        loop, path = frequency_responses(values)
        found = {
            **time_metrics(position, final),
            "max_acceleration": np.abs(acceleration).max(axis=1),
            "steady_state_error": 1 - final,
            **loop_metrics(loop),
            "bandwidth": bandwidth(path),
        }
    return {**{name: np.where(stable, value, np.nan) for name, value in found.items()}, "stable": stable.astype(float)}


def closed_loop(values: Mapping[str, Real]) -> tuple[Real, Real, Real]:
    """Return A (B, 8, 8), b (B, 8) and C (B, 2, 8) of the closed loop; the outputs are position and acceleration.

    The states are the two lags of the controller, the valve's flow and its rate over 300 rad/s, z, v/w, a/w² and the sensor.
    """
    kp, td1, td2, tf, kv = (values[name] for name in ("kp", "td1", "td2", "tf", "kv"))
    w, valve = PLANT_FREQUENCY, VALVE_FREQUENCY
    rate = 1 / tf
    first, second = td1 * rate, td2 * rate**2
    a = np.zeros((len(kp), STATES, STATES))
    b = np.zeros((len(kp), STATES))
    # (1 + td1 s + td2 s²)/(1 + tf s)² = second + (first - 2 second)/(1 + tf s) + (1 - first + second)/(1 + tf s)²
    a[:, 0, 0], a[:, 0, 7], b[:, 0] = -rate, -rate, rate
    a[:, 1, 0], a[:, 1, 1] = rate, -rate
    a[:, 2, 3], a[:, 3, 2], a[:, 3, 3] = valve, -valve, -2 * VALVE_DAMPING * valve
    a[:, 3, 0], a[:, 3, 1] = valve * kp * (first - 2 * second), valve * kp * (1 - first + second)
    a[:, 3, 7], b[:, 3] = -valve * kp * second, valve * kp * second
    a[:, 3, 5] = -valve * kv * w
    a[:, 4, 5], a[:, 5, 6], a[:, 6, 5], a[:, 6, 6] = w, w, -w, -2 * PLANT_DAMPING * w
    a[:, 6, 2] = 1.0
    a[:, 7, 4], a[:, 7, 7] = 1 / SENSOR, -1 / SENSOR
    outputs = np.zeros((len(kp), 2, STATES))
    outputs[:, 0, 4], outputs[:, 1, 6] = 1.0, w * w
    return a, b, outputs


def exponential(m: Real) -> Real:
    """Return exp(m), (B, n, n): Taylor polynomial of degree 12 after Paterson and Stockmeyer, with scaling and squaring."""
    squarings = max(0, int(np.ceil(np.log2(np.abs(m).sum(axis=2).max() / 0.5))))
    x = m * 2.0**-squarings
    x2 = x @ x
    x3, x4 = x2 @ x, x2 @ x2
    eye = np.eye(m.shape[1])
    top = eye / 40320 + x / 362880 + x2 / 3628800 + x3 / 39916800 + x4 / 479001600
    middle = eye / 24 + x / 120 + x2 / 720 + x3 / 5040 + x4 @ top
    result = eye + x + x2 / 2 + x3 / 6 + x4 @ middle
    for _ in range(squarings):
        result = result @ result
    return result


def step_response(a: Real, b: Real, outputs: Real) -> tuple[Real, Real, npt.NDArray[np.bool_]]:
    """Return position and acceleration (B, samples) after a unit step from rest, and whether the loop is stable (B,)."""
    count, n = b.shape
    augmented = np.zeros((count, n + 1, n + 1))
    size = np.abs(b).max()  # the input must not cost squarings
    augmented[:, :n, :n], augmented[:, :n, n] = a * STEP, b * (STEP / size)
    power = exponential(augmented)
    rows = np.concatenate([outputs, np.zeros((count, 2, 1))], axis=2)
    columns = np.zeros((count, n + 1, 1))
    columns[:, n] = size
    for _ in range(int(np.log2(BLOCK))):  # C E^j for j < BLOCK
        rows = np.concatenate([rows, rows @ power], axis=1)
        power = power @ power
    for _ in range(int(np.log2(BLOCK))):  # E^(BLOCK k) x_0 for k < BLOCK
        columns = np.concatenate([columns, power @ columns], axis=2)
        power = power @ power
    curves = (rows @ columns).reshape(count, BLOCK, 2, BLOCK).transpose(0, 2, 3, 1).reshape(count, 2, BLOCK**2)
    motion = power[:, :n, :n]
    for _ in range(12):  # the state after about an hour of free motion
        motion = np.clip(motion @ motion, -1e100, 1e100)
    return curves[:, 0, :SAMPLES], curves[:, 1, :SAMPLES], np.abs(motion).sum(axis=2).max(axis=1) < 1


def time_metrics(position: Real, final: Real) -> dict[str, Real]:
    """Return rise time, settling time (2 %) and overshoot."""
    share = position / final[:, None]
    last = SAMPLES - 1 - np.argmax((np.abs(share - 1) > 0.02)[:, ::-1], axis=1)
    error = np.abs(share - 1) - 0.02
    settled = last < SAMPLES - 1
    begin = np.minimum(last, SAMPLES - 2)
    return {
        "rise_time": _first_crossing(share, 0.9) - _first_crossing(share, 0.1),
        "settling_time": np.where(settled, STEP * (begin + _zero(error, begin)), np.nan),
        "overshoot": np.maximum(0.0, share.max(axis=1) - 1),
    }


def frequency_responses(values: Mapping[str, Real]) -> tuple[Complex, Complex]:
    """Return the loop cut at the sensor and the path from reference to position, (B, frequencies)."""
    kp, td1, td2, tf, kv = (values[name][:, None] for name in ("kp", "td1", "td2", "tf", "kv"))
    controller = kp * (1 + _S * (td1 + td2 * _S)) / (1 + tf * _S) ** 2
    forward = controller * (_VELOCITY / (1 + kv * _VELOCITY)) / _S
    loop = forward * _SENSOR
    return loop, forward / (1 + loop)


def loop_metrics(loop: Complex) -> dict[str, Real]:
    """Return the margins nearest to instability and the largest sensitivity."""
    size = np.log(np.abs(loop))
    gain, phase = (np.full(len(loop), np.inf) for _ in range(2))
    who, at = np.nonzero((loop.imag[:, :-1] > 0) != (loop.imag[:, 1:] > 0))
    behind = loop.real[who, at] < 0
    who, at = who[behind], at[behind]
    share = _zero(loop.imag, at, who)
    _nearest(gain, who, -(size[who, at] + share * (size[who, at + 1] - size[who, at])))
    who, at = np.nonzero((size[:, :-1] > 0) != (size[:, 1:] > 0))
    share = _zero(size, at, who)
    angle = np.angle(-loop[who, at])
    _nearest(phase, who, _wrapped(angle + share * _wrapped(np.angle(-loop[who, at + 1]) - angle)))
    return {
        "gain_margin": np.exp(gain),
        "phase_margin": phase,
        "sensitivity_peak": 1 / np.abs(1 + loop).min(axis=1),
    }


def bandwidth(path: Complex) -> Real:
    """Return where the path has fallen by 3 dB from its lowest frequency, rad/s."""
    size = np.log(np.abs(path))
    fall = size - size[:, :1] - np.log(DROP)
    at = np.argmax(fall < 0, axis=1) - 1
    share = _zero(fall, at)
    return np.where(at >= 0, np.exp(_LOG[at] + share * (_LOG[at + 1] - _LOG[at])), np.nan)


def _first_crossing(curve: Real, level: float) -> Real:
    reached = curve >= level
    at = np.maximum(np.argmax(reached, axis=1) - 1, 0)
    return np.where(reached.any(axis=1), STEP * (at + _zero(curve - level, at)), np.nan)


def _zero(curve: Any, at: Any, who: Any = None) -> Real:
    """Return where between samples ``at`` and ``at + 1`` the curve is 0, as a share of the interval."""
    who = np.arange(len(curve)) if who is None else who
    first, second = curve[who, at], curve[who, at + 1]
    return np.asarray(first / (first - second))


def _nearest(best: Real, who: npt.NDArray[np.intp], found: Real) -> None:
    """Put the smallest of the magnitudes found into ``best``, with its sign."""
    order = np.argsort(-np.abs(found))
    best[who[order]] = found[order]


def _wrapped(angle: Real) -> Real:
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))
