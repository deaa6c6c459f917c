"""Passive-off: the damper is as soft as it can be, always.

i = i_off
"""

from __future__ import annotations

from engine.elements._semi_active import ConstantCurrent
from engine.model.parameters import Param


class PassiveOff(ConstantCurrent):
    """A constant current, to compare semi-active laws with."""

    kind = "passive_off"
    title = "Passive off"
    equation = "i = i_off"
    parameters = (Param(name="current", symbol="i_off", unit="A", default=0.0, doc="constant current"),)
    example = {"current": 0.1}
