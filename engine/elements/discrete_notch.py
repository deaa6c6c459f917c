"""Notch filter of a digital controller: the continuous one by Tustin's rule, exact at its frequency.

y/u = N(s), s = w/tan(w T/2) (z - 1)/(z + 1),   N(s) = (s² + depth width w s + w²) / (s² + width w s + w²)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from engine.elements._base import Ports, Realization, Values
from engine.elements._canonical import rational
from engine.elements._discrete import Discrete
from engine.elements._notch import NOTCH
from engine.elements._sampler import TIMING
from engine.model.errors import DiagramError


class DiscreteNotch(Discrete):
    """The gain at the notch frequency is the depth, at rest and at the Nyquist frequency it is 1."""

    kind = "discrete_notch"
    title = "Discrete notch filter"
    equation = "N(s) of the continuous notch with s = w/tan(w T/2) (z - 1)/(z + 1), held between samples"
    source = "K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., section 8.2 (prewarping)."
    parameters = (*NOTCH, *TIMING)
    example = {"frequency": 100.0, "depth": 0.1, "width": 0.8, "sample_time": 0.005}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse a notch at the Nyquist frequency or beyond."""
        super().check(given, values)
        frequency, sample_time = values["frequency"].real, values["sample_time"].real
        if frequency * sample_time >= math.pi:
            raise DiagramError(
                f"frequency must be < {math.pi / sample_time:g} rad/s, the Nyquist frequency of a sample_time of {sample_time:g} s, "
                f"got {frequency:g}",
                at=("frequency",),
            )

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def discrete(cls, values: Values) -> Realization:
        """Return the quotient of second order."""
        k: Any = 1 / np.tan(0.5 * values["frequency"] * values["sample_time"])
        width = values["width"] * k
        turned = 2 * (1 - k * k)
        left = values["depth"] * width
        return rational([k * k + left + 1, turned, k * k - left + 1], [k * k + width + 1, turned, k * k - width + 1])
