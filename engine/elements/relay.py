"""Relay with hysteresis: one of two values, changed where the input passes a threshold.

y = high once u >= hysteresis/2,   y = low once u <= -hysteresis/2
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Array, Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals, first
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class Relay(NonlinearElement):
    """Two-point controller or switch.

    Without hysteresis, an input that the output drives back across 0 from either side slides along 0: the output is then
    the mean value that keeps it there, the limit of ever faster switching.
    """

    kind = "relay"
    title = "Relay with hysteresis"
    equation = "y = high once u >= hysteresis/2, y = low once u <= -hysteresis/2"
    source = "Y. Z. Tsypkin, Relay Control Systems, Cambridge 1984; A. F. Filippov, Kluwer 1988, for the sliding."
    note = "a relay has no slope where it switches: its output is taken as constant"
    parameters = (
        Param(name="low", symbol="y_1", default=-1.0, doc="output below the threshold"),
        Param(name="high", symbol="y_2", default=1.0, doc="output above the threshold"),
        Param(name="hysteresis", symbol="h", default=0.0, lower=0.0, doc="distance between the two thresholds"),
    )
    modes = (-1, 0, 1)
    example = {"low": -3.0, "high": 2.0, "hysteresis": 0.4}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse values in the wrong order."""
        if values["low"].real > values["high"].real:
            raise DiagramError(
                f"high must be >= low ({values['low'].real:g}), got {values['high'].real:g}", at=("high",)
            )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none: inside a mode the output does not follow the input."""
        return np.zeros((1, 1), dtype=bool)

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return high (1) for an input above the upper threshold, else low (-1); 0 slides where there is no hysteresis."""
        if first(values["hysteresis"]) == 0 and first(m.z[0]) == 0:
            return 0
        return 1 if first(m.z[0]) > 0.5 * first(values["hysteresis"]) else -1

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the high or low value; what is held when sliding."""
        return [values["high"] if mode > 0 else values["low"]]

    @classmethod
    def across(cls, guard: int, mode: Mode, values: Values) -> Mode | None:
        """Return the other value, unless the input is held."""
        return -mode or None

    @classmethod
    def held(cls, mode: Mode) -> int | None:
        """Return that sliding holds the input."""
        return 0 if mode == 0 else None

    @classmethod
    def unheld(cls, m: Moment, mode: Mode, values: Values, *, before: Mode) -> Change:
        """Return to the other value: the input passes through 0 and the output cannot keep it there."""
        return Change(mode=-1 if before >= 0 else 1)

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return that sliding ends where the input jumps: nothing holds it there."""
        return Change(mode=mode or 1)

    @classmethod
    def jumps(cls, values: Values) -> bool:
        """Return whether hysteresis is about to begin, where the input slides without it."""
        return first(values["hysteresis"]) == 0 and bool(np.any(values["hysteresis"]))

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that the output is constant, or held."""
        return True

    @classmethod
    def describing_function(cls, amplitude: Array, values: Values) -> Array | None:
        """Return 4 M/(π A) (sqrt(1 - x²) - j x) with x = h/(2 A): a rectangle that is late by arcsin x; 0 where it stays."""
        late = 0.5 * values["hysteresis"] / amplitude
        height = 2 * (values["high"] - values["low"]) / (np.pi * amplitude)
        inside = np.minimum(late, 1.0)
        return np.where(late <= 1.0, height * (np.sqrt(1 - inside * inside) - 1j * inside), 0.0)

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the input is beyond the threshold; how far the mean value is beyond the two values."""
        if mode == 0:
            return [m.y[0] - values["high"], values["low"] - m.y[0]] if m.y else []
        half = 0.5 * values["hysteresis"]
        return [-m.z[0] - half] if mode > 0 else [m.z[0] - half]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to the other value; without hysteresis first into sliding, which shows where the input goes."""
        if mode == 0:
            return Change(mode=(1, -1)[guard])
        return Change(mode=-mode if first(values["hysteresis"]) > 0 else 0)
