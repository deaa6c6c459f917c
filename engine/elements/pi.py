"""Proportional-integral control law.

u = kp e + ki ∫ e dt
"""

from __future__ import annotations

from engine.elements import _pid
from engine.elements._control_law import ControlLaw
from engine.elements._limited import ANTI_WINDUP, LIMITS


class Pi(ControlLaw):
    """Proportional and integral law; the ideal form gives integral_time in place of ki."""

    kind = "pi"
    title = "PI controller"
    equation = "u = kp · e + ki · ∫ e dt"
    source = _pid.SOURCE
    parameters = (*_pid.PROPORTIONAL, *_pid.INTEGRAL, *_pid.WEIGHT_P, *LIMITS, *ANTI_WINDUP)
    example = {"kp": 2.0, "ki": 5.0}
    parts = ("integral",)
