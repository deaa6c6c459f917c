"""Passive-off: the damper is as soft as it can be, always.

i = i_off
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Ports, Realization, Values
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Signals
from engine.parameters import Param


class PassiveOff(NonlinearElement):
    """A constant current, to compare semi-active laws with."""

    kind = "passive_off"
    title = "Passive off"
    equation = "i = i_off"
    source = "S. Dyke, B. Spencer, M. Sain, J. Carlson, Smart Mater. Struct. 5 (1996) 565-575."
    parameters = (Param(name="current", symbol="i_off", unit="A", default=0.0, doc="constant current"),)
    example = {"current": 0.1}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the current."""
        return Ports(inputs=(), outputs=("current",), output_units=("A",))

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the current."""
        return [0.0 * m.t + values["current"]]

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return nothing that moves."""
        return Realization.static(np.zeros((1, 0)))
