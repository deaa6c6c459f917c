"""Random loops of nonlinear laws with pure delays: each as a document, and as blocks of the integration written for tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from engine.model.document import System
from tests.reference.method_of_steps import _blocks as b
from tests.reference.method_of_steps._steps import Delay, Loop
from tests.unit.engine.diagrams import block, document

Numbers = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A loop: ``document`` and ``loop`` make it from its ``numbers``.

    ``outputs`` are names of the document by those of the blocks; ``turned`` are parameters by the numbers that they are.
    """

    name: str
    numbers: Numbers
    document: System
    loop: Callable[[Numbers], Loop]
    signal: Mapping[str, Any]
    end: float
    outputs: Mapping[str, str]
    turned: Mapping[str, str]


def cases(count: int, seed: int) -> list[Case]:
    """Return so many random loops, of all kinds in turn."""
    generator = np.random.default_rng(seed)
    makers = (process, axis, cylinder, suspension)
    return [makers[k % len(makers)](generator, k) for k in range(count)]


def log(generator: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two, spread evenly over its powers of ten."""
    return float(10 ** generator.uniform(math.log10(low), math.log10(high)))


def _length(delay: float, wanted: float) -> float:
    """Return an end that is no more than a hundred delays away."""
    return min(wanted, 100 * delay)


def process(g: np.random.Generator, number: int) -> Case:
    """PI, a law, a delay to the plant, and in every other loop one back from the sensor."""
    kind = ("saturation", "dead_zone", "relay", "relay")[number // 4 % 4]
    p = {
        "kp": log(g, 0.5, 3), "ki": log(g, 0.2, 2), "t": log(g, 1e-4, 0.05), "s": log(g, 1e-3, 0.05), "k": log(g, 0.5, 2),
        "lag": log(g, 0.05, 0.5), "low": -log(g, 0.3, 2), "high": log(g, 0.3, 2),
        "h": 0.0 if number // 16 % 2 else log(g, 0.02, 0.2), "a": log(g, 0.5, 3),
    }  # fmt: skip
    sensor = number // 4 % 2 == 0
    law = {
        "saturation": {"lower": p["low"], "upper": p["high"]},
        "dead_zone": {"lower": 0.1 * p["low"], "upper": 0.1 * p["high"]},
        "relay": {"low": p["low"], "high": p["high"], "hysteresis": p["h"]},
    }[kind]
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("pi", kp=p["kp"], ki=p["ki"]),
        "law": block(kind, **law), "d": block("delay", time=p["t"]),
        "plant": block("transfer_function", numerator=[p["k"]], denominator=[p["lag"], 1.0]),
    }  # fmt: skip
    wires = ["r -> e.in1", "e -> c", "c -> law", "law -> d", "d -> plant"]
    if sensor:
        blocks["back"] = block("delay", time=p["s"])
    wires += ["plant -> back", "back -> e.in2"] if sensor else ["plant -> e.in2"]

    def loop(q: Numbers) -> Loop:
        made = {
            "saturation": lambda: b.Saturation("v", "u", q["low"], q["high"]),
            "dead_zone": lambda: b.DeadZone("v", "u", 0.1 * q["low"], 0.1 * q["high"]),
            "relay": lambda: b.Relay("v", "u", q["low"], q["high"], q["h"]),
        }[kind]()
        delays = [Delay("v", "w", q["t"]), *([Delay("y", "m", q["s"])] if sensor else [])]
        parts = [b.Sum("e", r=1, **{"m" if sensor else "y": -1}), b.Pid("u", "e", kp=q["kp"], ki=q["ki"]), made,
                 b.Lag("y", "w", q["k"], q["lag"])]  # fmt: skip
        return Loop(parts, delays, commands={"r": lambda _: p["a"]})

    turned = {"c.kp": "kp", "d.time": "t"}
    if kind == "saturation":
        turned["law.upper"] = "high"
    if kind == "relay":
        turned["law.high"] = "high"
    return Case(
        name=f"{number} process with {kind}", numbers=p, document=document(blocks, wires, {"y": "plant", "w": "d"}),
        loop=loop, signal={"kind": "step", "amplitude": p["a"]}, end=_length(p["t"], 6 * p["lag"]),
        outputs={"y": "y", "w": "w"}, turned=turned,
    )  # fmt: skip


def axis(g: np.random.Generator, number: int) -> Case:
    """A position loop: PD, a limit, a delay, a mass with friction, and sometimes backlash before the sensor."""
    smooth, play = number // 4 % 3 == 2, number // 4 % 2 == 1
    p = {
        "kp": log(g, 20, 100), "kd": log(g, 2, 8), "w": log(g, 100, 500), "limit": log(g, 3, 20), "t": log(g, 1e-4, 0.02),
        "m": log(g, 0.5, 2), "fc": log(g, 0.3, 2), "more": g.uniform(1.0, 1.6), "vs": log(g, 0.05, 0.3),
        "b": log(g, 0.1, 2), "vt": log(g, 0.02, 0.1), "play": log(g, 0.005, 0.05), "a": log(g, 0.1, 0.5),
    }  # fmt: skip
    friction = {"coulomb": p["fc"], "static": p["fc"] * p["more"], "stribeck_velocity": p["vs"], "viscous": p["b"]}
    if smooth:
        friction["transition_velocity"] = p["vt"]
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"),
        "c": block("pd", kp=p["kp"], kd=p["kd"], filter_frequency=p["w"]),
        "s": block("saturation", lower=-p["limit"], upper=p["limit"]), "d": block("delay", time=p["t"]),
        "n": block("sum", signs="+-"), "v": block("integrator", gain=1 / p["m"]), "x": block("integrator"),
        "f": block("friction", **friction),
    }  # fmt: skip
    wires = ["r -> e.in1", "e -> c", "c -> s", "s -> d", "d -> n.in1", "f -> n.in2", "n -> v", "v -> f", "v -> x"]
    if play:
        blocks["gear"] = block("backlash", width=p["play"])
    wires += ["x -> gear", "gear -> e.in2"] if play else ["x -> e.in2"]

    def loop(q: Numbers) -> Loop:
        mass = b.Mass(
            "x", "w", q["m"], coulomb=q["fc"], static=q["fc"] * p["more"], stribeck=q["vs"], viscous=q["b"],
            transition=q["vt"] if smooth else 0.0,
        )  # fmt: skip
        parts = [b.Sum("e", r=1, **{"z" if play else "x": -1}), b.Saturation("v", "u", -p["limit"], q["limit"]), mass,
                 b.Pid("u", "e", kp=q["kp"], kd=q["kd"], w=q["w"])]  # fmt: skip
        if play:
            parts.append(b.Backlash("z", "x", "x'", q["play"]))
        return Loop(parts, [Delay("v", "w", q["t"])], commands={"r": lambda _: p["a"]})

    return Case(
        name=f"{number} axis, smooth {smooth}, play {play}", numbers=p, loop=loop,
        document=document(blocks, wires, {"y": "x", "v": "v"}), signal={"kind": "step", "amplitude": p["a"]},
        end=_length(p["t"], 1.0), outputs={"y": "x", "v": "x'"},
        turned={"c.kp": "kp", "d.time": "t", "s.upper": "limit", "f.viscous": "b"},
    )  # fmt: skip


def cylinder(g: np.random.Generator, number: int) -> Case:
    """A hydraulic position loop: a limit, a delay, the lag of a spool, four orifices, two chambers, and friction."""
    smooth = number // 4 % 2 == 0
    p = {
        "kp": log(g, 3e-3, 2e-2), "limit": log(g, 3e-4, 2e-3), "t": log(g, 2e-4, 0.01), "lag": log(g, 2e-3, 1e-2),
        "overlap": float(g.choice([0.0, 2e-5])), "m": log(g, 50, 200), "b": log(g, 500, 2000), "fc": log(g, 50, 300),
        "vs": log(g, 0.02, 0.1), "vt": log(g, 5e-3, 2e-2), "leak": log(g, 1e-12, 1e-11), "way": log(g, 0.01, 0.05),
    }  # fmt: skip
    friction = {"coulomb": p["fc"], "static": 1.2 * p["fc"], "stribeck_velocity": p["vs"]}
    if smooth:
        friction["transition_velocity"] = p["vt"]
    aim = 0.25 + p["way"]
    blocks = {
        "r": block("input"), "e": block("sum", signs="+-"), "c": block("p", kp=p["kp"]),
        "s": block("saturation", lower=-p["limit"], upper=p["limit"]), "d": block("delay", time=p["t"]),
        "spool": block("transfer_function", numerator=[1.0], denominator=[p["lag"], 1.0]),
        "valve": block("orifice_valve", overlap=p["overlap"]),
        "cyl": block("hydraulic_cylinder", mass=p["m"], viscous_friction=p["b"], leakage=p["leak"]),
        "f": block("friction", **friction),
    }  # fmt: skip
    wires = [
        "r -> e.in1", "cyl.position -> e.in2", "e -> c", "c -> s", "s -> d", "d -> spool", "spool -> valve.spool",
        "cyl.pressure_a -> valve.pressure_a", "cyl.pressure_b -> valve.pressure_b", "valve.flow_a -> cyl.flow_a",
        "valve.flow_b -> cyl.flow_b", "cyl.velocity -> f", "f -> cyl.force",
    ]  # fmt: skip

    def loop(q: Numbers) -> Loop:
        piston = b.Cylinder(
            "x", ("qa", "qb"), q["m"], areas=(2e-3, 1.2e-3), dead=(1e-4, 1e-4), stroke=0.5, bulk=1e9, leakage=q["leak"],
            pressure=3e6, coulomb=q["fc"], static=1.2 * p["fc"], stribeck=q["vs"], viscous=q["b"],
            transition=q["vt"] if smooth else 0.0,
        )  # fmt: skip
        valve = b.Valve(
            ("qa", "qb"), ("spool", "x.a", "x.b"), gain=0.62 * 0.02 * math.sqrt(2 / 870), overlap=q["overlap"],
            stroke=1e-3, supply=10e6, laminar=1e4,
        )  # fmt: skip
        parts = [b.Sum("e", r=1, x=-1), b.Pid("u", "e", kp=q["kp"]), b.Saturation("v", "u", -p["limit"], q["limit"]),
                 b.Lag("spool", "w", 1.0, q["lag"]), valve, piston]  # fmt: skip
        return Loop(parts, [Delay("v", "w", q["t"])], commands={"r": lambda _: aim})

    return Case(
        name=f"{number} cylinder, smooth {smooth}", numbers=p, loop=loop,
        document=document(blocks, wires, {"y": "cyl.position", "v": "cyl.velocity"}),
        signal={"kind": "step", "amplitude": aim}, end=_length(p["t"], 0.3), outputs={"y": "x", "v": "x'"},
        turned={"c.kp": "kp", "d.time": "t", "cyl.mass": "m"},
    )  # fmt: skip


def suspension(g: np.random.Generator, number: int) -> Case:
    """Two masses on springs, a damper between them whose current a skyhook law switches, late by a delay."""
    smooth = number // 4 % 2 == 1
    p = {
        "m1": log(g, 1, 3), "m2": log(g, 0.2, 0.6), "k1": log(g, 30, 120), "k2": log(g, 300, 900), "b": log(g, 0.5, 2),
        "c": log(g, 1, 6), "on": log(g, 0.8, 2), "t": log(g, 5e-4, 0.05), "tr": log(g, 0.02, 0.2), "a": log(g, 5, 30),
        "f": log(g, 4, 12),
    }  # fmt: skip
    law = {"off": 0.1, "on": p["on"], "transition": p["tr"] if smooth else 0.0}
    blocks = {
        "r": block("input"), "v1": block("integrator", gain=1 / p["m1"]), "x1": block("integrator"),
        "v2": block("integrator", gain=1 / p["m2"]), "x2": block("integrator"), "rel": block("sum", signs="+-"),
        "way": block("sum", signs="+-"), "spring": block("gain", gain=p["k1"]), "tyre": block("gain", gain=p["k2"]),
        "law": block("skyhook", **law), "d": block("delay", time=p["t"]), "product": block("multiplication"),
        "damper": block("gain", gain=p["c"]), "loss": block("gain", gain=p["b"]), "f1": block("sum", signs="---"),
        "f2": block("sum", signs="++++-"),
    }  # fmt: skip
    wires = [
        "v1 -> x1", "v2 -> x2", "v1 -> rel.in1", "v2 -> rel.in2", "x1 -> way.in1", "x2 -> way.in2", "way -> spring",
        "x2 -> tyre", "v1 -> law.velocity", "rel -> law.relative_velocity", "law -> d", "d -> product.in1",
        "rel -> product.in2", "product -> damper", "rel -> loss", "spring -> f1.in1", "damper -> f1.in2", "loss -> f1.in3",
        "f1 -> v1", "spring -> f2.in1", "damper -> f2.in2", "loss -> f2.in3", "r -> f2.in4", "tyre -> f2.in5", "f2 -> v2",
    ]  # fmt: skip

    def loop(q: Numbers) -> Loop:
        parts = [
            b.Integrator("v1", "f1", 1 / q["m1"]), b.Integrator("x1", "v1"), b.Integrator("v2", "f2", 1 / q["m2"]),
            b.Integrator("x2", "v2"), b.Sum("rel", v1=1, v2=-1), b.Sum("spring", x1=q["k1"], x2=-q["k1"]),
            b.Switched("i", ("v1", "rel"), 0.1, q["on"], q["tr"] if smooth else 0.0), b.Product("p", "w", "rel"),
            b.Sum("f", p=q["c"], rel=q["b"]), b.Sum("f1", spring=-1, f=-1), b.Sum("f2", spring=1, f=1, r=1, x2=-q["k2"]),
        ]  # fmt: skip
        return Loop(parts, [Delay("i", "w", q["t"])], commands={"r": lambda t: p["a"] * math.sin(p["f"] * t)})

    return Case(
        name=f"{number} suspension, smooth {smooth}", numbers=p, loop=loop,
        document=document(blocks, wires, {"y": "x1", "v": "v2"}),
        signal={"kind": "sine", "amplitude": p["a"], "frequency": p["f"]}, end=_length(p["t"], 3.0),
        outputs={"y": "x1", "v": "v2"}, turned={"damper.gain": "c", "d.time": "t", "law.on": "on"},
    )  # fmt: skip
