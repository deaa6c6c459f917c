"""Magneto-rheological damper: the modified Bouc-Wen model.

y' = (α z + c0 x' + k0 (x - y)) / (c0 + c1),   z' = -γ |w| z |z|^(n-1) - β w |z|^n + A w,  w = x' - y'
f = c1 y' + k1 (x - x0)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from engine.elements import _magnetorheological as mr
from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals, first
from engine.model.parameters import Param

_BACKWARD, _NEGATIVE = 1, 2  # bits of the mode: w < 0, z < 0


class MrDamperSpencer(NonlinearElement):
    """Force of the damper on what moves it, positive against the motion.

    α, c0, c1, k0 are polynomials of the current in the coil, which follows the current given with a first-order lag. The
    published printing of the first term of z' without the factor z is not odd in the motion and drifts; this is the odd
    one. The published fits hold for currents of one sign up to their largest tested value.
    """

    kind = "mr_damper_spencer"
    title = "MR damper, modified Bouc-Wen"
    equation = (
        "f = c1 y' + k1 (x - x0);  y' = (α z + c0 x' + k0 (x - y))/(c0 + c1);  "
        "z' = -γ |x' - y'| z |z|^(n-1) - β (x' - y') |z|^n + A (x' - y')"
    )
    source = "B. Spencer, S. Dyke, M. Sain, J. Carlson, J. Eng. Mech. 123 (1997) 230-238."
    note = "the damper is linearised with its slopes at rest, where the hysteresis is a spring"
    states = ("y", "z", "coil")
    modes = (0, 1, 2, 3)
    parameters = (
        mr.coefficient("alpha", "α", "N/m", [17e3, 20e3], "stiffness of the hysteresis"),
        mr.coefficient("c0", "c_0", "N*s/m", [2.1e3, 3.5e3], "damping at high velocities"),
        mr.coefficient("c1", "c_1", "N*s/m", [28e3, 29e3], "damping of the roll-off at low velocities"),
        mr.coefficient("k0", "k_0", "N/m", [4690.0], "stiffness at high velocities"),
        Param(name="k1", symbol="k_1", unit="N/m", default=500.0, lower=0.0, doc="stiffness of the accumulator"),
        Param(name="x0", symbol="x_0", unit="m", default=0.0, doc="displacement at which the accumulator is at rest"),
        Param(name="gamma", symbol="γ", default=3.63e6, lower=0.0, doc="shape of the hysteresis at no current, 1/m^n"),
        Param(name="gamma_rate", symbol="g", default=0.0, doc="γ = gamma exp(gamma_rate i), 1/A"),
        Param(name="beta", symbol="β", required=False, doc="shape of the hysteresis, 1/m^n; absent: equal to γ"),
        Param(name="A", symbol="A", unit="1", default=301.0, doc="slope of the hysteresis at its beginning"),
        Param(name="n", symbol="n", unit="1", default=2.0, lower=1.0, doc="sharpness of the yield"),
        Param(
            name="coil_time_constant", symbol="τ", unit="s", default=0.0, lower=0.0,
            doc="lag of the current in the coil behind the current given; 0: none",
        ),
    )  # fmt: skip
    example = {"gamma_rate": -0.5, "coil_time_constant": 0.005}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse polynomials of a wrong length."""
        mr.check(values, "alpha", "c0", "c1", "k0")

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return displacement, velocity and current; the force."""
        return Ports(inputs=("displacement", "velocity", "current"), outputs=("force",), output_units=("N",))

    @classmethod
    def _inner(cls, m: Moment, values: Values) -> tuple[Any, Any, Any]:
        """Return the coil current, y' and c1."""
        x, v, given = m.z
        y, z, coil = m.x
        i = coil if np.any(values["coil_time_constant"]) else given
        c0, c1 = mr.at_current(values, "c0", i), mr.at_current(values, "c1", i)
        alpha, k0 = mr.at_current(values, "alpha", i), mr.at_current(values, "k0", i)
        return i, (alpha * z + c0 * v + k0 * (x - y)) / (c0 + c1), c1

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the directions of the relative motion and of the hysteresis."""
        slip = m.z[1] - cls._inner(m, values)[1]
        return (_BACKWARD if first(slip) < 0 else 0) + (_NEGATIVE if first(m.x[1]) < 0 else 0)

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return y', z' and the coil's lag."""
        i, dy, _ = cls._inner(m, values)
        w = m.z[1] - dy
        z = m.x[1]
        gamma = values["gamma"] * np.exp(values["gamma_rate"] * i)
        beta = gamma if values["beta"] is None else values["beta"]
        sign = -1.0 if mode & _NEGATIVE else 1.0
        size = sign * z
        power = np.where(np.real(size) > 0, size, 0.0) ** values["n"]
        speed = -w if mode & _BACKWARD else w
        dz = -gamma * speed * sign * power - beta * w * power + values["A"] * w
        lag = values["coil_time_constant"]
        return [dy, dz, (m.z[2] - m.x[2]) / lag if np.any(lag) else 0.0 * m.z[2]]

    @classmethod
    def unrest(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the rates; a coil without lag carries the current given."""
        dy, dz, coil = cls.rates(m, mode, values)
        return [dy, dz, coil if np.any(values["coil_time_constant"]) else m.z[2] - m.x[2]]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the force."""
        _, dy, c1 = cls._inner(m, values)
        return [c1 * dy + values["k1"] * (m.z[0] - values["x0"])]

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the relative motion and the hysteresis have turned round."""
        slip = m.z[1] - cls._inner(m, values)[1]
        return [slip if mode & _BACKWARD else -slip, m.x[1] if mode & _NEGATIVE else -m.x[1]]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the other direction."""
        return Change(mode=mode ^ (_BACKWARD, _NEGATIVE)[guard])
