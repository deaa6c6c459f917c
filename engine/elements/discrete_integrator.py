"""Integrator of a digital controller.

forward: y_{k+1} = y_k + K T u_k;   backward: y_k = y_{k-1} + K T u_k;   trapezoidal: y_k = y_{k-1} + K T (u_k + u_{k-1})/2
"""

from __future__ import annotations

from engine.elements._base import Ports, Realization, Values, matrix
from engine.elements._discrete import Discrete
from engine.elements._sampler import TIMING
from engine.model.parameters import Param

_AT_ONCE = {"forward": 0.0, "trapezoidal": 0.5, "backward": 1.0}
"""Part of a sample that is in the output of its own instant."""


class DiscreteIntegrator(Discrete):
    """A sum over samples, by one of three rules."""

    kind = "discrete_integrator"
    title = "Discrete integrator"
    equation = "y = K T u/(z - 1) (forward), K T z u/(z - 1) (backward), K T/2 (z + 1) u/(z - 1) (trapezoidal)"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., section 8.2."
    parameters = (
        Param(name="gain", symbol="K", default=1.0, doc="output per second for an input of 1"),
        Param(
            name="rule",
            symbol="∫",
            shape="text",
            choices=tuple(_AT_ONCE),
            default="backward",
            doc="what stands for the integral over a sample",
        ),
        *TIMING,
    )
    example = {"gain": 2.0, "rule": "trapezoidal", "sample_time": 0.01}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def discrete(cls, values: Values) -> Realization:
        """Return the sum as a state."""
        step = values["gain"] * values["sample_time"]
        return Realization(
            a=matrix([[1.0]]), b=matrix([[step]]), c=matrix([[1.0]]), d=matrix([[_AT_ONCE[values["rule"]] * step]])
        )
