"""Notch filter against one resonance.

y/u = (s² + depth width w s + w²) / (s² + width w s + w²)
"""

from __future__ import annotations

from engine.elements._base import Element, Ports, Realization, Values
from engine.elements._biquad import biquad
from engine.elements._notch import NOTCH


class Notch(Element):
    """Band-stop of second order that leaves the gain at rest and at high frequencies at 1.

    The gain at the notch frequency is the depth. A mode with damping ratio z is cancelled by depth·width = 2 z.
    """

    kind = "notch"
    title = "Notch filter"
    equation = "y/u = (s² + depth·width·w·s + w²) / (s² + width·w·s + w²)"
    source = "G. Ellis, Control System Design Guide, Butterworth-Heinemann 2012, section 9.2."
    parameters = NOTCH
    example = {"frequency": 300.0, "depth": 0.1, "width": 0.8}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return one input and one output."""
        return Ports()

    @classmethod
    def realize(cls, values: Values) -> Realization:
        """Return the quotient over the notch frequency."""
        width = values["width"]
        return biquad(1.0, values["depth"] * width, 1.0, frequency=values["frequency"], damping_ratio=0.5 * width)
