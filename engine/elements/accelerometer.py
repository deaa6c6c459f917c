"""Accelerometer: a seismic mass on a spring, and the high-pass of its IEPE supply where it has one.

signal/acceleration = sensitivity / (1 + 2 d s/w + s²/w²) · s/(s + high_pass_frequency)

The deflection z of the mass obeys z'' + 2 d w z' + w² z = -acceleration; the signal is -sensitivity w² z.
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Reading, Realization, Values, matrix
from engine.elements._biquad import biquad
from engine.model.parameters import Param


class Accelerometer(Element):
    """True below its natural frequency, and with an IEPE supply only above the high-pass: it then sees no standstill."""

    kind = "accelerometer"
    title = "Accelerometer"
    equation = "signal/acceleration = sensitivity / (1 + 2 d s/w + s²/w²) · s/(s + high_pass_frequency)"
    source = "E. O. Doebelin, Measurement Systems, McGraw-Hill 2003, section 4.8."
    parameters = (
        Param(name="sensitivity", symbol="S", default=1.0, doc="signal for 1 m/s²"),
        Param(
            name="natural_frequency", symbol="w", unit="rad/s", lower=0.0, lower_open=True, scale="log",
            doc="undamped frequency of the seismic mass, as mounted",
        ),
        Param(
            name="damping_ratio", symbol="d", unit="1", default=0.7, lower=0.0,
            doc="damping ratio of the seismic mass: about 0.7 for a servo type, 0.01 for a piezoelectric one",
        ),
        Param(
            name="high_pass_frequency", symbol="w_h", unit="rad/s", required=False, lower=0.0, lower_open=True,
            scale="log", doc="corner of the IEPE coupling (inverse of the discharge time constant); absent: none",
        ),
    )  # fmt: skip
    example = {"natural_frequency": 6000.0}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return acceleration and signal."""
        return Ports(inputs=("acceleration",), outputs=("signal",))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the deflection and its rate, both of the size of the acceleration, and what the high-pass remembers."""
        gain, w, d = values["sensitivity"], values["natural_frequency"], values["damping_ratio"]
        corner = values["high_pass_frequency"]
        if corner is None:
            return biquad(gain, 0.0, 0.0, frequency=w, damping_ratio=d)
        return Realization(
            a=matrix([[0.0, w, 0.0], [-w, -2.0 * d * w, 0.0], [corner, 0.0, -corner]]),
            b=matrix([[0.0], [w], [0.0]]),
            c=matrix([[gain, 0.0, -gain]]),
            d=matrix([[0.0]]),
            reading=Reading(c=matrix([[0.0, 0.0, 0.0]]), d=matrix([[0.0]]), k=matrix([[0.0, 0.0, gain / corner]])),
        )
