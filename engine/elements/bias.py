"""Bias: an offset added to a signal.

y = u + bias
"""

from __future__ import annotations

import numpy as np

from engine.elements._base import Ports, Realization, Values, matrix
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Signals
from engine.model.parameters import Param


class Bias(NonlinearElement):
    """The offset of a sensor, an amplifier or a valve. With it a response is no longer proportional to its command."""

    kind = "bias"
    title = "Bias"
    equation = "y = u + bias"
    source = "Definition."
    parameters = (Param(name="bias", symbol="b", default=0.0, doc="what is added"),)
    example = {"bias": 0.5}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the input with the offset."""
        return [m.z[0] + values["bias"]]

    @classmethod
    def affine(cls, mode: Mode, values: Values) -> bool:
        """Return True."""
        return True

    @classmethod
    def small_signal(cls, m: Moment, mode: Mode, values: Values) -> Realization:
        """Return a gain of 1."""
        return Realization.static(matrix([[1.0]]) if m.z else np.zeros((1, 0)))
