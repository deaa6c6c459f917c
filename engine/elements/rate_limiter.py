"""Rate limiter: the output follows the input as fast as it may.

-falling <= y' <= rising,   y = u whenever the limits allow it
"""

from __future__ import annotations

from engine.elements._base import Ports, Realization, Values, matrix
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals
from engine.model.parameters import Param

_JUMPED = 2


class RateLimiter(NonlinearElement):
    """Slew rate of an amplifier or a command; a gain of 1, exactly, for inputs that are slow enough."""

    kind = "rate_limiter"
    title = "Rate limiter"
    equation = "-falling <= y' <= rising, y = u whenever the limits allow it"
    source = "Definition."
    states = ("output",)
    modes = (-1, 0, 1, _JUMPED)
    parameters = (
        Param(
            name="rising", symbol="R", default=1.0, lower=0.0, lower_open=True, scale="log",
            doc="fastest rise, in units of the input per second",
        ),
        Param(
            name="falling", symbol="F", required=False, lower=0.0, lower_open=True, scale="log",
            doc="fastest fall, a positive number; absent: as fast as the rise",
        ),
        Param(name="initial", symbol="y_0", default=0.0, doc="output at the beginning"),
    )  # fmt: skip
    example = {"rising": 2.0, "falling": 3.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return the output at the beginning."""
        return [values["initial"]]

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return that the first input may be anywhere."""
        return _JUMPED

    @classmethod
    def _fall(cls, values: Values) -> float:
        fall: float = values["rising"] if values["falling"] is None else values["falling"]
        return fall

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the rate of the output while it is limited."""
        rate = {1: values["rising"], -1: -cls._fall(values)}.get(mode, 0.0)
        return [0.0 * m.z[0] + rate]

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the output is from the input."""
        return [m.z[0] - m.x[0]]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the input (mode 0), or the state that rises (1) or falls (-1) towards it."""
        return [m.z[0] if mode == 0 else 0.0 * m.z[0] + m.x[0]]

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return that the output follows the input, or moves at one of two rates."""
        return True

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how much too fast the input is, or how far the output has passed it."""
        if mode == 0:
            return [m.slope[0] - values["rising"], -m.slope[0] - cls._fall(values)] if m.slope else []
        if mode == _JUMPED:
            return [m.z[0] - m.x[0], m.x[0] - m.z[0], 1.0]
        return [mode * (m.x[0] - m.z[0])]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return to a limit, beginning at the input, or to following."""
        if mode == 0:
            return Change(mode=(1, -1)[guard], x=[m.z[0]])
        return Change(mode=(1, -1, 0)[guard] if mode == _JUMPED else 0)

    @classmethod
    def release(cls, m: Moment, mode: Mode, values: Values) -> Change:
        """Return that the input may jump anywhere from where the output is."""
        return Change(mode=_JUMPED, x=[m.z[0] if mode == 0 else m.x[0]])

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization | None:
        """Return a gain of 1."""
        return Realization.static(matrix([[1.0]]))
