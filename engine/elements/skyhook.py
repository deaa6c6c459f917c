"""Skyhook law: the damper is hard while it slows the body down, soft while it would drive it.

i = i_on for v_body (v_body - v_base) > 0, i_off else
"""

from __future__ import annotations

from typing import Any

from engine.elements._nonlinear import Moment
from engine.elements._semi_active import OFF, ON, SwitchedCurrent, transition


class Skyhook(SwitchedCurrent):
    """Comes as near as a damper can to one between the body and the sky."""

    kind = "skyhook"
    title = "Skyhook"
    equation = "i = i_on for v_body (v_body - v_base) > 0, i_off else"
    source = "D. Karnopp, M. Crosby, R. Harwood, J. Eng. Ind. 96 (1974) 619-626."
    parameters = (OFF, ON, transition("m**2/s**2"))
    entering = ("velocity", "relative_velocity")

    @classmethod
    def factors(cls, m: Moment) -> tuple[Any, Any]:
        """Return body velocity and relative velocity (body against base)."""
        return m.z[0], m.z[1]
