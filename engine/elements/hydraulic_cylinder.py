"""Hydraulic cylinder with two chambers, the compressibility of the oil, leakage between them, and end stops.

p_a' = (β/V_a) (Q_a - A_a v - c (p_a - p_b)),   p_b' = (β/V_b) (Q_b + A_b v + c (p_a - p_b))
m v' = A_a p_a - A_b p_b - b v - F,   V_a = V_0a + A_a x,   V_b = V_0b + A_b (L - x),   0 <= x <= L
"""

from __future__ import annotations

from typing import Any

import numpy as np

from engine.elements import _end_stops as ends
from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals
from engine.model.parameters import Param


class HydraulicCylinder(NonlinearElement):
    """Flows into both chambers and a load, which opposes the motion where it is positive.

    The volumes follow the position, so that stiffness and natural frequency do, too. Friction of the seals is a block
    of its own, from the velocity to the force. There is no cavitation: pressures are those of the equations.
    """

    kind = "hydraulic_cylinder"
    title = "Hydraulic cylinder, two chambers"
    equation = (
        "p_a' = (β/V_a)(Q_a - A_a v - c (p_a - p_b));  p_b' = (β/V_b)(Q_b + A_b v + c (p_a - p_b));  "
        "m v' = A_a p_a - A_b p_b - b v - F"
    )
    source = "M. Jelali, A. Kroll, Hydraulic Servo-systems, Springer 2003, chapter 4; H. E. Merritt, Wiley 1967."
    states = ("position", "velocity", "pressure_a", "pressure_b")
    modes = (ends.FREE, ends.UPPER, ends.LOWER)
    parameters = (
        Param(name="area_a", symbol="A_a", unit="m**2", default=2e-3, lower=0.0, lower_open=True, scale="log",
              doc="piston area that pushes forward"),
        Param(name="area_b", symbol="A_b", unit="m**2", default=1.2e-3, lower=0.0, lower_open=True, scale="log",
              doc="piston area that pushes back"),
        ends.STROKE,
        Param(name="dead_volume_a", symbol="V_0a", unit="m**3", default=1e-4, lower=0.0, lower_open=True, scale="log",
              doc="volume of chamber a and its pipes at the lower end"),
        Param(name="dead_volume_b", symbol="V_0b", unit="m**3", default=1e-4, lower=0.0, lower_open=True, scale="log",
              doc="volume of chamber b and its pipes at the upper end"),
        Param(name="bulk_modulus", symbol="β", unit="Pa", default=1e9, lower=0.0, lower_open=True, scale="log",
              doc="effective bulk modulus of the oil"),
        Param(name="leakage", symbol="c", unit="m**3/(s*Pa)", default=0.0, lower=0.0, doc="flow between the chambers"),
        Param(name="mass", symbol="m", unit="kg", default=100.0, lower=0.0, lower_open=True, scale="log",
              doc="moving mass"),
        Param(name="viscous_friction", symbol="b", unit="N*s/m", default=500.0, lower=0.0, doc="friction per velocity"),
        ends.RESTITUTION,
        ends.POSITION,
        Param(name="initial_pressure_a", symbol="p_a0", unit="Pa", default=3e6, lower=0.0,
              doc="pressure of chamber a at the beginning"),
        Param(name="initial_pressure_b", symbol="p_b0", unit="Pa", required=False, lower=0.0,
              doc="pressure of chamber b at the beginning; absent: in balance with that of a"),
    )  # fmt: skip
    example = {"leakage": 1e-12}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return both flows and the load; the motion and both pressures."""
        return Ports(
            inputs=("flow_a", "flow_b", "force"),
            outputs=("position", "velocity", "acceleration", "pressure_a", "pressure_b"),
            output_units=("m", "m/s", "m/s**2", "Pa", "Pa"),
            loads=("force",),
            input_units=("m**3/s", "m**3/s", "N"),
        )

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return that the load acts on the acceleration at once."""
        return np.array([[row == 2 and column == 2 for column in range(3)] for row in range(5)])

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return a piston at rest, its chambers under pressure."""
        a, b = values["initial_pressure_a"], values["initial_pressure_b"]
        return [ends.start(values), 0.0, a, a * values["area_a"] / values["area_b"] if b is None else b]

    @classmethod
    def _force(cls, m: Moment, values: Values) -> Any:
        _, v, a, b = m.x
        return values["area_a"] * a - values["area_b"] * b - values["viscous_friction"] * v - m.z[2]

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return velocity, acceleration and both rates of pressure."""
        x, v, a, b = m.x
        dx, dv = ends.moves(mode, v, cls._force(m, values), values["mass"])
        volume_a = values["dead_volume_a"] + values["area_a"] * x
        volume_b = values["dead_volume_b"] + values["area_b"] * (values["stroke"] - x)
        leak = values["leakage"] * (a - b)
        da = values["bulk_modulus"] / volume_a * (m.z[0] - values["area_a"] * v - leak)
        db = values["bulk_modulus"] / volume_b * (m.z[1] + values["area_b"] * v + leak)
        return [dx, dv, da, db]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the motion and both pressures."""
        x, v, a, b = m.x
        _, dv = ends.moves(mode, v, cls._force(m, values), values["mass"])
        return [x, v, dv, a, b]

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the piston is beyond its ends, or how hard it is pulled away from one."""
        return ends.guards(mode, m.x[0], cls._force(m, values), values)

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return an impact, or the piston leaving its end."""
        stop, position, velocity = ends.switch(guard, mode, m.x[1], values)
        return Change(mode=stop, x=[m.x[0] if position is None else position, velocity, *m.x[2:]])
