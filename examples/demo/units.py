"""How numbers are shown: the service answers in SI; people read milliseconds, per cent, degrees and decibels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Shown:
    """A display unit and the way to it from SI."""

    unit: str
    convert: Callable[[float], float]
    digits: int = 2

    def __call__(self, value: float | None, *, with_unit: bool = True) -> str:
        """Return an SI value in the display unit, a dash where there is none."""
        if value is None:
            return "–"
        # Adding 0.0 turns a negative zero into a plain one.
        number = f"{round(self.convert(value), self.digits) + 0.0:.{self.digits}f}".replace("-", "\N{MINUS SIGN}")
        return f"{number} {self.unit}" if with_unit and self.unit else number


def _times(factor: float) -> Callable[[float], float]:
    return lambda value: value * factor


MILLISECONDS = Shown("ms", _times(1e3), 1)
PERCENT = Shown("%", _times(100.0))
PER_CENT_ALREADY = Shown("%", _times(1.0))
MILLIMETRES = Shown("mm", _times(1e3), 3)
PLAIN = Shown("", _times(1.0), 3)

METRICS: Mapping[str, Shown] = {
    "rise_time": MILLISECONDS,
    "response_time": MILLISECONDS,
    "settling_time": MILLISECONDS,
    "overshoot": Shown("%", _times(100.0), 3),
    "max_velocity": Shown("mm/s", _times(1e3), 1),
    "max_acceleration": Shown("m/s²", _times(1.0), 1),
    "control_effort": Shown("", _times(1.0), 3),
    "bandwidth": Shown("rad/s", _times(1.0), 1),
    "critical_frequency": Shown("rad/s", _times(1.0), 0),
    "sensitivity_peak": PLAIN,
    "gain_margin": Shown("dB", lambda value: 20.0 * math.log10(value), 2),
    "phase_margin": Shown("°", math.degrees, 1),
    "delay_margin": MILLISECONDS,
}

_WORDS = {"control_effort": "peak valve command"}

PARAMETERS: Mapping[str, Shown] = {
    "valve.flow_gain": Shown("cm³/s", _times(1e6), 2),
    "valve.time_constant": Shown("ms", _times(1e3), 2),
    "transport.time": Shown("ms", _times(1e3), 2),
    "recording.time": Shown("ms", _times(1e3), 2),
    "controller.kp": Shown("1/m", _times(1.0), 1),
    "controller.setpoint_weight_p": Shown("", _times(1.0), 4),
    "controller.kd": Shown("s/m", _times(1.0), 4),
    "controller.kd1": Shown("s/m", _times(1.0), 4),
    "controller.kd2": Shown("s²/m", lambda value: value, 7),
}


def measured(name: str, metric: Mapping[str, Any], *, with_unit: bool = True) -> str:
    """Return a metric as people read it, or its verdict where it has no value."""
    if metric["value"] is None:
        return str(metric["verdict"]).replace("_", " ")
    return METRICS.get(name, PLAIN)(metric["value"], with_unit=with_unit)


def parameter(path: str, value: float | None, *, with_unit: bool = True) -> str:
    """Return a parameter's value as people read it."""
    return PARAMETERS.get(path, PLAIN)(value, with_unit=with_unit)


def signed(value: float | None) -> str:
    """Return an elasticity or influence coefficient as text, with its sign."""
    return "–" if value is None else f"{round(value, 3) + 0.0:+.3f}".replace("-", "\N{MINUS SIGN}")


def words(name: str) -> str:
    """Return a name as words: `response_time` is "response time"."""
    return _WORDS.get(name) or name.replace("_", " ")
