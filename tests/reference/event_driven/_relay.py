"""A mass under a relay: with hysteresis it swings, without one it slides along s = r - x - c v = 0.

m v' = K u + k_a (r - x) - d v,   u = high or low by the sign of s, past half the hysteresis on either side; sliding: whatever keeps s at 0
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.reference.event_driven._loop import Command, Loop, between, choose
from tests.unit.engine.diagrams import block


class Relayed(Loop):
    """States x, v."""

    names, lever = ("x", "v", "u"), "K"

    def __init__(self, p: dict[str, Any], command: Command) -> None:
        super().__init__(p, command)
        self.start, self.scale = [0.0, 0.0], p["scale"]
        self.duration = p["duration"]
        first = command.at(0.0)
        self.mode = 0 if p["h"] == 0 and first == 0 else 1 if first > 0.5 * p["h"] else -1

    @classmethod
    def random(cls, rng: np.random.Generator) -> Relayed:
        """Return a loop that comes to its surface."""
        m, w, x = between(rng, 0.1, 10.0), between(rng, 1.0, 20.0), between(rng, 1e-2, 1.0)
        force = m * w * w * x
        high = float(rng.uniform(0.6, 2.0))
        p = {
            "m": m, "kp": float(choose(rng, 0.0, 0.5 * m * w * w)), "d": m * w * float(rng.uniform(0.1, 1.0)), "K": force, "high": high,
            "low": -high * float(choose(rng, 1.0, rng.uniform(0.6, 1.4))), "h": float(choose(rng, 0.0, 0.0, x * between(rng, 1e-2, 0.3))),
            "c": float(rng.uniform(0.3, 1.5)) / w, "duration": float(rng.uniform(3.0, 8.0)) / w, "scale": [x, x * w],
        }  # fmt: skip
        kind = choose(rng, "step", "ramp", "sine")
        size = float(choose(rng, -1.0, 1.0)) * x * (0.3 * w if kind == "ramp" else 0.7)
        return cls(p, Command(kind=kind, size=size, frequency=w * float(rng.uniform(0.2, 1.0))))

    def document(self) -> tuple[dict[str, Any], list[str], dict[str, str]]:
        """Return the loop of blocks."""
        p = self.p
        blocks = {
            "e": block("sum", signs="+-"), "c": block("gain", gain=p["c"]), "s": block("sum", signs="+-"),
            "relay": block("relay", low=p["low"], high=p["high"], hysteresis=p["h"]), "K": block("gain", gain=p["K"]),
            "kp": block("gain", gain=p["kp"]), "d": block("gain", gain=p["d"]), "n": block("sum", signs="++-"),
            "m": block("gain", gain=1 / p["m"]), "v": block("integrator"), "x": block("integrator"),
        }  # fmt: skip
        wires = [
            "r -> e.in1", "x -> e.in2", "e -> s.in1", "v -> c", "c -> s.in2", "s -> relay", "relay -> K", "K -> n.in1", "e -> kp",
            "kp -> n.in2", "v -> d", "d -> n.in3", "n -> m", "m -> v", "v -> x",
        ]  # fmt: skip
        return blocks, wires, {"x": "x", "v": "v", "u": "relay"}

    def surface(self, t: float, s: np.ndarray) -> float:
        """Return what the relay sees."""
        return float(self.command.at(t) - s[0] - self.p["c"] * s[1])

    def equivalent(self, t: float, s: np.ndarray) -> float:
        """Return the u that keeps it at 0."""
        p = self.p
        dv = (self.command.slope(t) - s[1]) / p["c"]
        return float((p["m"] * dv + p["d"] * s[1] - p["kp"] * (self.command.at(t) - s[0])) / p["K"])

    def value(self, t: float, s: np.ndarray) -> float:
        """Return u."""
        return self.equivalent(t, s) if self.mode == 0 else float(self.p["high"] if self.mode > 0 else self.p["low"])

    def rates(self, t: float, s: np.ndarray) -> list[float]:
        """Return x', v'."""
        p = self.p
        force = p["K"] * self.value(t, s) + p["kp"] * (self.command.at(t) - s[0]) - p["d"] * s[1]
        return [s[1], force / p["m"]]

    def events(self, t: float, s: np.ndarray) -> list[float]:
        """Return how far the relay's input, or its mean output, is beyond what the mode covers."""
        if self.mode == 0:
            u = self.equivalent(t, s)
            return [u - self.p["high"], self.p["low"] - u]
        return [-self.mode * self.surface(t, s) - 0.5 * self.p["h"]]

    def switch(self, event: int, t: float, s: np.ndarray) -> np.ndarray:
        """Switch, or slide where both values drive the input back."""
        if event < 0:
            return s
        if self.mode == 0:
            self.mode = (1, -1)[event]
        elif self.p["h"] == 0 and self.p["low"] <= self.equivalent(t, s) <= self.p["high"]:
            self.mode = 0
        else:
            self.mode = -self.mode
        return s

    def outputs(self, t: float, s: np.ndarray) -> list[float]:
        """Return x, v, u."""
        return [*s, self.value(t, s)]
