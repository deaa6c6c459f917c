"""A body on a spring over a base that moves, with a semi-active damper: Bingham or Dahl, skyhook or groundhook, switched or smoothly.

m v' = -k (x - z) - F,   F = c(i) v_r + f(i) tanh(v_r/v_t)  or  c(i) v_r + f(i) w,  w' = ρ (v_r - |v_r| w),   v_r = v - z';
i by the sign of v v_r (skyhook) or of -z' v_r (groundhook); a factor that the current drives back from either side stays at 0
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.reference.event_driven._loop import Command, Loop, between, choose
from tests.unit.engine.diagrams import block


class SemiActive(Loop):
    """States x, v, z, z' (the command through a lag of second order) and w."""

    names, lever = ("x", "v", "f"), "k"

    def __init__(self, p: dict[str, Any], command: Command) -> None:
        super().__init__(p, command)
        self.start, self.scale = [0.0] * 5, [1e-2, 1e-1, 1e-2, 1e-1, 1.0]
        self.duration = p["duration"]
        self.signs, self.held, self.way = [-1, 1], -1, 1
        self._set()

    @classmethod
    def random(cls, rng: np.random.Generator) -> SemiActive:
        """Return a quarter of a car, about."""
        m, w = between(rng, 50.0, 500.0), between(rng, 4.0, 15.0)
        size = between(rng, 5e-3, 5e-2)
        speed, force = size * w, m * w * w * size
        soft, hard = 0.1 * m * w, float(rng.uniform(0.2, 1.0)) * m * w
        dry = [force * float(rng.uniform(0.0, 0.05)), force * float(rng.uniform(0.1, 0.8))]
        law = str(choose(rng, "skyhook", "skyhook", "groundhook"))
        kind = choose(rng, "step", "sine", "sine") if law == "skyhook" else "sine"  # a base at rest has no sign
        p = {
            "m": m, "k": m * w * w, "kp": w * w * between(rng, 4.0, 50.0), "d": float(rng.uniform(0.3, 1.0)), "damping": [soft, hard],
            "dry": dry, "damper": str(choose(rng, "bingham", "dahl")), "vt": speed * between(rng, 0.01, 0.3),
            "rho": between(rng, 10.0, 100.0) / size, "law": law, "off": 0.0,
            "on": float(rng.uniform(0.5, 1.0)), "transition": float(choose(rng, 0.0, 0.0, 0.0, speed**2 * between(rng, 1e-2, 1.0))),
            "duration": float(rng.uniform(1.0, 3.0)) * 2 * np.pi / w,
        }  # fmt: skip
        return cls(p, Command(kind=kind, size=size, frequency=w * float(rng.uniform(0.5, 2.5))))

    def document(self) -> tuple[dict[str, Any], list[str], dict[str, str]]:
        """Return the loop of blocks; z'' = kp (r - z) - 2 d sqrt(kp) z'."""
        p = self.p
        law = {"off": p["off"], "on": p["on"], "transition": p["transition"]}
        damper = (
            block("mr_damper_bingham", yield_force=p["dry"], damping=p["damping"], transition_velocity=p["vt"])
            if p["damper"] == "bingham"
            else block("mr_damper_dahl", friction=p["dry"], damping=p["damping"], rho=p["rho"])
        )
        blocks = {
            "e": block("sum", signs="+-"), "kp": block("gain", gain=p["kp"]), "n": block("sum", signs="+-"), "zv": block("integrator"),
            "z": block("integrator"), "d": block("gain", gain=2 * p["d"] * np.sqrt(p["kp"])), "stretch": block("sum", signs="+-"),
            "k": block("gain", gain=p["k"]), "push": block("sum", signs="--"), "m": block("gain", gain=1 / p["m"]), "v": block("integrator"),
            "x": block("integrator"), "vr": block("sum", signs="+-"), "f": damper, "law": block(p["law"], **law),
        }  # fmt: skip
        first = "v -> law.velocity" if p["law"] == "skyhook" else "zv -> law.base_velocity"
        wires = [
            "r -> e.in1", "z -> e.in2", "e -> kp", "kp -> n.in1", "zv -> d", "d -> n.in2", "n -> zv", "zv -> z", "x -> stretch.in1",
            "z -> stretch.in2", "stretch -> k", "k -> push.in1", "f -> push.in2", "push -> m", "m -> v", "v -> x", "v -> vr.in1",
            "zv -> vr.in2", "vr -> f.velocity", "law -> f.current", "vr -> law.relative_velocity", first,
        ]  # fmt: skip
        return blocks, wires, {"x": "x", "v": "v", "f": "f"}

    def _set(self) -> None:
        self.mode = (*self.signs, self.held, self.way)

    def _restore(self) -> None:
        a, b, self.held, self.way = self.mode
        self.signs = [a, b]

    def factors(self, s: np.ndarray) -> list[float]:
        """Return what decides by the sign of its product."""
        slip = s[1] - s[3]
        return [s[1] if self.p["law"] == "skyhook" else -s[3], slip]

    def force(self, s: np.ndarray, current: float) -> float:
        """Return the damper's force at a current."""
        p, slip = self.p, s[1] - s[3]
        dry = np.tanh(slip / p["vt"]) if p["damper"] == "bingham" else s[4]
        return float(sum((c[0] + c[1] * current) * part for c, part in ((p["damping"], slip), (p["dry"], dry))))

    def base(self, t: float, s: np.ndarray) -> float:
        """Return z''."""
        p = self.p
        return float(p["kp"] * (self.command.at(t) - s[2]) - 2 * p["d"] * np.sqrt(p["kp"]) * s[3])

    def needed(self, t: float, s: np.ndarray) -> float:
        """Return the current that keeps the held factor at 0; infinite where none does."""
        p = self.p
        rest = 0.0 if self.held == 0 else self.base(t, s)  # of v, or of v - z'
        wanted = -p["k"] * (s[0] - s[2]) - p["m"] * rest
        at_0, per_ampere = self.force(s, 0.0), self.force(s, 1.0) - self.force(s, 0.0)
        if per_ampere == 0.0:
            return float(np.copysign(np.inf, wanted - at_0))
        return float((wanted - at_0) / per_ampere)

    def current(self, t: float, s: np.ndarray) -> float:
        """Return the current."""
        p = self.p
        if p["transition"]:
            product = float(np.prod(self.factors(s)))
            return float(p["off"] + (p["on"] - p["off"]) * 0.5 * (1 + np.tanh(product / p["transition"])))
        if self.held >= 0:
            return self.needed(t, s)
        return float(p["on"] if self.signs[0] == self.signs[1] else p["off"])

    def rates(self, t: float, s: np.ndarray) -> list[float]:
        """Return all rates; the side of the slip is a mode of Dahl's law."""
        p = self.p
        dv = (-p["k"] * (s[0] - s[2]) - self.force(s, self.current(t, s))) / p["m"]
        slip, bend = s[1] - s[3], self.base(t, s)
        if self.held == 0:
            dv = 0.0
        elif self.held == 1:
            dv, slip = bend, 0.0
        return [s[1], dv, s[3], bend, p["rho"] * slip * (1 - self.way * s[4])]

    def events(self, t: float, s: np.ndarray) -> list[float]:
        """Return the sign of the slip for Dahl's law, and what ends a current."""
        bends = self.p["damper"] == "dahl" and self.held != 1
        found = [-self.way * (s[1] - s[3])] if bends else [-1.0]
        if self.p["transition"]:
            return found
        if self.held < 0:
            return found + [-sign * f for sign, f in zip(self.signs, self.factors(s), strict=True)]
        i, other = self.needed(t, s), 1 - self.held
        return [*found, i - self.p["on"], self.p["off"] - i, -self.signs[other] * self.factors(s)[other]]

    def switch(self, event: int, t: float, s: np.ndarray) -> np.ndarray:
        """Slide where the factor's rates with either current point at 0, else pass."""
        self._restore()
        s = s.copy()
        if event == 0:
            self.way = -self.way
        elif event > 0 and self.held < 0:
            k = event - 1
            self.held = k
            if k == 0:
                s[1 if self.p["law"] == "skyhook" else 3] *= 1.0 if self.p["law"] != "skyhook" else 0.0
            else:
                s[1] = s[3]
            if self.p["law"] == "groundhook" and k == 0:
                slides = False
            else:
                # the damper's force grows with the current in the direction of the slip; on where the product is positive
                per_ampere = (self.force(s, 1.0) - self.force(s, 0.0)) * self.signs[1 - k]
                slides = per_ampere > 0 and self.p["off"] <= self.needed(t, s) <= self.p["on"]
            if not slides:
                self.held, self.signs[k] = -1, -self.signs[k]
        elif event > 0:
            k, self.held = self.held, -1
            other = self.signs[1 - k]
            if event == 3:
                self.signs[k], self.signs[1 - k] = other, -other
            else:
                self.signs[k] = other if event == 1 else -other
        self._set()
        return s

    def outputs(self, t: float, s: np.ndarray) -> list[float]:
        """Return x, v and the force."""
        self._restore()
        return [s[0], s[1], self.force(s, self.current(t, s))]
