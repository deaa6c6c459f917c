"""PD₂ law: proportional, first and second derivative, with a second-order roll-off.

y/u = (kp + kd1 s + kd2 s²) / (1 + 2 d s/w + s²/w²)
"""

from __future__ import annotations

import math

from engine.elements._base import Element, Ports, Realization, Values
from engine.elements._biquad import biquad
from engine.model.parameters import Param


class Pd2(Element):
    """The paper's law against vibration: acceleration feedback beside velocity feedback."""

    kind = "pd2"
    title = "PD₂ controller"
    equation = "y/u = (kp + kd1 s + kd2 s²) / (1 + 2 d s/w + s²/w²)"
    source = "Assisted optimization of the dynamic behaviour of industrial robots, section 5.4 and Fig. 11 (ideal law)."
    parameters = (
        Param(name="kp", symbol="K_p", scale="log", doc="proportional gain"),
        Param(name="kd1", symbol="K_d1", default=0.0, doc="gain of the first derivative"),
        Param(name="kd2", symbol="K_d2", default=0.0, doc="gain of the second derivative"),
        Param(
            name="filter_frequency", symbol="w", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="corner of the roll-off that makes the law proper",
        ),
        Param(
            name="filter_damping", symbol="d", unit="1", default=1 / math.sqrt(2), lower=0.0, lower_open=True,
            doc="damping ratio of the roll-off",
        ),
    )  # fmt: skip
    example = {"kp": 2.0, "kd1": 0.1, "kd2": 0.001, "filter_frequency": 500.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the quotient with its numerator over the roll-off's frequency."""
        w = values["filter_frequency"]
        return biquad(
            values["kp"], values["kd1"] * w, values["kd2"] * w * w, frequency=w, damping_ratio=values["filter_damping"]
        )
