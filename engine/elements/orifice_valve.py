"""Four-way spool valve: flow through sharp-edged orifices, with the spool's ends and overlap.

Q = C_d w o sqrt(2 Δp/ρ),   o = min(|x_s|, x_max) - x_0, shut below 0;   Q ~ Δp for Δp below p_l
"""

from __future__ import annotations

from typing import Any

from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Signals
from engine.model.errors import DiagramError
from engine.model.parameters import Param


class OrificeValve(NonlinearElement):
    """Flows into both chambers of a cylinder; a positive spool lets a be fed and b drain.

    sqrt(Δp) is written as Δp/(Δp² + p_l²)^(1/4), which is laminar flow for small differences and has a slope everywhere.
    """

    kind = "orifice_valve"
    title = "Spool valve with orifice flow"
    equation = "Q = C_d w o Δp sqrt(2/ρ)/(Δp² + p_l²)^(1/4);  o = min(|x_s|, x_max) - x_0, 0 where that is negative"
    source = "H. E. Merritt, Hydraulic Control Systems, Wiley 1967, chapters 3 and 5."
    modes = (-2, -1, 0, 1, 2)
    parameters = (
        Param(name="discharge_coefficient", symbol="C_d", unit="1", default=0.62, lower=0.0, lower_open=True,
              doc="contraction of the jet"),
        Param(name="area_gradient", symbol="w", unit="m", default=0.02, lower=0.0, lower_open=True, scale="log",
              doc="orifice area per spool travel"),
        Param(name="density", symbol="ρ", unit="kg/m**3", default=870.0, lower=0.0, lower_open=True,
              doc="density of the oil"),
        Param(name="stroke", symbol="x_max", unit="m", default=1e-3, lower=0.0, lower_open=True, scale="log",
              doc="greatest spool travel to either side"),
        Param(name="overlap", symbol="x_0", unit="m", default=0.0, lower=0.0, doc="spool travel before a port opens"),
        Param(name="supply_pressure", symbol="p_s", unit="Pa", default=10e6, lower=0.0, doc="pressure of the supply"),
        Param(name="tank_pressure", symbol="p_t", unit="Pa", default=0.0, lower=0.0, doc="pressure of the tank"),
        Param(name="laminar_pressure", symbol="p_l", unit="Pa", default=1e4, lower=0.0, lower_open=True, scale="log",
              doc="difference of pressure below which the flow is laminar"),
    )  # fmt: skip
    example = {"overlap": 1e-5, "tank_pressure": 1e5}

    @classmethod
    def check(cls, given: frozenset[str], values: Values) -> None:
        """Refuse an overlap that never opens."""
        if values["overlap"].real >= values["stroke"].real:
            limit, got = values["stroke"].real, values["overlap"].real
            raise DiagramError(f"overlap must be < stroke ({limit:g} m), got {got:g}", at=("overlap",))

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return spool and both pressures; both flows."""
        return Ports(
            inputs=("spool", "pressure_a", "pressure_b"),
            outputs=("flow_a", "flow_b"),
            output_units=("m**3/s", "m**3/s"),
        )

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the flows through the two edges that are open; modes ±1 open, ±2 fully open, 0 covered."""
        spool, a, b = m.z
        if mode == 0:
            return [0.0 * spool, 0.0 * spool]
        travel = spool if abs(mode) == 1 else (1 if mode > 0 else -1) * values["stroke"] + 0.0 * spool
        opening = travel - (values["overlap"] if mode > 0 else -values["overlap"])
        supply, tank = values["supply_pressure"], values["tank_pressure"]
        if mode > 0:
            return [cls._flow(opening, supply - a, values), -cls._flow(opening, b - tank, values)]
        return [cls._flow(opening, a - tank, values), -cls._flow(opening, supply - b, values)]

    @classmethod
    def _flow(cls, opening: Any, difference: Any, values: Values) -> Any:
        gain = values["discharge_coefficient"] * values["area_gradient"] * (2.0 / values["density"]) ** 0.5
        return gain * opening * difference / (difference**2 + values["laminar_pressure"] ** 2) ** 0.25

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return how far the spool is beyond the edges of its range."""
        spool = m.z[0]
        if mode == 0:
            return [spool - values["overlap"], -values["overlap"] - spool]
        side = spool if mode > 0 else -spool
        if abs(mode) == 1:
            return [values["overlap"] - side, side - values["stroke"]]
        return [values["stroke"] - side]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the neighbouring range."""
        if mode == 0:
            return Change(mode=(1, -1)[guard])
        side = 1 if mode > 0 else -1
        return Change(mode=(0, 2 * side)[guard] if abs(mode) == 1 else side)
