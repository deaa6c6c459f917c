"""A hydraulic axis: gain, limit, lag of the spool, four edges with overlap, cylinder with leakage and ends, friction of the seals.

s' = (lim(kp (r - x)) - s)/T,   Q = C w o Δp sqrt(2/ρ)/(Δp² + p_l²)^(1/4),   V_a p_a' = β (Q_a - A_a v - c (p_a - p_b)),
m v' = A_a p_a - A_b p_b - b v - F
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.reference.event_driven._loop import Command, Friction, Limit, Loop, between, choose, random_friction
from tests.unit.engine.diagrams import block

SUPPLY = 10e6
FREE, UPPER, LOWER = "free", "upper", "lower"


class Hydraulic(Loop):
    """States x, v, p_a, p_b, s."""

    names = ("x", "v", "pa", "pb", "s")

    def __init__(self, p: dict[str, Any], command: Command) -> None:
        super().__init__(p, command)
        self.friction, self.limit = Friction(p["friction"]), Limit(-p["limit"], p["limit"])
        self.spool, self.place = 0, FREE
        self.start = [p["x0"], 0.0, p["pa"], p["pb"], 0.0]
        self.scale = [1e-2, 1e-1, 1e6, 1e6, 1e-3]
        self.duration = p["duration"]
        self._set()

    @classmethod
    def random(cls, rng: np.random.Generator) -> Hydraulic:
        """Return an axis that reaches its target, a ramp or a sine, with chambers in balance or not, now and then at an end."""
        area = between(rng, 5e-4, 3e-3)
        ratio, stroke = float(choose(rng, 1.0, rng.uniform(0.5, 0.95))), between(rng, 0.1, 0.6)
        start = float(choose(rng, 0.5, 0.5, 0.2, 0.0)) * stroke
        pa = float(choose(rng, 3e6, 5e6, rng.uniform(1e6, 9e6) * ratio))
        balance = float(choose(rng, 1.0, 1.0, 1.0 + 1e-3 * rng.standard_normal(), rng.uniform(0.8, 1.1)))
        force = area * SUPPLY
        kind = choose(rng, "step", "ramp", "sine")
        kp = between(rng, 4e-3, 3e-2)
        way = float(rng.uniform(0.02, 0.1)) * (1.0 if start == 0 else float(choose(rng, -1.0, 1.0)))
        target = {"step": start + way, "ramp": 0.5 * way, "sine": way}[kind]
        p = {
            "area_a": area, "area_b": area * ratio, "stroke": stroke, "mass": between(rng, 20.0, 300.0),
            "viscous_friction": float(choose(rng, 0.0, 500.0)), "leakage": float(choose(rng, 0.0, between(rng, 1e-13, 1e-11))),
            "bulk_modulus": between(rng, 5e8, 1.5e9), "x0": start, "pa": pa, "pb": pa / ratio * balance,
            "overlap": float(choose(rng, 0.0, 2e-5, 1e-4)), "stroke_valve": 1e-3, "kp": kp, "T": between(rng, 2e-3, 2e-2),
            "limit": float(choose(rng, 1e-3, 0.6e-3, 2e-3)), "offset": start if kind != "step" else 0.0,
            "friction": random_friction(rng, force * between(rng, 0.005, 0.1), 0.1), "duration": float(rng.uniform(0.3, 0.7)),
        }  # fmt: skip
        return cls(p, Command(kind=kind, size=target, frequency=between(rng, 3.0, 20.0)))

    def document(self) -> tuple[dict[str, Any], list[str], dict[str, str]]:
        """Return the loop of blocks; the offset is the position at which the command is 0."""
        p = self.p
        cylinder = {
            name: p[name]
            for name in ("area_a", "area_b", "stroke", "mass", "viscous_friction", "leakage", "bulk_modulus")
        }
        blocks = {
            "at": block("passive_on", current=p["offset"]), "e": block("sum", signs="++-"), "kp": block("gain", gain=p["kp"]),
            "lim": block("saturation", lower=-p["limit"], upper=p["limit"]),
            "s": block("transfer_function", numerator=[1.0], denominator=[p["T"], 1.0]),
            "valve": block("orifice_valve", overlap=p["overlap"], stroke=p["stroke_valve"], supply_pressure=SUPPLY),
            "c": block("hydraulic_cylinder", initial_position=p["x0"], initial_pressure_a=p["pa"], initial_pressure_b=p["pb"], **cylinder),
            "f": block("friction", **self.friction.values()),
        }  # fmt: skip
        wires = [
            "r -> e.in1", "at -> e.in2", "c.position -> e.in3", "e -> kp", "kp -> lim", "lim -> s", "s -> valve.spool",
            "c.pressure_a -> valve.pressure_a", "c.pressure_b -> valve.pressure_b", "valve.flow_a -> c.flow_a",
            "valve.flow_b -> c.flow_b", "c.velocity -> f", "f -> c.force",
        ]  # fmt: skip
        outputs = {"x": "c.position", "v": "c.velocity", "pa": "c.pressure_a", "pb": "c.pressure_b", "s": "s"}
        return blocks, wires, outputs

    def _set(self) -> None:
        self.mode = (self.friction.mode, self.limit.mode, self.spool, self.place)

    def _restore(self) -> None:
        self.friction.mode, self.limit.mode, self.spool, self.place = self.mode

    def demand(self, t: float, s: np.ndarray) -> float:
        """Return what the spool is to do, before its limit."""
        return float(self.p["kp"] * (self.command.at(t) + self.p["offset"] - s[0]))

    def flows(self, s: np.ndarray) -> tuple[float, float]:
        """Return the flows into both chambers."""
        p, side = self.p, int(np.sign(self.spool))
        if not side:
            return 0.0, 0.0
        travel = abs(s[4]) if abs(self.spool) == 1 else p["stroke_valve"]
        opening = side * (side * np.copysign(travel, side) - p["overlap"])

        def edge(difference: float) -> float:
            return float(0.62 * 0.02 * np.sqrt(2 / 870.0) * opening * difference / (difference**2 + 1e8) ** 0.25)

        if side > 0:
            return edge(SUPPLY - s[2]), -edge(s[3])
        return edge(s[2]), -edge(SUPPLY - s[3])

    def push(self, s: np.ndarray) -> float:
        """Return the force on the piston without the friction."""
        p = self.p
        return float(p["area_a"] * s[2] - p["area_b"] * s[3] - p["viscous_friction"] * s[1])

    def rates(self, t: float, s: np.ndarray) -> list[float]:
        """Return x', v', p_a', p_b', s'."""
        p = self.p
        rests = self.place != FREE or (self.friction.mode == 0 and not self.friction.smooth)
        v = 0.0 if rests else s[1]
        dv = 0.0 if rests else (self.push(s) - self.friction.force(s[1])) / p["mass"]
        qa, qb = self.flows(s)
        leak = p["leakage"] * (s[2] - s[3])
        da = p["bulk_modulus"] / (1e-4 + p["area_a"] * s[0]) * (qa - p["area_a"] * v - leak)
        db = p["bulk_modulus"] / (1e-4 + p["area_b"] * (p["stroke"] - s[0])) * (qb + p["area_b"] * v + leak)
        return [v, dv, da, db, (self.limit.saturated(self.demand(t, s)) - s[4]) / p["T"]]

    def events(self, t: float, s: np.ndarray) -> list[float]:
        """Return those of friction, limit, spool and ends."""
        p, push = self.p, self.push(s)
        side = s[4] if self.spool >= 0 else -s[4]
        spool = {
            0: [s[4] - p["overlap"], -s[4] - p["overlap"]],
            1: [p["overlap"] - side, side - p["stroke_valve"]],
            2: [p["stroke_valve"] - side],
        }
        ends = {FREE: [s[0] - p["stroke"], -s[0]], UPPER: [-push], LOWER: [push]}
        found = [
            self.friction.events(s[1], push) if self.place == FREE else [], self.limit.events(self.demand(t, s)), spool[abs(self.spool)],
            ends[self.place],
        ]  # fmt: skip
        self._sizes = [len(part) for part in found]
        return [float(value) for part in found for value in part]

    def switch(self, event: int, t: float, s: np.ndarray) -> np.ndarray:
        """Change one of the four."""
        self._restore()
        s = s.copy()
        if event >= 0:
            self.events(t, s)
            one, two, three, _ = np.cumsum(self._sizes)
            if event < one:
                self.friction.switch(event, self.push(s))
                s[1] = 0.0
            elif event < two:
                self.limit.switch(event - one)
            elif event < three:
                which, side = event - two, 1 if self.spool > 0 else -1
                self.spool = (
                    (1, -1)[which] if self.spool == 0 else (0, 2 * side)[which] if abs(self.spool) == 1 else side
                )
            elif self.place == FREE:
                self.place, s[1] = (UPPER, LOWER)[event - three], 0.0
                s[0] = p_end(self.p, self.place)
            else:
                self.place, self.friction.mode = FREE, 0 if not self.friction.smooth else 1
        self._set()
        return s


def p_end(p: dict[str, Any], place: str) -> float:
    """Return the position of an end."""
    return float(p["stroke"]) if place == UPPER else 0.0
