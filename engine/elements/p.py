"""Proportional control law.

u = kp e
"""

from __future__ import annotations

from engine.elements import _pid
from engine.elements._control_law import ControlLaw
from engine.elements._limited import LIMITS


class P(ControlLaw):
    """Proportional law."""

    kind = "p"
    title = "P controller"
    equation = "u = kp · e"
    source = _pid.SOURCE
    parameters = (*_pid.PROPORTIONAL, *_pid.WEIGHT_P, *LIMITS)
    example = {"kp": 2.0}
    parts = ()
