"""Integral of the input over time.

y(t) = initial + gain ∫ u dt
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Element, Ports, Realization, Values, matrix
from engine.model.parameters import Param


class Integrator(Element):
    """Pure integrator with an initial output."""

    kind = "integrator"
    title = "Integrator"
    equation = "y(t) = initial + gain · ∫ u dt"
    source = "Definition."
    parameters = (
        Param(name="gain", symbol="K", default=1.0, doc="slope of the output for an input of 1"),
        Param(name="initial", symbol="y₀", default=0.0, doc="output at time 0"),
    )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return x' = gain u, y = x."""
        one = np.ones((1, 1))
        return Realization(
            a=np.zeros((1, 1)), b=matrix([[values["gain"]]]), c=one, d=np.zeros((1, 1)),
            initial=matrix([[values["initial"]]])[..., 0],
        )  # fmt: skip
