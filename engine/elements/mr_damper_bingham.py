"""Magneto-rheological damper: Bingham's plastic, smoothed where it yields.

F = f_y tanh(v/v_t) + c v + f_0
"""

from __future__ import annotations

import numpy as np

from engine.elements import _magnetorheological as mr
from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Mode, Moment, NonlinearElement, Signals
from engine.model.parameters import Param


class MrDamperBingham(NonlinearElement):
    """Force of the damper on what moves it, positive against the motion; without hysteresis."""

    kind = "mr_damper_bingham"
    title = "MR damper, Bingham"
    equation = "F = f_y tanh(v/v_t) + c v + f_0"
    source = "R. Stanway, J. Sproston, N. Stevens, J. Electrostatics 20 (1987) 167-184, with tanh in place of the sign."
    note = "the damper is linearised with its slope at rest, f_y/v_t + c"
    parameters = (
        mr.coefficient("yield_force", "f_y", "N", None, "dry part"),
        mr.coefficient("damping", "c", "N*s/m", None, "viscous part"),
        Param(
            name="transition_velocity", symbol="v_t", unit="m/s", lower=0.0, lower_open=True, scale="log",
            doc="velocity over which the dry part builds up",
        ),
        Param(name="offset", symbol="f_0", unit="N", default=0.0, doc="force of the accumulator"),
    )  # fmt: skip
    example = {"yield_force": [60.0, 700.0], "damping": [800.0, 900.0], "transition_velocity": 0.4}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse polynomials of a wrong length."""
        mr.check(values, "yield_force", "damping")

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the velocity, and the current where a coefficient follows it; the force."""
        driven = max(len(values["yield_force"]), len(values["damping"])) > 1
        inputs = ("velocity", "current") if driven else ("velocity",)
        return Ports(inputs=inputs, outputs=("force",), output_units=("N",))

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the force."""
        v, i = m.z[0], m.z[1] if len(m.z) > 1 else 0.0
        dry = mr.at_current(values, "yield_force", i) * np.tanh(v / values["transition_velocity"])
        return [dry + mr.at_current(values, "damping", i) * v + values["offset"]]
