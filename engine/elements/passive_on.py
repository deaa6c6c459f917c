"""Passive-on: the damper is as hard as it can be, always.

i = i_on
"""

from __future__ import annotations

from engine.elements._semi_active import ConstantCurrent
from engine.model.parameters import Param


class PassiveOn(ConstantCurrent):
    """A constant current, to compare semi-active laws with."""

    kind = "passive_on"
    title = "Passive on"
    equation = "i = i_on"
    parameters = (Param(name="current", symbol="i_on", unit="A", default=1.0, doc="constant current"),)
    example = {"current": 2.0}
