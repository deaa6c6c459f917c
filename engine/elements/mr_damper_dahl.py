"""Magneto-rheological damper: viscous friction and Dahl's hysteresis.

F = K_x v + K_w w,   w' = ρ (v - |v| w)
"""

from __future__ import annotations

from engine.elements import _magnetorheological as mr
from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals, first
from engine.model.parameters import Param


class MrDamperDahl(NonlinearElement):
    """Force of the damper on what moves it, positive against the motion; |w| <= 1 for ever when it begins so."""

    kind = "mr_damper_dahl"
    title = "MR damper, Dahl"
    equation = "F = K_x v + K_w w,  w' = ρ (v - |v| w)"
    source = "N. Aguirre et al., Viscous + Dahl model for MR dampers, IFAC Proc. Vol. 41 (2008) 4096-4101."
    note = "the damper is linearised with its slopes at rest, where the hysteresis is a spring"
    states = ("w",)
    modes = (1, -1)
    parameters = (
        mr.coefficient("damping", "K_x", "N*s/m", None, "viscous part"),
        mr.coefficient("friction", "K_w", "N", None, "dry part"),
        Param(
            name="rho", symbol="ρ", unit="1/m", lower=0.0, lower_open=True, scale="log",
            doc="steepness of the hysteresis: it builds up over a distance of 1/ρ",
        ),
    )  # fmt: skip
    example = {"damping": [768.0, 900.0], "friction": [57.0, 400.0], "rho": 2700.0}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse polynomials of a wrong length."""
        mr.check(values, "damping", "friction")

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return the velocity, and the current where a coefficient follows it; the force."""
        driven = max(len(values["damping"]), len(values["friction"])) > 1
        inputs = ("velocity", "current") if driven else ("velocity",)
        return Ports(inputs=inputs, outputs=("force",), output_units=("N",))

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the direction of the motion."""
        return -1 if first(m.z[0]) < 0 else 1

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return w'."""
        v = m.z[0]
        return [values["rho"] * (v - mode * v * m.x[0])]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the force."""
        i = m.z[1] if len(m.z) > 1 else 0.0
        return [mr.at_current(values, "damping", i) * m.z[0] + mr.at_current(values, "friction", i) * m.x[0]]

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the motion has turned round."""
        return [-mode * m.z[0]]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the other direction."""
        return Change(mode=-mode)
