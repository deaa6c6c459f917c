"""What switched semi-active laws share: a current that is on while a product of two signals is positive.

i = i_on (s > 0), i_off (s < 0);   smoothly: i = i_off + (i_on - i_off) (1 + tanh(s/transition))/2
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals, first
from engine.parameters import Param

OFF = Param(name="off", symbol="i_off", unit="A", default=0.0, doc="current while the damper is to be soft")
ON = Param(name="on", symbol="i_on", unit="A", default=1.0, doc="current while the damper is to be hard")


def transition(unit: str) -> Param:
    """Return how wide the switching is spread, in the unit of the product."""
    return Param(
        name="transition", symbol="s_t", unit=unit, default=0.0, lower=0.0,
        doc="product over which the current goes from one value to the other; 0: it switches at once",
    )  # fmt: skip


class SwitchedCurrent(NonlinearElement):
    """A current that follows the sign of a product; each law says of which."""

    note = "a law that switches has no slope: its current is taken as constant"
    modes: ClassVar[tuple[Mode, ...]] = (0, 1)
    entering: ClassVar[tuple[str, str]]
    example = {"off": 0.1, "transition": 0.4}

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
        return [0.0 * m.z[0] + (on if mode else off)]

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the product has changed its sign."""
        if np.any(values["transition"]):
            return []
        return [-cls.product(m) if mode else cls.product(m)]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the other current."""
        return Change(mode=1 - mode)
