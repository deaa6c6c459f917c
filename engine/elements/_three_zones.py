"""What a saturation and a dead zone share: a range between two values, and one on either side of it."""

from __future__ import annotations

from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals


class ThreeZones(NonlinearElement):
    """Mode 0 between ``lower`` and ``upper``, 1 above, -1 below; a straight line in each."""

    modes = (-1, 0, 1)

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that every zone is a straight line."""
        return True

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the input is beyond the two values, or back between them."""
        if mode == 0:
            return [m.z[0] - values["upper"], values["lower"] - m.z[0]]
        return [values["upper"] - m.z[0]] if mode > 0 else [m.z[0] - values["lower"]]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to one side, or from it to the range between."""
        return Change(mode=0 if mode else (1, -1)[guard])
