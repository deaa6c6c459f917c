"""Clipped-optimal law: full current while the damper's force is to grow towards the force wanted.

i = i_on for (f_wanted - f) f > 0, i_off else
"""

from __future__ import annotations

from typing import Any

from engine.elements._nonlinear import Moment
from engine.elements._semi_active import OFF, ON, SwitchedCurrent, transition


class ClippedOptimal(SwitchedCurrent):
    """Makes a damper follow a force that another law wants, as far as a damper can."""

    kind = "clipped_optimal"
    title = "Clipped optimal"
    equation = "i = i_on for (f_wanted - f) f > 0, i_off else"
    source = "S. Dyke, B. Spencer, M. Sain, J. Carlson, Smart Mater. Struct. 5 (1996) 565-575."
    parameters = (OFF, ON, transition("N**2"))
    entering = ("wanted_force", "force")

    @classmethod
    def factors(cls, m: Moment) -> tuple[Any, Any]:
        """Return what is missing of the force, and the force."""
        return m.z[0] - m.z[1], m.z[1]
