"""Feed-forward of a reference: its value, velocity and acceleration, rolled off together.

y/u = (kf + kv s + ka s²) / (1 + 2 d s/w + s²/w²)
"""

from __future__ import annotations

import math

from engine.elements._base import Element, Ports, Realization, Values
from engine.elements._biquad import biquad
from engine.model.parameters import Param


class FeedForward(Element):
    """What a drive will need for a motion, added to its controller's output before an error arises.

    With the gains of the inverse plant (kv = friction, ka = mass for a force) the error during a motion vanishes up to
    the roll-off.
    """

    kind = "feed_forward"
    title = "Feed-forward"
    equation = "y/u = (kf + kv s + ka s²) / (1 + 2 d s/w + s²/w²)"
    source = "G. Ellis, Control System Design Guide, Butterworth-Heinemann 2012, chapter 8."
    parameters = (
        Param(name="kf", symbol="K_f", default=0.0, doc="gain of the reference itself"),
        Param(name="kv", symbol="K_v", default=0.0, doc="gain of the reference's velocity"),
        Param(name="ka", symbol="K_a", default=0.0, doc="gain of the reference's acceleration"),
        Param(
            name="filter_frequency", symbol="w", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="corner of the roll-off, up to which the derivatives are true",
        ),
        Param(
            name="filter_damping", symbol="d", unit="1", default=1 / math.sqrt(2), lower=0.0, lower_open=True,
            doc="damping ratio of the roll-off",
        ),
    )  # fmt: skip
    example = {"kv": 1.0, "ka": 0.02, "filter_frequency": 500.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the quotient with its numerator over the roll-off's frequency."""
        w = values["filter_frequency"]
        return biquad(
            values["kf"], values["kv"] * w, values["ka"] * w * w, frequency=w, damping_ratio=values["filter_damping"]
        )
