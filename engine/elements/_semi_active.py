"""What semi-active laws share: a current that is on while a product of two signals is positive, or always the same.

i = i_on (s > 0), i_off (s < 0), between them where it is driven back to s = 0 from either side;   smoothly: i = i_off + (i_on - i_off) (1 + tanh(s/transition))/2
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from engine.elements._base import Ports, Realization, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals, first
from engine.errors import DiagramError
from engine.parameters import Param

OFF = Param(name="off", symbol="i_off", unit="A", default=0.0, doc="current while the damper is to be soft")
ON = Param(name="on", symbol="i_on", unit="A", default=1.0, doc="current while the damper is to be hard")


def transition(unit: str) -> Param:
    """Return how wide the switching is spread, in the unit of the product."""
    return Param(
        name="transition", symbol="s_t", unit=unit, default=0.0, lower=0.0,
        doc="product over which the current goes from one value to the other; 0: it switches at once",
    )  # fmt: skip


_SLIDES = 2


class SwitchedCurrent(NonlinearElement):
    """A current that follows the sign of a product; each law says of which."""

    note = "a law that switches has no slope: its current is taken as constant"
    modes: ClassVar[tuple[Mode, ...]] = (0, 1, _SLIDES)
    curved = True
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
    def product(cls, m: Moment) -> Any:
        """Return what decides by its sign."""

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return on (1) or off (0)."""
        return 1 if first(cls.product(m)) > 0 else 0

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the current."""
        off, on = values["off"], values["on"]
        if np.any(values["transition"]):
            return [off + (on - off) * 0.5 * (1 + np.tanh(cls.product(m) / values["transition"]))]
        return [0.0 * m.z[0] + (on if mode == 1 else off)]

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return none for a law that switches: inside a mode the current does not follow the signals."""
        return np.full((1, 2), bool(np.any(values["transition"])))

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that a current that switches is constant until it does."""
        return mode != _SLIDES and not np.any(values["transition"])

    @classmethod
    def held(cls, mode: Mode) -> int | None:
        """Return that sliding holds the product."""
        return 0 if mode == _SLIDES else None

    @classmethod
    def surface(cls, m: Moment, mode: Mode, values: Values) -> Any:
        """Return the product."""
        return cls.product(m)

    @classmethod
    def unheld(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the other current, as the product passes through 0; off where sliding has lost its direction."""
        return Change(mode=1 if mode == 0 else 0)

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return that sliding ends where a signal jumps."""
        return Change(mode=0 if mode == _SLIDES else mode)

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the product has changed its sign, or the mean current is beyond the two currents."""
        if np.any(values["transition"]):
            return []
        if mode == _SLIDES:
            return [m.y[0] - values["on"], values["off"] - m.y[0]] if m.y else []
        return [-cls.product(m) if mode else cls.product(m)]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return sliding, which shows where the product goes; from it to one of the currents."""
        return Change(mode=(1, 0)[guard] if mode == _SLIDES else _SLIDES)


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
