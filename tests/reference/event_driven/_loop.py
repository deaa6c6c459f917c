"""What all loops have in common: a command, a diagram, an automaton, and the friction that a mass may have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.diagram.diagram import Diagram, compile_system
from engine.signals import Signal, make
from tests.support.event_driven import Automaton, Course, follow
from tests.unit.engine.diagrams import block, document


@dataclass(frozen=True, kw_only=True)
class Command:
    """A step, a ramp or a sine that begins at 0."""

    kind: str
    size: float
    frequency: float = 1.0

    def at(self, t: float) -> float:
        """Return the value just after ``t``."""
        if self.kind == "step":
            return self.size
        return self.size * (t if self.kind == "ramp" else float(np.sin(self.frequency * t)))

    def slope(self, t: float) -> float:
        """Return its slope."""
        if self.kind == "step":
            return 0.0
        return self.size if self.kind == "ramp" else self.size * self.frequency * float(np.cos(self.frequency * t))

    def signal(self) -> Signal:
        """Return the same for the engine."""
        given = {"step": {"amplitude": self.size}, "ramp": {"slope": self.size}}
        return make(self.kind, given.get(self.kind, {"amplitude": self.size, "frequency": self.frequency}))


class Loop(Automaton):
    """One loop with its numbers ``p``; subclasses give the document and the equations.

    Attributes
    ----------
    names : tuple of str
        The outputs of both.
    lever : str
        A number of ``p`` that is a gain of its own.
    """

    names: tuple[str, ...] = ()
    lever = "kp"
    start: list[float]
    scale: list[float]
    duration: float = 1.0

    def __init__(self, p: Mapping[str, Any], command: Command) -> None:
        self.p, self.command = dict(p), command

    def diagram(self) -> Diagram:
        """Return the document, compiled; its parameters are those of ``p`` that are numbers and that it uses."""
        blocks, wires, outputs = self.document()
        return compile_system(document({"r": block("input"), **blocks}, wires, outputs))

    def document(self) -> tuple[dict[str, Any], list[str], dict[str, str]]:
        """Return blocks, wires and outputs."""
        raise NotImplementedError

    def course(self) -> Course:
        """Return what the equations do."""
        return follow(self, self.start, self.duration, scale=self.scale, longest=self.duration / 400)


class Friction:
    """Friction of a velocity by hand: sliding in a direction, or sticking; ``mode`` is -1, 0 or 1."""

    def __init__(self, p: Mapping[str, Any]) -> None:
        self.p = p
        self.mode = 1 if "transition_velocity" in p else 0

    @property
    def smooth(self) -> bool:
        """Whether it never sticks."""
        return "transition_velocity" in self.p

    def level(self, side: int, name: str) -> float:
        """Return static or sliding friction of a direction."""
        p = self.p
        sliding = p.get("coulomb_negative", p["coulomb"]) if side < 0 else p["coulomb"]
        if name == "coulomb":
            return float(sliding)
        static = p.get("static", p["coulomb"])
        return float(static * sliding / p["coulomb"]) if side < 0 and "coulomb_negative" in p else float(static)

    def force(self, v: float) -> float:
        """Return the force while sliding."""
        p = self.p
        side = self.mode if not self.smooth else (1 if v >= 0 else -1)
        force = self.level(side, "coulomb")
        if "stribeck_velocity" in p:
            force += (self.level(side, "static") - force) * np.exp(-((v / p["stribeck_velocity"]) ** 2))
        if self.smooth:
            return float(force * np.tanh(v / p["transition_velocity"]) + p.get("viscous", 0.0) * v)
        return float(self.mode * force + p.get("viscous", 0.0) * v)

    def events(self, v: float, needed: float) -> list[float]:
        """Return what ends the mode; ``needed`` is the force that keeps the mass where it is."""
        if self.smooth:
            return []
        if self.mode:
            return [-self.mode * v]
        return [needed - self.level(1, "static"), -self.level(-1, "static") - needed]

    def switch(self, event: int, needed: float) -> None:
        """Stick if that is possible, else slide where the force pushes."""
        if self.mode == 0:
            self.mode = (1, -1)[event]
        elif -self.level(-1, "static") <= needed <= self.level(1, "static"):
            self.mode = 0
        else:
            self.mode = 1 if needed > 0 else -1

    def values(self) -> dict[str, float]:
        """Return the parameters of the engine's block."""
        return dict(self.p)


class Limit:
    """A saturation, or a dead zone, by hand: -1, 0 or 1."""

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high, self.mode = low, high, 0

    def saturated(self, u: float) -> float:
        """Return the limited signal."""
        return (self.low, u, self.high)[self.mode + 1]

    def dead(self, u: float) -> float:
        """Return the signal less the dead zone."""
        return (u - self.low, 0.0, u - self.high)[self.mode + 1]

    def events(self, u: float) -> list[float]:
        """Return what ends the zone."""
        if self.mode == 0:
            return [u - self.high, self.low - u]
        return [self.high - u] if self.mode > 0 else [u - self.low]

    def switch(self, event: int) -> None:
        """Go to the next zone."""
        self.mode = 0 if self.mode else (1, -1)[event]


def choose(rng: np.random.Generator, *given: Any) -> Any:
    """Return one of several."""
    return given[int(rng.integers(len(given)))]


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two, evenly in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_friction(rng: np.random.Generator, size: float, speed: float) -> dict[str, float]:
    """Return parameters of a friction of about ``size`` (N) for a motion of about ``speed`` (m/s)."""
    p = {"coulomb": size, "viscous": float(choose(rng, 0.0, 0.3 * size / speed))}
    kind = choose(rng, "coulomb", "static", "stribeck", "sides", "smooth", "smooth stribeck")
    if kind != "coulomb":
        p["static"] = size * float(rng.uniform(1.1, 1.8))
    if "stribeck" in kind:
        p["stribeck_velocity"] = speed * between(rng, 0.05, 0.5)
    if kind == "sides":
        p["coulomb_negative"] = size * float(rng.uniform(0.5, 1.5))
    if "smooth" in kind:
        p["transition_velocity"] = speed * between(rng, 1e-3, 0.1)
    return p
