"""Proportional-integral control law.

u = kp e + ki ∫ e dt
"""

from __future__ import annotations

from engine.elements import _pid
from engine.elements._base import Element, Ports, Realization, Values


class Pi(Element):
    """Proportional and integral law; the ideal form gives integral_time in place of ki."""

    kind = "pi"
    title = "PI controller"
    equation = "u = kp · e + ki · ∫ e dt"
    source = _pid.SOURCE
    parameters = (*_pid.PROPORTIONAL, *_pid.INTEGRAL, *_pid.WEIGHT_P)
    example = {"kp": 2.0, "ki": 5.0}

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
