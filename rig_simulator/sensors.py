"""From what a plant does to the volts that a module delivers: hidden mode, sensor, cable, converter.

structure:  z = y - share * s^2 / (s^2 + 2 d w s + w^2) y      (a mode that no element of the library has)
sensor:     V = sensitivity * z + offset, behind a first-order high-pass where it is an IEPE sensor
cable:      + white noise + mains hum
converter:  late by some samples (delta-sigma), clipped to its range, rounded to its bits
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy.signal import bilinear, lfilter

Samples = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class HiddenMode:
    """A resonance of the structure between the plant and the sensor; ``frequency`` in rad/s."""

    frequency: float
    damping_ratio: float = 0.02
    share: float = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Converter:
    """An input of a module: largest magnitude in V, bits, delay in samples."""

    range: float = 10.0
    bits: int = 24
    delay: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Teds:
    """The data sheet in a sensor: who it is (IEEE 1451.4, basic TEDS), and of an accelerometer its sensitivity, V/(m/s²)."""

    manufacturer: int
    model: int
    serial: int
    version: int = 1
    letter: str = "A"
    sensitivity: float = 0.01
    template: int = 25

    def bits(self) -> bytes:
        """Return the basic TEDS, 14, 15, 5, 6 and 24 bits, then the head of the template and the sensitivity."""
        letter = ord(self.letter) - ord("A") + 1
        value = self.manufacturer | self.model << 14 | letter << 29 | self.version << 34 | self.serial << 40
        code = round(math.log(self.sensitivity / 5e-7) / math.log1p(2 * 0.00015))
        value |= self.template << 66 | code << 76
        return value.to_bytes(12, "little")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """What is connected to one input: an output of the plant, or an output of the rig itself.

    ``noise`` V rms, ``hum`` V at ``mains`` Hz, ``highpass`` Hz (0: none), ``breaks`` s of a run after which the cable breaks:
    the module delivers 0 from then on.
    """

    output: str = ""
    loopback: str = ""
    sensitivity: float = 1.0
    offset: float = 0.0
    noise: float = 0.0
    hum: float = 0.0
    mains: float = 50.0
    highpass: float = 0.0
    breaks: float = math.inf
    hidden_mode: HiddenMode | None = None
    teds: Teds | None = None


class InputRun(Protocol):
    """One input while samples are taken."""

    def deliver(self, values: Samples) -> Samples:
        """Return what the module delivers for the next samples of the quantity."""


class EncoderRun:
    """An encoder and the counter behind it: an angle or a way in whole steps, without noise."""

    def __init__(self, sensor: Sensor, step: float) -> None:
        self._sensor, self._step = sensor, step

    def deliver(self, values: Samples) -> Samples:
        """Return the position, in the unit of the step."""
        moved = self._sensor.sensitivity * values + self._sensor.offset
        return np.asarray(np.floor(moved / self._step + 1e-9) * self._step)


class EdgesRun:
    """A counter of rising edges: one for each whole step that the quantity goes up, from its first sample on."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor
        self._counted, self._last = 0.0, math.nan

    def deliver(self, values: Samples) -> Samples:
        """Return the edges so far."""
        steps = np.floor(self._sensor.sensitivity * values + self._sensor.offset + 1e-9)
        before = steps[:1] if math.isnan(self._last) else [self._last]
        counts = self._counted + np.cumsum(np.maximum(np.diff(steps, prepend=before), 0.0))
        if counts.size:
            self._counted, self._last = float(counts[-1]), float(steps[-1])
        return np.asarray(counts)


class LineRun:
    """A digital line: 1 above half a unit."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor

    def deliver(self, values: Samples) -> Samples:
        """Return 0 or 1."""
        return np.asarray(self._sensor.sensitivity * values + self._sensor.offset > 0.5, dtype=np.float64)


class SensorRun:
    """One input while samples are taken; filters keep their state from block to block."""

    def __init__(self, sensor: Sensor, converter: Converter, *, rate: float, rng: np.random.Generator) -> None:
        self._sensor, self._converter, self._rate, self._rng = sensor, converter, rate, rng
        self._filters: list[tuple[Samples, Samples, Samples]] = []
        if sensor.hidden_mode is not None:
            mode = sensor.hidden_mode
            w, d = mode.frequency, mode.damping_ratio
            self._add([1.0 - mode.share, 2 * d * w, w * w], [1.0, 2 * d * w, w * w])
        if sensor.highpass > 0.0:
            corner = 2 * np.pi * sensor.highpass
            self._add([1.0, 0.0], [1.0, corner])
        self._past = np.zeros(int(np.ceil(converter.delay)) + 1)
        self._done = 0

    def _add(self, numerator: list[float], denominator: list[float]) -> None:
        b, a = bilinear(numerator, denominator, fs=self._rate)
        self._filters.append((b, a, np.zeros(max(len(a), len(b)) - 1)))

    def deliver(self, values: Samples) -> Samples:
        """Return what the module delivers for the next samples of the quantity."""
        sensor, count = self._sensor, values.size
        z: Samples = values
        for i, (b, a, state) in enumerate(self._filters):
            z, after = lfilter(b, a, z, zi=state)
            self._filters[i] = (b, a, after)
        volts = sensor.sensitivity * z + (0.0 if sensor.highpass > 0.0 else sensor.offset)
        if sensor.hum:
            k = self._done + np.arange(count)
            volts = volts + sensor.hum * np.sin(2 * np.pi * sensor.mains / self._rate * k)
        if sensor.noise:
            volts = volts + sensor.noise * self._rng.standard_normal(count)
        broken = np.arange(self._done, self._done + count) >= sensor.breaks * self._rate
        self._done += count
        return np.where(broken, 0.0, self._converted(volts))

    def _converted(self, volts: Samples) -> Samples:
        converter, late = self._converter, self._converter.delay
        if late:
            whole = np.concatenate([self._past, volts])
            self._past = whole[whole.size - self._past.size :]
            place = self._past.size + np.arange(volts.size) - late
            volts = np.interp(place, np.arange(whole.size), whole)
        step = converter.range / 2 ** (converter.bits - 1)
        return np.asarray(np.clip(np.round(volts / step) * step, -converter.range, converter.range - step))
