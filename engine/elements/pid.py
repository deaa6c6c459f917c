"""Proportional-integral-derivative control law.

u/e = kp + ki/s + kd s/(1 + s/w)
"""

from __future__ import annotations

from engine.elements import _pid
from engine.elements._control_law import ControlLaw
from engine.elements._limited import ANTI_WINDUP, LIMITS


class Pid(ControlLaw):
    """Parallel PID law, or the ideal form with integral_time and derivative_time; a gain of 0 leaves no state."""

    kind = "pid"
    title = "PID controller"
    equation = "u/e = kp + ki/s + kd s/(1 + s/w)"
    source = _pid.SOURCE
    parameters = (
        *_pid.PROPORTIONAL,
        *_pid.INTEGRAL,
        *_pid.DERIVATIVE,
        *_pid.WEIGHT_P,
        *_pid.WEIGHT_D,
        *LIMITS,
        *ANTI_WINDUP,
    )
    example = {"kp": 2.0, "ki": 5.0, "kd": 0.1, "filter_frequency": 200.0}
    parts = ("integral", "derivative")
