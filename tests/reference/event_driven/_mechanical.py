"""A mass with friction on an actuator with limits, under position and velocity feedback, measured through a backlash or not.

m v' = a - F(v) - k x,   a' = (g lim(u) - a)/T,   u = kp (r - y) - kv v,   y = x or what a backlash makes of it
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.reference.event_driven._loop import Command, Friction, Limit, Loop, between, choose, random_friction
from tests.unit.engine.diagrams import block


class Mechanical(Loop):
    """States x, v, a; the backlash remembers y."""

    names = ("x", "v", "a", "y")

    def __init__(self, p: dict[str, Any], command: Command) -> None:
        super().__init__(p, command)
        self.friction, self.limit = Friction(p["friction"]), Limit(-p["limit"], p["limit"])
        self.flank, self.y = 0, 0.0
        self.start, self.scale = [0.0, 0.0, 0.0], p["scale"]
        self.duration = p["duration"]
        self._set()

    @classmethod
    def random(cls, rng: np.random.Generator) -> Mechanical:
        """Return a loop of moderate damping whose friction is felt."""
        m, w = between(rng, 0.1, 50.0), between(rng, 3.0, 60.0)
        x = between(rng, 1e-3, 1.0)
        force = m * w * w * x
        kp = m * w * w * float(choose(rng, 1.0, 3.0))
        p = {
            "m": m, "k": float(choose(rng, 0.0, 0.3 * m * w * w)), "T": float(rng.uniform(0.05, 0.4)) / w, "g": 1.0, "kp": kp,
            "kv": float(rng.uniform(0.4, 1.6)) * m * w, "limit": force * between(rng, 0.3, 30.0),
            "friction": random_friction(rng, force * between(rng, 0.02, 0.4), x * w), "duration": float(rng.uniform(8.0, 25.0)) / w,
            "play": float(choose(rng, 0.0, 0.0, 0.05, 0.3)) * x, "zone": bool(choose(rng, False, False, True)),
            "scale": [x, x * w, force],
        }  # fmt: skip
        kind = choose(rng, "step", "ramp", "sine")
        size = x * (w / 3.0 if kind == "ramp" else 1.0)
        return cls(p, Command(kind=kind, size=size, frequency=w * float(rng.uniform(0.2, 1.0))))

    def document(self) -> tuple[dict[str, Any], list[str], dict[str, str]]:
        """Return the loop of blocks."""
        p = self.p
        limit = "dead_zone" if p["zone"] else "saturation"
        blocks = {
            "e": block("sum", signs="+-"), "kp": block("gain", gain=p["kp"]), "kv": block("gain", gain=p["kv"]),
            "u": block("sum", signs="+-"), "lim": block(limit, lower=-p["limit"], upper=p["limit"]),
            "act": block("transfer_function", numerator=[p["g"]], denominator=[p["T"], 1.0]),
            "n": block("sum", signs="+--"), "f": block("friction", **self.friction.values()),
            "mass": block("gain", gain=1.0 / p["m"]), "v": block("integrator"), "x": block("integrator"),
            "k": block("gain", gain=p["k"]),
        }  # fmt: skip
        seen = "y" if p["play"] else "x"
        if p["play"]:
            blocks["y"] = block("backlash", width=p["play"])
        wires = [
            "r -> e.in1", f"{seen} -> e.in2", "e -> kp", "kp -> u.in1", "v -> kv", "kv -> u.in2", "u -> lim", "lim -> act", "act -> n.in1",
            "v -> f", "f -> n.in2", "x -> k", "k -> n.in3", "n -> mass", "mass -> v", "v -> x", *(["x -> y"] if p["play"] else []),
        ]  # fmt: skip
        return blocks, wires, {"x": "x", "v": "v", "a": "act", "y": seen}

    def _set(self) -> None:
        self.mode = (self.friction.mode, self.limit.mode, self.flank, self.y)

    def _restore(self) -> None:
        self.friction.mode, self.limit.mode, self.flank, self.y = self.mode

    def seen(self, x: float) -> float:
        """Return what is measured."""
        return self.y if self.p["play"] and not self.flank else x - 0.5 * self.flank * self.p["play"]

    def demand(self, t: float, s: np.ndarray) -> float:
        """Return u."""
        return float(self.p["kp"] * (self.command.at(t) - self.seen(s[0])) - self.p["kv"] * s[1])

    def rates(self, t: float, s: np.ndarray) -> list[float]:
        """Return x', v', a'."""
        p, u = self.p, self.demand(t, s)
        limited = self.limit.dead(u) if p["zone"] else self.limit.saturated(u)
        stuck = not self.friction.smooth and self.friction.mode == 0
        dv = 0.0 if stuck else (s[2] - self.friction.force(s[1]) - p["k"] * s[0]) / p["m"]
        return [s[1], dv, (p["g"] * limited - s[2]) / p["T"]]

    def events(self, t: float, s: np.ndarray) -> list[float]:
        """Return those of friction, limit and backlash."""
        found = [self.friction.events(s[1], s[2] - self.p["k"] * s[0]), self.limit.events(self.demand(t, s)), []]
        half = 0.5 * self.p["play"] * (1 + 1e-13)  # what rounding leaves at a flank is no way
        if self.p["play"]:
            found[2] = [-self.flank * s[1]] if self.flank else [s[0] - half - self.y, self.y - half - s[0]]
        self._sizes = [len(part) for part in found]
        return [value for part in found for value in part]

    def switch(self, event: int, t: float, s: np.ndarray) -> np.ndarray:
        """Change one of the three."""
        self._restore()
        if event >= 0:
            self.events(t, s)
            first, second, _ = self._sizes
            if event < first:
                self.friction.switch(event, s[2] - self.p["k"] * s[0])
                s = np.array([s[0], 0.0, s[2]])
            elif event < first + second:
                self.limit.switch(event - first)
            elif self.flank:
                self.y, self.flank = self.seen(s[0]), 0
            else:
                self.flank = (1, -1)[event - first - second]
        self._set()
        return s

    def outputs(self, t: float, s: np.ndarray) -> list[float]:
        """Return x, v, a, y."""
        self._restore()
        return [*s, self.seen(s[0])]
