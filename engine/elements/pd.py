"""Proportional-derivative control law.

u/e = kp + kd s/(1 + s/w)
"""

from __future__ import annotations

from engine.elements import _pid
from engine.elements._control_law import ControlLaw
from engine.elements._limited import LIMITS


class Pd(ControlLaw):
    """Proportional and filtered derivative law; the ideal form gives derivative_time in place of kd."""

    kind = "pd"
    title = "PD controller"
    equation = "u/e = kp + kd s/(1 + s/w)"
    source = _pid.SOURCE
    parameters = (*_pid.PROPORTIONAL, *_pid.DERIVATIVE, *_pid.WEIGHT_P, *_pid.WEIGHT_D, *LIMITS)
    example = {"kp": 2.0, "kd": 0.1, "filter_frequency": 200.0}
    parts = ("derivative",)
