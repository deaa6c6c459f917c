"""Velocity transducer: a tachometer, or a geophone with a seismic mass.

signal/velocity = sensitivity · s²/(s² + 2 d w s + w²) · 1/(1 + s/bandwidth)
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Reading, Realization, Values, matrix
from engine.elements._biquad import biquad
from engine.model.errors import DiagramError
from engine.model.parameters import Param, Scalar


class VelocityTransducer(Element):
    """Signal proportional to velocity: up to the bandwidth, and of a geophone only above its natural frequency.

    A tachometer measures against the ground and has no natural frequency; a geophone's magnet hangs on a spring. A
    factor whose parameters are absent is 1.
    """

    kind = "velocity_transducer"
    title = "Velocity transducer"
    equation = "signal/velocity = sensitivity · s²/(s² + 2 d w s + w²) · 1/(1 + s/bandwidth)"
    source = "E. O. Doebelin, Measurement Systems, McGraw-Hill 2003, sections 4.6 and 4.7."
    parameters = (
        Param(name="sensitivity", symbol="S", default=1.0, doc="signal for 1 m/s or 1 rad/s"),
        Param(
            name="bandwidth", symbol="w_b", unit="rad/s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="corner of coil, cable and amplifier; absent: without limit",
        ),
        Param(
            name="natural_frequency", symbol="w", unit="rad/s", required=False, lower=0.0, lower_open=True, scale="log",
            doc="undamped frequency of a geophone's mass; absent: a tachometer",
        ),
        Param(
            name="damping_ratio", symbol="d", unit="1", default=0.7, lower=0.0,
            doc="damping ratio of a geophone's mass",
        ),
    )  # fmt: skip
    example = {"bandwidth": 2000.0, "natural_frequency": 28.0}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse the damping of a mass that is not there."""
        if "damping_ratio" in given and "natural_frequency" not in given:
            raise DiagramError(
                "damping_ratio must be absent where no natural_frequency is given", at=("damping_ratio",)
            )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return velocity and signal."""
        return Ports(inputs=("velocity",), outputs=("signal",))

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return states of the size of the velocity, only where they are needed; the band's limit comes first."""
        gain, bandwidth, w, d = (
            values[name] for name in ("sensitivity", "bandwidth", "natural_frequency", "damping_ratio")
        )
        if w is None:
            return _tachometer(gain, bandwidth)
        if bandwidth is None:
            return biquad(0.0, 0.0, gain, frequency=w, damping_ratio=d)
        return Realization(
            a=matrix([[0.0, w, 0.0], [-w, -2.0 * d * w, w], [0.0, 0.0, -bandwidth]]),
            b=matrix([[0.0], [0.0], [bandwidth]]),
            c=matrix([[-gain, -2.0 * d * gain, gain]]),
            d=matrix([[0.0]]),
            reading=Reading(c=matrix([[0.0, 0.0, 0.0]]), d=matrix([[0.0]]), k=matrix([[0.0, gain / w, 0.0]])),
        )


def _tachometer(gain: Scalar, bandwidth: Scalar | None) -> Realization:
    if bandwidth is None:
        return Realization.static(matrix([[gain]]))
    return Realization(a=matrix([[-bandwidth]]), b=matrix([[bandwidth]]), c=matrix([[gain]]), d=matrix([[0.0]]))
