"""Proportional-derivative control law.

u/e = kp + kd s/(1 + s/w)
"""

from __future__ import annotations

from engine.elements import _pid
from engine.elements._base import Element, Ports, Realization, Values


class Pd(Element):
    """Proportional and filtered derivative law; the ideal form gives derivative_time in place of kd."""

    kind = "pd"
    title = "PD controller"
    equation = "u/e = kp + kd s/(1 + s/w)"
    source = _pid.SOURCE
    parameters = (*_pid.PROPORTIONAL, *_pid.DERIVATIVE, *_pid.WEIGHT_P, *_pid.WEIGHT_D)
    example = {"kp": 2.0, "kd": 0.1, "filter_frequency": 200.0}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse two forms of the same gain, and a derivative without a filter."""
        _pid.check(given, values)

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the error as input, or reference and measurement where a setpoint weight is given."""
        return _pid.ports(values)

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return a state for each part that needs one."""
        return _pid.realize(values)
