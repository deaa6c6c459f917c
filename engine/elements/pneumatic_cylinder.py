"""Pneumatic cylinder with its valve: two adiabatic chambers filled and emptied through orifices that may be choked.

V p' = κ (R T_in m'_in - R T m'_out - p V'),   m' = C ρ_0 p_1 sqrt(T_0/T_1) ψ(p_2/p_1)
ψ = 1 (p_2/p_1 <= b),  sqrt(1 - ((p_2/p_1 - b)/(1 - b))²) else;   m v' = A_a p_a - A_b p_b - A_r p_0 - b_v v - F
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from engine.elements import _end_stops as ends
from engine.elements._base import Ports, Values
from engine.elements._nonlinear import Change, Mode, Moment, NonlinearElement, Pattern, Signals, first
from engine.model.parameters import Param

GAS: Final = 287.05  # specific gas constant of air, J/(kg K)
NORMAL_DENSITY: Final = 1.185  # of air at the reference state of ISO 6358 (20 °C, 1 bar, 65 %), kg/m³
NORMAL_TEMPERATURE: Final = 293.15  # K

_LAMINAR: Final = 0.01
"""Relative difference of pressure below which the flow is proportional to it (ISO 6358 leaves this range open)."""

_REVERSED: Final = 1e-7
"""Relative difference of pressure at which a flow counts as reversed: below it, its temperature moves nothing."""

_CHOKED, _FAST, _SLOW = 3, 2, 1
_STATES = (-_CHOKED, -_FAST, -_SLOW, _SLOW, _FAST, _CHOKED)


class PneumaticCylinder(NonlinearElement):
    """A command from -1 to 1 opens the valve: positive feeds a and empties b. A positive force opposes the motion.

    The mode tells where the piston is, which way the valve is open, and whether each of the two flows goes in or out,
    is laminar, subsonic or choked.
    """

    kind = "pneumatic_cylinder"
    title = "Pneumatic cylinder with valve"
    equation = (
        "V p' = κ (R T_in m'_in - R T m'_out - p V');  m' = C ρ_0 p_1 sqrt(T_0/T_1) ψ(p_2/p_1);  "
        "ψ(r) = 1 (r <= b), sqrt(1 - ((r - b)/(1 - b))²) (b < r <= 0.99), ψ(0.99) (1 - r)/0.01 (r > 0.99);  "
        "m v' = A_a p_a - A_b p_b - (A_a - A_b) p_0 - b_v v - F;  "
        "air: R = 287.05 J/(kg K), ρ_0 = 1.185 kg/m³ at T_0 = 293.15 K"
    )
    source = "ISO 6358-1:2013 (flow); P. Beater, Pneumatic Drives, Springer 2007, chapters 3 and 5."
    states = ("position", "velocity", "pressure_a", "pressure_b", "air_a", "air_b")
    modes = tuple(
        stop + 3 * way + 6 * a + 36 * b for stop, way, a, b in ((0, 0, 4, 1), (0, 0, 5, 0), (1, 0, 3, 2), (2, 1, 1, 4))
    )
    note = "the cylinder is linearised with its slopes at rest"
    parameters = (
        Param(name="area_a", symbol="A_a", unit="m**2", default=8e-4, lower=0.0, lower_open=True, scale="log",
              doc="piston area that pushes forward"),
        Param(name="area_b", symbol="A_b", unit="m**2", default=6.9e-4, lower=0.0, lower_open=True, scale="log",
              doc="piston area that pushes back"),
        ends.STROKE,
        Param(name="dead_volume_a", symbol="V_0a", unit="m**3", default=2e-5, lower=0.0, lower_open=True, scale="log",
              doc="volume of chamber a and its hose at the lower end"),
        Param(name="dead_volume_b", symbol="V_0b", unit="m**3", default=2e-5, lower=0.0, lower_open=True, scale="log",
              doc="volume of chamber b and its hose at the upper end"),
        Param(name="mass", symbol="m", unit="kg", default=5.0, lower=0.0, lower_open=True, scale="log",
              doc="moving mass"),
        Param(name="viscous_friction", symbol="b_v", unit="N*s/m", default=50.0, lower=0.0,
              doc="friction per velocity"),
        Param(name="sonic_conductance", symbol="C", unit="m**3/(s*Pa)", default=2e-8, lower=0.0, lower_open=True,
              scale="log", doc="of the valve fully open, to ISO 6358"),
        Param(name="critical_ratio", symbol="b", unit="1", default=0.3, lower=0.0, upper=0.9,
              doc="ratio of pressures below which the flow is choked"),
        Param(name="supply_pressure", symbol="p_s", unit="Pa", default=7e5, lower=0.0, lower_open=True,
              doc="absolute pressure of the supply"),
        Param(name="ambient_pressure", symbol="p_0", unit="Pa", default=1e5, lower=0.0, lower_open=True,
              doc="absolute pressure around"),
        Param(name="temperature", symbol="T_s", unit="K", default=293.15, lower=0.0, lower_open=True,
              doc="temperature of the supply, and of the air at the beginning"),
        Param(name="adiabatic_index", symbol="κ", unit="1", default=1.4, lower=1.0, doc="ratio of the specific heats"),
        ends.RESTITUTION,
        ends.POSITION,
        Param(name="initial_pressure_a", symbol="p_a0", unit="Pa", default=3e5, lower=0.0, lower_open=True,
              doc="absolute pressure of chamber a at the beginning"),
        Param(name="initial_pressure_b", symbol="p_b0", unit="Pa", required=False, lower=0.0, lower_open=True,
              doc="absolute pressure of chamber b at the beginning; absent: in balance with that of a"),
    )  # fmt: skip
    example = {"restitution": 0.2}

    @classmethod
    def ports(cls, values: Values) -> Ports:
        """Return command and load; the motion and both pressures."""
        return Ports(
            inputs=("command", "force"),
            outputs=("position", "velocity", "acceleration", "pressure_a", "pressure_b"),
            output_units=("m", "m/s", "m/s**2", "Pa", "Pa"),
            loads=("force",),
            input_units=(None, "N"),
        )

    @classmethod
    def feed_through(cls, values: Values) -> Pattern:
        """Return that the load acts on the acceleration at once."""
        return np.array([[row == 2 and column == 1 for column in range(2)] for row in range(5)])

    @classmethod
    def _volumes(cls, x: Any, values: Values) -> tuple[Any, Any]:
        volume_b = values["dead_volume_b"] + values["area_b"] * (values["stroke"] - x)
        return values["dead_volume_a"] + values["area_a"] * x, volume_b

    @classmethod
    def initial(cls, values: Values) -> Signals:
        """Return a piston at rest, its chambers under pressure at the temperature of the supply."""
        x, a, b = ends.start(values), values["initial_pressure_a"], values["initial_pressure_b"]
        if b is None:
            rod = values["area_a"] - values["area_b"]
            b = (values["area_a"] * a - rod * values["ambient_pressure"]) / values["area_b"]
        volumes = cls._volumes(x, values)
        air = [p * volume / (GAS * values["temperature"]) for p, volume in zip((a, b), volumes, strict=True)]
        return [x, 0.0, a, b, *air]

    @classmethod
    def start(cls, m: Moment, values: Values) -> Mode:
        """Return the mode that fits the pressures and the command."""
        way = 1 if first(m.z[0]) < 0 else 0
        outside = cls._outside(way, values)
        edges = [
            _STATES.index(_edge(_drop(first(p), first(c)), values)) for p, c in zip(outside, m.x[2:4], strict=True)
        ]
        return 3 * way + 6 * edges[0] + 36 * edges[1]

    @classmethod
    def _outside(cls, way: int, values: Values) -> tuple[Any, Any]:
        """Return what the valve joins each chamber to."""
        supply, ambient = values["supply_pressure"], values["ambient_pressure"]
        return (ambient, supply) if way else (supply, ambient)

    @classmethod
    def _force(cls, m: Moment, values: Values) -> Any:
        _, v, a, b = m.x[:4]
        rod = (values["area_a"] - values["area_b"]) * values["ambient_pressure"]
        return values["area_a"] * a - values["area_b"] * b - rod - values["viscous_friction"] * v - m.z[1]

    @classmethod
    def rates(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return velocity, acceleration, rates of pressure and flows of air."""
        x, v, a, b, air_a, air_b = m.x
        stop, way, edges = _parts(mode)
        dx, dv = ends.moves(stop, v, cls._force(m, values), values["mass"])
        opening = (-m.z[0] if way else m.z[0]) * values["sonic_conductance"] * NORMAL_DENSITY
        volumes, growth = cls._volumes(x, values), (values["area_a"] * dx, -values["area_b"] * dx)
        kappa = values["adiabatic_index"]
        rises, flows = [], []
        for p, air, volume, grows, outside, edge in zip(
            (a, b), (air_a, air_b), volumes, growth, cls._outside(way, values), edges, strict=True
        ):
            heat = p * volume / air if edge < 0 else GAS * values["temperature"]  # R T of what flows
            flow = opening * (NORMAL_TEMPERATURE * GAS / heat) ** 0.5 * _conducted(outside, p, edge, values)
            flows.append(flow)
            rises.append(kappa / volume * (heat * flow - p * grows))
        return [dx, dv, *rises, *flows]

    @classmethod
    def outputs(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return the motion and both pressures."""
        x, v, a, b = m.x[:4]
        _, dv = ends.moves(_parts(mode)[0], v, cls._force(m, values), values["mass"])
        return [x, v, dv, a, b]

    @classmethod
    def guards(cls, m: Moment, mode: Mode, values: Values) -> Signals:
        """Return what ends the mode: the command's sign, both edges up and down, and the piston's place."""
        stop, way, edges = _parts(mode)
        found = [m.z[0] if way else -m.z[0]]
        for p, outside, edge in zip(m.x[2:4], cls._outside(way, values), edges, strict=True):
            found.extend(_beyond(outside, p, edge, values))
        return [*found, *ends.guards(stop, m.x[0], cls._force(m, values), values)]

    @classmethod
    def switch(cls, guard: int, m: Moment, mode: Mode, values: Values) -> Change:
        """Return the neighbouring mode."""
        stop, way, edges = _parts(mode)
        places = [_STATES.index(edge) for edge in edges]
        if guard == 0:
            return Change(mode=cls.start(Moment(t=m.t, x=m.x, z=[1.0 if way else -1.0, m.z[1]]), values) + stop)
        if guard <= 4:
            places[(guard - 1) // 2] += -1 if guard % 2 == 0 else 1
            return Change(mode=stop + 3 * way + 6 * places[0] + 36 * places[1])
        new, position, velocity = ends.switch(guard - 5, stop, m.x[1], values)
        states = [m.x[0] if position is None else position, velocity, *m.x[2:]]
        return Change(mode=new + 3 * way + 6 * places[0] + 36 * places[1], x=states)


def _parts(mode: Mode) -> tuple[int, int, tuple[int, int]]:
    """Return the piston's place, the way of the valve, and the states of both flows."""
    return mode % 3, mode // 3 % 2, (_STATES[mode // 6 % 6], _STATES[mode // 36])


def _drop(outside: Any, inside: Any) -> float:
    """Return the relative difference of pressure, positive inwards."""
    return float(1 - inside / outside if outside >= inside else outside / inside - 1)


def _edge(drop: float, values: Values) -> int:
    size = abs(drop)
    state = _SLOW if size <= _LAMINAR else _FAST if size <= 1 - first(values["critical_ratio"]) else _CHOKED
    return state if drop >= 0 else -state


def _conducted(outside: Any, inside: Any, edge: int, values: Values) -> Any:
    """Return p_1 ψ(p_2/p_1), positive inwards."""
    b = values["critical_ratio"]
    if abs(edge) == _SLOW:
        return (outside - inside) / _LAMINAR * (1 - ((1 - _LAMINAR - b) / (1 - b)) ** 2) ** 0.5
    high, low = (outside, inside) if edge > 0 else (inside, outside)
    flow = high if abs(edge) == _CHOKED else high * (1 - ((low / high - b) / (1 - b)) ** 2) ** 0.5
    return flow if edge > 0 else -flow


def _beyond(outside: Any, inside: Any, edge: int, values: Values) -> list[Any]:
    """Return how far a flow is above and below its range of relative differences of pressure."""
    drop = 1 - inside / outside if edge > 0 else outside / inside - 1
    levels = (-_REVERSED, _LAMINAR, 1 - values["critical_ratio"])
    upper = levels[edge] if 0 < edge < _CHOKED else -levels[-edge - 1] if edge < 0 else None
    lower = levels[edge - 1] if edge > 0 else -levels[-edge] if -edge < _CHOKED else None
    return [-1.0 if upper is None else drop - upper, -1.0 if lower is None else lower - drop]
