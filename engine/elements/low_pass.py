"""Low-pass filter of order 1 to 8: Butterworth, or of second order with a damping ratio of one's own.

y/u = 1 / Π (1 + 2 d_k s/w + s²/w²),   d_k = sin((2k - 1) π/(2 order)),   with a factor 1 + s/w where the order is odd
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values
from engine.elements._butterworth import butterworth
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class LowPass(Element):
    """Filter with a gain of 1 at rest and, as Butterworth, of -3 dB at its frequency."""

    kind = "low_pass"
    title = "Low-pass filter"
    equation = "y/u = 1 / Π (1 + 2 d_k s/w + s²/w²), d_k = sin((2k - 1) π/(2 order)); odd orders: a factor 1 + s/w"
    source = "S. Butterworth, On the theory of filter amplifiers, Experimental Wireless 7 (1930) 536-541."
    parameters = (
        Param(
            name="frequency", symbol="w", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="corner frequency",
        ),
        Param(name="order", symbol="n", shape="integer", default=1, lower=1, upper=8, doc="number of poles"),
        Param(
            name="damping_ratio", symbol="d", unit="1", required=False, lower=0.0, lower_open=True,
            doc="of order 2 only, in place of the 1/√2 of Butterworth",
        ),
    )  # fmt: skip
    example = {"frequency": 100.0, "order": 2}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse a damping ratio where there is not exactly one pair of poles."""
        if "damping_ratio" in given and values["order"] != 2:
            raise DiagramError(
                f"damping_ratio must be absent unless the order is 2, got order {values['order']}",
                at=("damping_ratio",),
            )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return sections in series, the least damped last; every state is of the size of the input."""
        return butterworth(values["frequency"], values["order"], values["damping_ratio"])
