"""Switch: one of two signals, chosen by a third.

y = in1 while control >= threshold, else in2
"""

from __future__ import annotations

from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals, first
from engine.model.parameters import Param


class Switch(NonlinearElement):
    """Changes over between two signals; with hysteresis, a control signal that lingers at the threshold switches once."""

    kind = "switch"
    title = "Switch"
    equation = "y = in1 while control >= threshold, else in2"
    source = "Definition."
    note = "a switch is linearised as the signal that it lets through at the operating point"
    parameters = (
        Param(
            name="threshold", symbol="c_0", default=0.0, doc="value of the control signal from which in1 is let through"
        ),
        Param(
            name="hysteresis",
            symbol="h",
            default=0.0,
            lower=0.0,
            doc="distance between switching on and off, around the threshold",
        ),
    )
    modes = (-1, 1)
    example = {"threshold": 0.5, "hysteresis": 0.1}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the two signals, the control signal and one output."""
        return Ports(inputs=("in1", "in2", "control"))

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return 1 (in1) from the threshold on, else -1 (in2)."""
        return 1 if first(m.z[2]) >= first(values["threshold"]) else -1

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the signal that is let through."""
        return [m.z[0] if mode > 0 else m.z[1]]

    @classmethod
    def across(cls, guard: int, mode: Mode, values: Values) -> Mode | None:
        """Return the other signal."""
        return -mode

    @classmethod
    def stays(cls, mode: Mode) -> bool:
        """Return whether in1 is let through: it is at the threshold."""
        return mode > 0

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that a signal is let through as it is."""
        return True

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the control signal is beyond the threshold and half the hysteresis."""
        return [-mode * (m.z[2] - values["threshold"]) - 0.5 * values["hysteresis"]]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to the other signal."""
        return Change(mode=-mode)
