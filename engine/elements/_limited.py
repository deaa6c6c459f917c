"""P, PI, PD and PID laws whose output has limits, and what keeps their integral part from winding up.

u = min(max(v, lower), upper),   v = P + I + D

none:              I' = ki e
clamping:          I' = ki e, but 0 while v is beyond a limit and ki e drives it further
back_calculation:  I' = ki e + (u - v)/T_t
tracking:          I' = ki e + (u_a - v)/T_t,  u_a being an input: what the actuator really does

Where clamping would go to and fro between both of its rates, v stays at the limit (Filippov's solution), and I is what makes
it so. Source: K. J. Åström and T. Hägglund, Advanced PID Control, ISA 2006, sections 3.5 (windup) and 3.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Final

import numpy as np

from engine.elements import _pid
from engine.elements._base import Ports, Values, vanishing
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals, by_sign
from engine.model.errors import DiagramError
from engine.model.parameters import Param

LIMITS: Final = (
    Param(name="lower", symbol="u_min", required=False, doc="least output; absent: none"),
    Param(name="upper", symbol="u_max", required=False, doc="greatest output; absent: none"),
)
ANTI_WINDUP: Final = (
    Param(
        name="anti_windup", symbol="I'", shape="text", default="none",
        choices=("none", "clamping", "back_calculation", "tracking"),
        doc="what the integral part does at a limit; tracking adds an input for what the actuator really does",
    ),
    Param(
        name="tracking_time", symbol="T_t", unit="s", required=False, lower=0.0, lower_open=True, scale="log",
        doc="of back_calculation and tracking: how fast the integral part follows; absent: kp/ki",
    ),
)  # fmt: skip
_TRACKED: Final = ("back_calculation", "tracking")

_STOPPED, _SLIDING = 2, 3
"""Modes of clamping at a limit, beside 1 in which it integrates: the integral part stands still, or keeps v at the limit."""


def wanted(given: frozenset[str]) -> bool:
    """Return whether a law with these parameters given is no linear one."""
    return not given.isdisjoint({"lower", "upper", "anti_windup", "tracking_time"})


def check(given: frozenset[str], values: Values) -> None:
    """Refuse limits in the wrong order, and an anti-windup that has nothing to do or no time to do it in."""
    lower, upper, kind = values["lower"], values["upper"], values.get("anti_windup", "none")
    if lower is not None and upper is not None and lower.real >= upper.real:
        raise DiagramError(f"upper must be > lower ({lower.real:g}), got {upper.real:g}", at=("upper",))
    if kind in ("clamping", "back_calculation") and lower is None and upper is None:
        raise DiagramError(f"lower or upper must be given for {kind}, got neither", at=("anti_windup",))
    if "tracking_time" in given and kind not in _TRACKED:
        raise DiagramError(
            f"tracking_time must be absent unless anti_windup is {' or '.join(_TRACKED)}, got {kind}",
            at=("tracking_time",),
        )
    if kind in _TRACKED and "tracking_time" not in given:
        kp, ki, _ = _pid.gains(values)
        if kp.real == 0 or ki.real / kp.real < 0:
            raise DiagramError(
                f"tracking_time must be given where kp/ki is not > 0 s, got kp = {kp.real:g}, ki = {ki.real:g}",
                at=("tracking_time",),
            )


class LimitedLaw(NonlinearElement):
    """A law with limits: mode 0 within them, 1 at the upper and -1 at the lower one; with clamping also 2 and 3, -2 and -3."""

    modes = (-3, -2, -1, 0, 1, 2, 3)
    linear: ClassVar[Any]
    """The same law without limits."""

    def __init_subclass__(cls) -> None:
        """Take over what the law without limits declares."""
        for name in ("kind", "title", "equation", "source", "parameters", "example"):
            setattr(cls, name, getattr(cls.linear, name))

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse what the law without limits refuses."""
        cls.linear.check(given, values)

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the ports of the law without limits, and the actuator's output where it is tracked."""
        ports = _pid.ports(values)
        tracked = ("tracking",) if cls._kind(values) == "tracking" else ()
        return Ports(inputs=(*ports.inputs, *tracked))

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return that the output follows all inputs at once but the one that is tracked."""
        count = len(cls.ports(values).inputs)
        return np.array([[True] * (count - 1) + [cls._kind(values) != "tracking"]])

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that every mode is a straight line."""
        return True

    @classmethod
    def limits(cls, values: Values) -> Sequence[tuple[Any, Any]]:
        """Return the limits."""
        lower, upper = values["lower"], values["upper"]
        return [(-np.inf if lower is None else lower, np.inf if upper is None else upper)]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return what is wanted (mode 0), or the limit."""
        return [cls._unlimited(m, values) if mode == 0 else cls._limit(mode, values)]

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the rates of the integral part and of the derivative's filter, where there are such parts."""
        found: list[Any] = []
        if "integral" in cls.states:
            _, ki, _ = _pid.gains(values)
            integral = ki * cls._error(m, values) - vanishing(ki) * m.x[0]
            kind = cls._kind(values)
            if kind == "tracking":
                integral = integral + cls._speed(values) * (m.z[-1] - cls._unlimited(m, values))
            elif kind == "back_calculation" and mode:
                integral = integral + cls._speed(values) * (cls._limit(mode, values) - cls._unlimited(m, values))
            found.append(0.0 * m.z[0] if abs(mode) >= _STOPPED else integral)
        if "derivative" in cls.states:
            found.append(values["filter_frequency"] * (cls._derived(m.z, values) - m.x[-1]))
        return found

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the output wanted is beyond a limit or back; of clamping, what makes the integral part go on."""
        if mode == 0:
            return [cls._beyond(m, side, values) for side in cls._sides(values)]
        side = 1 if mode > 0 else -1
        if abs(mode) == _SLIDING:
            if not m.slope:
                return []
            driven, moved = cls._driven(m, side, values), cls._moved(m, side, values)
            return [-(moved + driven), moved]
        back = -cls._beyond(m, side, values)
        if cls._kind(values) != "clamping":
            return [back]
        driven = cls._driven(m, side, values)
        return [back, driven if abs(mode) == 1 else -driven]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to a limit, or from it; of clamping with the states, since what follows is told by the past."""
        clamping = cls._kind(values) == "clamping"
        if mode == 0:
            side = cls._sides(values)[guard]
            return Change(mode=cls._arrived(m, side, values), x=list(m.x)) if clamping else Change(mode=side)
        if not clamping:
            return Change(mode=0)
        side = 1 if mode > 0 else -1
        if abs(mode) == _SLIDING:
            return Change(mode=(0, side * _STOPPED)[guard], x=cls._slid(m, mode, values))
        if guard == 1:
            return Change(mode=side * (_STOPPED if abs(mode) == 1 else 1), x=list(m.x))
        if abs(mode) != _STOPPED or not m.slope:
            return Change(mode=0, x=list(m.x))
        pushes = cls._moved(m, side, values) + cls._driven(m, side, values)
        return Change(mode=by_sign(pushes, side * _SLIDING, 0), x=list(m.x))

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return within the limits, the integral part being what it has been, where it kept the output at one."""
        return Change(mode=0, x=cls._slid(m, mode, values)) if abs(mode) == _SLIDING else Change(mode=mode)

    @classmethod
    def _kind(cls, values: Values) -> str:
        return str(values.get("anti_windup") or "none") if "integral" in cls.states else "none"

    @classmethod
    def _sides(cls, values: Values) -> list[int]:
        return [side for side, name in ((1, "upper"), (-1, "lower")) if values[name] is not None]

    @classmethod
    def _limit(cls, mode: Mode, values: Values) -> Any:
        return values["upper"] if mode > 0 else values["lower"]

    @classmethod
    def _speed(cls, values: Values) -> Any:
        """Return 1/T_t, 1/s."""
        if values["tracking_time"] is not None:
            return 1.0 / values["tracking_time"]
        kp, ki, _ = _pid.gains(values)
        return ki / kp

    @classmethod
    def _error(cls, m: Moment, values: Values) -> Any:
        return m.z[0] - m.z[1] if _pid.weighted(values) else m.z[0]

    @classmethod
    def _proportional(cls, z: Signals, values: Values) -> Any:
        return cls._weighed(z, "setpoint_weight_p", values)

    @classmethod
    def _derived(cls, z: Signals, values: Values) -> Any:
        return cls._weighed(z, "setpoint_weight_d", values)

    @classmethod
    def _weighed(cls, z: Signals, name: str, values: Values) -> Any:
        """Return the error, of a weighted reference where there are weights; of the inputs or of their slopes."""
        if not _pid.weighted(values):
            return z[0]
        weight = values.get(name)
        return (z[0] if weight is None else weight * z[0]) - z[1]

    @classmethod
    def _without_integral(cls, m: Moment, values: Values) -> Any:
        """Return P + D."""
        kp, _, kd = _pid.gains(values)
        total = kp * cls._proportional(m.z, values)
        if "derivative" in cls.states:
            total = total + kd * values["filter_frequency"] * (cls._derived(m.z, values) - m.x[-1])
        return total

    @classmethod
    def _unlimited(cls, m: Moment, values: Values) -> Any:
        """Return v."""
        total = cls._without_integral(m, values)
        return total + m.x[0] if "integral" in cls.states else total

    @classmethod
    def _beyond(cls, m: Moment, side: int, values: Values) -> Any:
        """Return how far v is beyond a limit."""
        return side * (cls._unlimited(m, values) - cls._limit(side, values))

    @classmethod
    def _driven(cls, m: Moment, side: int, values: Values) -> Any:
        """Return how fast the integral part would drive v beyond a limit."""
        return side * _pid.gains(values)[1] * cls._error(m, values)

    @classmethod
    def _moved(cls, m: Moment, side: int, values: Values) -> Any:
        """Return how fast the other parts move v beyond a limit."""
        kp, _, kd = _pid.gains(values)
        total = kp * cls._proportional(m.slope, values)
        if "derivative" in cls.states:
            w = values["filter_frequency"]
            total = total + kd * w * (cls._derived(m.slope, values) - w * (cls._derived(m.z, values) - m.x[-1]))
        return side * total

    @classmethod
    def _arrived(cls, m: Moment, side: int, values: Values) -> Any:
        """Return the mode of clamping at a limit that v has just passed."""
        slides = by_sign(-cls._moved(m, side, values), side * _SLIDING, side * _STOPPED) if m.slope else side * _STOPPED
        return by_sign(cls._driven(m, side, values), slides, side)

    @classmethod
    def _slid(cls, m: Moment, mode: Mode, values: Values) -> list[Any]:
        """Return the states with the integral part that keeps v at the limit."""
        return [cls._limit(mode, values) - cls._without_integral(m, values), *m.x[1:]]
