"""What P, PI, PD and PID controllers share: one realisation for all of them, and limits where they are given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from engine.elements import _limited, _pid
from engine.elements._base import Element, Ports, Realization, Values


class ControlLaw(Element):
    """A controller that is linear unless its output has limits."""

    parts: ClassVar[tuple[str, ...]]
    """States of the law with limits: \"integral\", \"derivative\"."""
    _with_limits: ClassVar[type[_limited.LimitedLaw]]

    def __init_subclass__(cls) -> None:
        """Make the law with limits, too."""
        given = {"linear": cls, "states": cls.parts, "__module__": cls.__module__}
        cls._with_limits = type(f"Limited{cls.__name__}", (_limited.LimitedLaw,), given)

    @classmethod
    def law(cls, given: frozenset[str]) -> type[Element]:
        """Return the law with limits where some are given."""
        return cls._with_limits if _limited.wanted(given) else cls

    @classmethod
    def assumed(cls, given: frozenset[str]) -> Mapping[str, str]:
        """Return what is told of the derivative's filter."""
        return _pid.assumed(given)

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse two forms of the same gain, and what only a law with limits has."""
        _pid.check(given)
        _limited.check(given, values)

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the error as input, or reference and measurement where a setpoint weight is given."""
        return _pid.ports(values)

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return a state for each part that needs one."""
        return _pid.realize(values)
