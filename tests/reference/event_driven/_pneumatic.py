"""A pneumatic axis: gain, limit, lag of the valve, two chambers with flows that may be choked, friction.

c' = (lim(kp (r - x) - kv v) - c)/T,   m' = C ρ_0 p_1 sqrt(T_0/T_1) ψ(p_2/p_1),   V p' = κ (R T_in m'_in - R T m'_out - p V')
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.reference.event_driven._loop import Command, Friction, Limit, Loop, between, choose, random_friction
from tests.unit.engine.diagrams import block

GAS, KAPPA, NORMAL, DENSITY = 287.05, 1.4, 293.15, 1.185
SUPPLY, AMBIENT, CRITICAL, LAMINAR = 7e5, 1e5, 0.3, 0.01
REVERSED = 1e-7
"""A flow takes the temperature of the other side when it is so far beyond balance: the block says so."""
STROKE, DEAD = 0.5, 2e-5


class Pneumatic(Loop):
    """States x, v, p_a, p_b, air in both, c."""

    names = ("x", "v", "pa", "pb", "c")

    def __init__(self, p: dict[str, Any], command: Command) -> None:
        super().__init__(p, command)
        self.friction, self.limit = Friction(p["friction"]), Limit(-1.0, 1.0)
        self.side = 1
        pb = (p["area_a"] * p["pa"] - (p["area_a"] - p["area_b"]) * AMBIENT) / p["area_b"]
        x = p["x0"]
        air = [q * v / (GAS * NORMAL) for q, v in zip((p["pa"], pb), self.volumes(x), strict=True)]
        self.start, self.scale = [x, 0.0, p["pa"], pb, *air, 0.0], [0.1, 0.1, 1e5, 1e5, 1e-4, 1e-4, 1.0]
        self.duration = p["duration"]
        self.zones = [self.zone(drop) for drop in self.drops(np.array(self.start))]
        self._set()

    @classmethod
    def random(cls, rng: np.random.Generator) -> Pneumatic:
        """Return an axis that reaches its target, a ramp or a sine, within the stroke."""
        area = between(rng, 3e-4, 2e-3)
        force = area * SUPPLY
        kind = choose(rng, "step", "ramp", "sine")
        way = float(rng.uniform(0.03, 0.15)) * float(choose(rng, -1.0, 1.0))
        p = {
            "area_a": area, "area_b": area * float(rng.uniform(0.7, 1.0)), "mass": between(rng, 2.0, 20.0),
            "viscous_friction": float(choose(rng, 0.0, 50.0)), "sonic_conductance": between(rng, 5e-9, 4e-8), "x0": 0.25,
            "pa": float(choose(rng, 3e5, rng.uniform(2e5, 6e5))), "kp": between(rng, 2.0, 10.0), "kv": between(rng, 0.3, 1.0),
            "T": between(rng, 3e-3, 2e-2), "friction": random_friction(rng, force * between(rng, 0.01, 0.08), 0.2),
            "duration": float(rng.uniform(0.4, 0.9)),
        }  # fmt: skip
        size = {"step": 0.25 + way, "ramp": way, "sine": way}[kind]
        p["offset"] = 0.0 if kind == "step" else 0.25
        return cls(p, Command(kind=kind, size=size, frequency=between(rng, 3.0, 15.0)))

    def document(self) -> tuple[dict[str, Any], list[str], dict[str, str]]:
        """Return the loop of blocks; the offset is the position at which the command is 0."""
        p = self.p
        own = {name: p[name] for name in ("area_a", "area_b", "mass", "viscous_friction", "sonic_conductance")}
        blocks = {
            "at": block("passive_on", current=p["offset"]), "e": block("sum", signs="++-"), "kp": block("gain", gain=p["kp"]),
            "kv": block("gain", gain=p["kv"]), "u": block("sum", signs="+-"), "lim": block("saturation"),
            "c": block("transfer_function", numerator=[1.0], denominator=[p["T"], 1.0]),
            "p": block("pneumatic_cylinder", initial_position=p["x0"], initial_pressure_a=p["pa"], **own),
            "f": block("friction", **self.friction.values()),
        }  # fmt: skip
        wires = [
            "r -> e.in1", "at -> e.in2", "p.position -> e.in3", "e -> kp", "kp -> u.in1", "p.velocity -> kv", "kv -> u.in2", "u -> lim",
            "lim -> c", "c -> p.command", "p.velocity -> f", "f -> p.force",
        ]  # fmt: skip
        outputs = {"x": "p.position", "v": "p.velocity", "pa": "p.pressure_a", "pb": "p.pressure_b", "c": "c"}
        return blocks, wires, outputs

    def _set(self) -> None:
        self.mode = (self.friction.mode, self.limit.mode, self.side, *self.zones)

    def _restore(self) -> None:
        self.friction.mode, self.limit.mode, self.side, *self.zones = self.mode

    def volumes(self, x: float) -> tuple[float, float]:
        """Return those of both chambers."""
        return DEAD + self.p["area_a"] * x, DEAD + self.p["area_b"] * (STROKE - x)

    def outside(self) -> tuple[float, float]:
        """Return what the valve joins the chambers to."""
        return (SUPPLY, AMBIENT) if self.side > 0 else (AMBIENT, SUPPLY)

    def drops(self, s: np.ndarray) -> list[float]:
        """Return the relative differences of pressure, positive inwards."""
        pairs = zip(self.outside(), s[2:4], strict=True)
        return [1 - inside / out if out >= inside else out / inside - 1 for out, inside in pairs]

    @staticmethod
    def zone(drop: float) -> int:
        """Return ±1 laminar, ±2 subsonic, ±3 choked; positive inwards."""
        size = 1 if abs(drop) <= LAMINAR else 2 if abs(drop) <= 1 - CRITICAL else 3
        return size if drop >= 0 else -size

    def demand(self, t: float, s: np.ndarray) -> float:
        """Return what the valve is to do, before its limit."""
        return float(self.p["kp"] * (self.command.at(t) + self.p["offset"] - s[0]) - self.p["kv"] * s[1])

    def push(self, s: np.ndarray) -> float:
        """Return the force on the piston without the friction."""
        p = self.p
        return float(
            p["area_a"] * s[2]
            - p["area_b"] * s[3]
            - (p["area_a"] - p["area_b"]) * AMBIENT
            - p["viscous_friction"] * s[1]
        )

    def rates(self, t: float, s: np.ndarray) -> list[float]:
        """Return all rates."""
        p = self.p
        rests = self.friction.mode == 0 and not self.friction.smooth
        v = 0.0 if rests else s[1]
        dv = 0.0 if rests else (self.push(s) - self.friction.force(s[1])) / p["mass"]
        pressures, air = [], []
        for out, inside, mass, volume, grows, zone in zip(
            self.outside(),
            s[2:4],
            s[4:6],
            self.volumes(s[0]),
            (p["area_a"] * v, -p["area_b"] * v),
            self.zones,
            strict=True,
        ):
            temperature = NORMAL if zone > 0 else inside * volume / (mass * GAS)
            high, low = (out, inside) if zone > 0 else (inside, out)
            if abs(zone) == 1:
                psi = abs(high - low) / LAMINAR * np.sqrt(1 - ((1 - LAMINAR - CRITICAL) / (1 - CRITICAL)) ** 2)
                psi = psi if high >= low else -psi
            else:
                root = abs(1 - ((low / high - CRITICAL) / (1 - CRITICAL)) ** 2)  # a step may go beyond its zone
                psi = high if abs(zone) == 3 else high * np.sqrt(root)
            flow = (
                np.sign(zone) * abs(s[6]) * p["sonic_conductance"] * DENSITY * np.sqrt(NORMAL / abs(temperature)) * psi
            )
            air.append(flow)
            pressures.append(KAPPA / volume * (GAS * temperature * flow - inside * grows))
        return [v, dv, *pressures, *air, (self.limit.saturated(self.demand(t, s)) - s[6]) / p["T"]]

    def events(self, t: float, s: np.ndarray) -> list[float]:
        """Return those of friction, limit, valve, and both flows, up and down."""
        found = [self.friction.events(s[1], self.push(s)), self.limit.events(self.demand(t, s)), [-self.side * s[6]]]
        levels = {-3: (-9.0, CRITICAL - 1), -2: (CRITICAL - 1, -LAMINAR), -1: (-LAMINAR, REVERSED), 1: (-REVERSED, LAMINAR),
                  2: (LAMINAR, 1 - CRITICAL), 3: (1 - CRITICAL, 9.0)}  # fmt: skip
        for drop, zone in zip(self.drops(s), self.zones, strict=True):
            low, high = levels[zone]
            found.append([drop - high, low - drop])
        self._sizes = [len(part) for part in found]
        return [float(value) for part in found for value in part]

    def switch(self, event: int, t: float, s: np.ndarray) -> np.ndarray:
        """Change one of them."""
        self._restore()
        s = s.copy()
        if event >= 0:
            self.events(t, s)
            edges = np.cumsum(self._sizes)
            part = int(np.searchsorted(edges, event, side="right"))
            which = event - (int(edges[part - 1]) if part else 0)
            if part == 0:
                self.friction.switch(which, self.push(s))
                s[1] = 0.0
            elif part == 1:
                self.limit.switch(which)
            elif part == 2:
                self.side = -self.side
                self.zones = [self.zone(drop) for drop in self.drops(s)]
            else:
                order = (-3, -2, -1, 1, 2, 3)
                place = order.index(self.zones[part - 3])
                self.zones[part - 3] = order[place + (1 if which == 0 else -1)]
        self._set()
        return s

    def outputs(self, t: float, s: np.ndarray) -> list[float]:
        """Return x, v, p_a, p_b, c."""
        return [*s[:4], s[6]]
