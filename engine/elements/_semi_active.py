"""What semi-active laws share: a current that is on while a product of two signals is positive, or always the same.

i = i_on (s > 0), i_off (s < 0), between them where it is driven back to s = 0 from either side;   smoothly: i = i_off + (i_on - i_off) (1 + tanh(s/transition))/2
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from engine.elements._base import Ports, Realization, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals, first
from engine.model.errors import DiagramError
from engine.model.parameters import Param

OFF = Param(name="off", symbol="i_off", unit="A", default=0.0, doc="current while the damper is to be soft")
ON = Param(name="on", symbol="i_on", unit="A", default=1.0, doc="current while the damper is to be hard")


def transition(unit: str) -> Param:
    """Return how wide the switching is spread, in the unit of the product."""
    return Param(
        name="transition", symbol="s_t", unit=unit, default=0.0, lower=0.0,
        doc="spreads the switching: i = i_off + (i_on - i_off) (1 + tanh(product/s_t))/2; 0: it switches at once",
    )  # fmt: skip


_SLIDES = 4
"""From this mode on one factor is held at 0: 4 + 2 k + (the other one is positive) holds factor k; the modes below are two bits, the
signs of both factors."""


class SwitchedCurrent(NonlinearElement):
    """A current that follows the sign of a product of two factors; each law says of which.

    The current switches where one of the factors passes through 0; where it drives this factor back from either side, the factor stays 0.
    """

    note = "a law that switches has no slope: its current is taken as constant"
    modes: ClassVar[tuple[Mode, ...]] = tuple(range(8))
    product: ClassVar[bool] = True
    entering: ClassVar[tuple[str, str]]
    example = {"off": 0.1, "transition": 0.4}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse currents in the wrong order."""
        if values["on"].real < values["off"].real:
            raise DiagramError(f"on must be >= off ({values['off'].real:g} A), got {values['on'].real:g}", at=("on",))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the two signals, and the current."""
        return Ports(inputs=cls.entering, outputs=("current",), output_units=("A",))

    @classmethod
    @abstractmethod
    def factors(cls, m: Moment) -> tuple[Any, Any]:
        """Return the two signals whose product decides by its sign, linear in the inputs."""

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the signs of both factors; where one is 0, the signs for which the current is off."""
        if _smooth(values):
            return 0
        a, b = (first(factor) for factor in cls.factors(m))
        if a * b > 0:
            return _signs(a > 0, b > 0)
        return _signs(a > 0, a <= 0) if a else _signs(b <= 0, b > 0)

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the current."""
        off, on = values["off"], values["on"]
        if _smooth(values):
            a, b = cls.factors(m)
            return [off + (on - off) * 0.5 * (1 + np.tanh(a * b / values["transition"]))]
        return [0.0 * m.z[0] + (off if cls.stays(mode) else on)]

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none for a law that switches: inside a mode the current does not follow the signals."""
        return np.full((1, 2), _smooth(values))

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that a current that switches is constant until it does, or held."""
        return not _smooth(values)

    @classmethod
    def jumps(cls, values: Values) -> bool:
        """Return whether the transition is about to begin: from then on the law is another one."""
        return not _smooth(values) and bool(np.any(values["transition"]))

    @classmethod
    def across(cls, guard: int, mode: Mode, values: Values) -> Mode | None:
        """Return the other sign of a factor, while neither is held."""
        return None if _smooth(values) or mode >= _SLIDES else mode ^ (1 << guard)

    @classmethod
    def stays(cls, mode: Mode) -> bool:
        """Return whether the current is off."""
        return mode not in {_signs(False, False), _signs(True, True)}

    @classmethod
    def held(cls, mode: Mode) -> int | None:
        """Return that sliding holds a factor."""
        return 0 if mode >= _SLIDES else None

    @classmethod
    def surface(cls, m: Moment, mode: Mode, values: Values) -> Any:
        """Return the factor that is held, with the sign of the other one: positive where the current is on."""
        factor, other = _slide(mode)
        own = cls.factors(m)[factor]
        return own if other else -own

    @classmethod
    def unheld(cls, m: Moment, mode: Mode, values: Values, *, before: Mode) -> Change:
        """Return that the factor passes through 0, or the current off where it had been held."""
        factor, other = _slide(mode)
        if before >= _SLIDES:
            return Change(mode=_with(factor, positive=not other, other=other))
        return Change(mode=before ^ (1 << factor))

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return that sliding ends where a signal jumps."""
        if mode < _SLIDES:
            return Change(mode=mode)
        factor, other = _slide(mode)
        return Change(mode=_with(factor, positive=not other, other=other))

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far a factor has changed its sign; or how far the mean current is beyond the two currents, or the other factor is."""
        if _smooth(values):
            return []
        if mode < _SLIDES:
            return [-f if mode >> k & 1 else f for k, f in enumerate(cls.factors(m))]
        factor, other = _slide(mode)
        signal = cls.factors(m)[1 - factor]
        return [m.y[0] - values["on"], values["off"] - m.y[0], -signal if other else signal] if m.y else []

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return sliding, which shows where the factor goes; from it to one of the currents."""
        if mode < _SLIDES:
            return Change(mode=_SLIDES + 2 * guard + (mode >> (1 - guard) & 1))
        factor, other = _slide(mode)
        if guard < _PASSES:
            return Change(mode=_with(factor, positive=other == (guard == 0), other=other))
        return Change(mode=_with(factor, positive=other, other=not other))


_PASSES = 2  # the guard of sliding that tells that the other factor passes through 0


def _smooth(values: Values) -> bool:
    return first(values["transition"]) > 0


def _signs(a: bool, b: bool) -> Mode:  # noqa: FBT001 - two signs
    """Return the mode in which the factors are positive or not."""
    return int(a) + 2 * int(b)


def _slide(mode: Mode) -> tuple[int, bool]:
    """Return which factor a mode holds, and whether the other one is positive."""
    return (mode - _SLIDES) // 2, bool((mode - _SLIDES) % 2)


def _with(factor: int, *, positive: bool, other: bool) -> Mode:
    """Return the mode in which ``factor`` is positive or not, and the other one is."""
    return _signs(positive, other) if factor == 0 else _signs(other, positive)


class ConstantCurrent(NonlinearElement):
    """A constant current, to compare semi-active laws with."""

    source = "S. Dyke, B. Spencer, M. Sain, J. Carlson, Smart Mater. Struct. 5 (1996) 565-575."

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the current."""
        return Ports(inputs=(), outputs=("current",), output_units=("A",))

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the current."""
        return [0.0 * m.t + values["current"]]

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that nothing moves."""
        return True

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return nothing that moves."""
        return Realization.static(np.zeros((1, 0)))
