"""Groundhook law: the damper is hard while it slows the base down, soft while it would drive it.

i = i_on for -v_base (v_body - v_base) > 0, i_off else
"""

from __future__ import annotations

from typing import Any

from engine.elements._nonlinear import Moment
from engine.elements._semi_active import OFF, ON, SwitchedCurrent, transition


class Groundhook(SwitchedCurrent):
    """Comes as near as a damper can to one between the base and the ground."""

    kind = "groundhook"
    title = "Groundhook"
    equation = "i = i_on for -v_base (v_body - v_base) > 0, i_off else"
    source = "M. Valášek, M. Novák, Z. Šika, O. Vaculín, Vehicle System Dynamics 27 (1997) 289-303."
    parameters = (OFF, ON, transition("m**2/s**2"))
    entering = ("base_velocity", "relative_velocity")

    @classmethod
    def factors(cls, m: Moment) -> tuple[Any, Any]:
        """Return the negative base velocity, and the relative velocity (body against base)."""
        return -m.z[0], m.z[1]
