"""What an output plays, computed at the rate that the hardware really has.

step            u = a for t >= start, else 0
sine            u = a sin(w t + p)
stepped_sine    one frequency after the other, the phase continuous
chirp           u = a sin(w0 t + (w1 - w0) t^2 / (2 T)) for t < T
multisine       u = a sum_k sin(n_k w t - pi k (k - 1) / K)
trapezoid       a distance with limited velocity and acceleration
sampled         straight lines between points
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from agent.errors import AttemptError

Samples = npt.NDArray[np.float64]
Signal = Callable[[Samples], Samples]
"""Times in s, from the start of the drive -> V."""


def signal_of(document: Mapping[str, Any]) -> Signal:
    """Return the signal that a document of the service describes.

    Raises
    ------
    AttemptError
        `unknown_signal` for one that this agent does not know.
    """
    kind = document.get("kind")
    make = _KINDS.get(str(kind))
    if make is None:
        raise AttemptError(
            "unknown_signal", f"signal must be one of {', '.join(_KINDS)}, got {kind!r}: update the agent"
        )
    return make(document)


def _step(given: Mapping[str, Any]) -> Signal:
    amplitude, start = float(given["amplitude"]), float(given.get("start", 0.0))
    # Sample times are k/rate: a rounding below start must not move the step by a whole sample.
    return lambda t: np.where(t >= start - 1e-9, amplitude, 0.0)


def _sine(given: Mapping[str, Any]) -> Signal:
    amplitude, frequency, phase = (float(given.get(name, 0.0)) for name in ("amplitude", "frequency", "phase"))
    start = float(given.get("start") or 0.0)
    return lambda t: np.where(t >= start, amplitude * np.sin(frequency * (t - start) + phase), 0.0)


def _stepped_sine(given: Mapping[str, Any]) -> Signal:
    amplitude, phase, dwell = (float(given[name]) for name in ("amplitude", "phase", "dwell"))
    frequencies = np.array(given["frequencies"], dtype=np.float64)
    phases = phase + np.concatenate([[0.0], np.cumsum(frequencies[:-1] * dwell)])

    def value(t: Samples) -> Samples:
        k = np.minimum((t / dwell).astype(int), frequencies.size - 1)
        inside = t < dwell * frequencies.size
        return np.where(inside, amplitude * np.sin(frequencies[k] * (t - k * dwell) + phases[k]), 0.0)

    return value


def _chirp(given: Mapping[str, Any]) -> Signal:
    amplitude, low, high, length = (
        float(given[name]) for name in ("amplitude", "start_frequency", "end_frequency", "duration")
    )
    rate = (high - low) / (2.0 * length)
    return lambda t: np.where(t < length, amplitude * np.sin((low + rate * t) * t), 0.0)


def _multisine(given: Mapping[str, Any]) -> Signal:
    amplitude, fundamental = float(given["amplitude"]), float(given["fundamental"])
    harmonics = np.array(given["harmonics"], dtype=np.float64)
    k = np.arange(1, harmonics.size + 1)
    phases = -np.pi * k * (k - 1) / harmonics.size

    def value(t: Samples) -> Samples:
        total = np.zeros_like(t)
        for harmonic, phase in zip(harmonics, phases, strict=True):  # one at a time: blocks are long, harmonics many
            total += np.sin(harmonic * fundamental * t + phase)
        return amplitude * total

    return value


def _trapezoid(given: Mapping[str, Any]) -> Signal:
    distance, speed, acceleration = (float(given[name]) for name in ("distance", "max_velocity", "max_acceleration"))
    start = float(given.get("start") or 0.0)
    way = abs(distance)
    speed = min(speed, math.sqrt(way * acceleration)) if way else speed
    ramp = speed / acceleration
    end = ramp + way / speed

    def value(t: Samples) -> Samples:
        t = np.clip(t - start, 0.0, end)
        rising = 0.5 * acceleration * np.minimum(t, ramp) ** 2
        even = speed * np.clip(t - ramp, 0.0, end - 2 * ramp)
        late = np.clip(t - (end - ramp), 0.0, ramp)
        return math.copysign(1.0, distance) * (rising + even + speed * late - 0.5 * acceleration * late**2)

    return value


def _sampled(given: Mapping[str, Any]) -> Signal:
    time, values = (np.array(given[name], dtype=np.float64) for name in ("time", "values"))
    return lambda t: np.interp(t, time, values)


_KINDS: Mapping[str, Callable[[Mapping[str, Any]], Signal]] = {
    "step": _step,
    "sine": _sine,
    "stepped_sine": _stepped_sine,
    "chirp": _chirp,
    "multisine": _multisine,
    "trapezoid": _trapezoid,
    "sampled": _sampled,
}
