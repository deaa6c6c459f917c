"""The nonlinear job of the benchmark: a position loop with a limited valve, Stribeck friction and a magneto-rheological damper.

PD2 controller with filter, saturation, second-order valve, an oil spring that drives a mass, friction that builds up as tanh, a damper
after Bouc and Wen, sensor lag: 10 states that move, 8 parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system

Real = npt.NDArray[np.float64]

PARAMETERS = {
    "kp": 18.0, "td1": 0.010, "td2": 6e-4, "tf": 0.004, "gamma": 3.63e6, "alpha": 14000.0, "c0": 2100.0, "limit": 0.25,
}  # fmt: skip
STEP = 0.02
"""Amplitude of the step of the reference, m."""
DURATION = 0.4
STEPS = 2000
POSITION = 4
"""Number of the position among the states of `rates`."""

_BLOCKS: dict[str, tuple[str, dict[str, object]]] = {
    "reference": ("input", {}),
    "error": ("sum", {"signs": "+-"}),
    "controller": (
        "pd2", {"kp": "=kp", "kd1": "=kp*td1", "kd2": "=kp*td2", "filter_frequency": "=1/tf", "filter_damping": 1.0},
    ),
    "limiter": ("saturation", {"lower": "=-limit", "upper": "=limit"}),
    "valve": ("transfer_function", {"numerator": [9e4], "denominator": [1.0, 420.0, 9e4]}),
    "slip": ("sum", {"signs": "+-"}),
    "oil": ("transfer_function", {"numerator": [640000.0], "denominator": [1.0, 0.0]}),
    "force": ("sum", {"signs": "+--"}),
    "mass": ("transfer_function", {"numerator": [1 / 400], "denominator": [1.0, 0.0]}),
    "path": ("integrator", {}),
    "friction": (
        "friction",
        {"coulomb": 100.0, "static": 150.0, "stribeck_velocity": 0.01, "viscous": 200.0, "transition_velocity": 0.002},
    ),
    "damper": (
        "mr_damper_spencer",
        {"alpha": ["=alpha"], "c0": ["=c0"], "c1": [28300.0], "k0": [4690.0], "k1": 500.0, "gamma": "=gamma", "A": 301.0},
    ),
    "sensor": ("transfer_function", {"numerator": [500.0], "denominator": [1.0, 500.0]}),
}  # fmt: skip
_WIRES = (
    ("reference", "error.in1"), ("sensor", "error.in2"), ("error", "controller"), ("controller", "limiter"),
    ("limiter", "valve"), ("valve", "slip.in1"), ("mass", "slip.in2"), ("slip", "oil"), ("oil", "force.in1"),
    ("friction", "force.in2"), ("damper", "force.in3"), ("force", "mass"), ("mass", "path"), ("mass", "friction"),
    ("path", "damper.displacement"), ("mass", "damper.velocity"), ("path", "sensor"),
)  # fmt: skip


def diagram() -> Diagram:
    """Return the loop."""
    return compile_system(
        System(
            name="nonlinear loop",
            parameters={name: Parameter(value=value) for name, value in PARAMETERS.items()},
            blocks={name: Block(kind=kind, values=values) for name, (kind, values) in _BLOCKS.items()},
            connections=tuple(Connection(source=source, target=target) for source, target in _WIRES),
            outputs={"position": "path", "velocity": "mass"},
        )
    )


def sample(count: int, seed: int) -> Real:
    """Return candidates (count, 8), each parameter times exp(-0.2) to exp(0.2)."""
    chance = np.random.default_rng(seed).uniform(-0.2, 0.2, (count, len(PARAMETERS)))
    return np.array(list(PARAMETERS.values())) * np.exp(chance)


def rates(_: float, x: Sequence[float], *candidate: float) -> list[float]:
    """Return the loop's equations as a user of an integrator writes them."""
    kp, td1, td2, tf, gamma, alpha, c0, limit = candidate
    w1, w2, spool, turn, z, v, pressed, y, h, sensed = x
    q1, q2, e = td1 / tf, td2 / tf**2, STEP - sensed
    u = kp * (q2 * e + (q1 - 2 * q2) * w1 + (1 - q1 + q2) * w2)
    u = min(max(u, -limit), limit)
    friction = (100.0 + 50.0 * math.exp(-((v / 0.01) ** 2))) * math.tanh(v / 0.002) + 200.0 * v
    dy = (alpha * h + c0 * v + 4690.0 * (z - y)) / (c0 + 28300.0)
    damper = 28300.0 * dy + 500.0 * z
    w = v - dy
    dh = 301.0 * w - gamma * (abs(w) * h * abs(h) + w * h * h)
    return [
        (e - w1) / tf, (w1 - w2) / tf, 300.0 * turn, 300.0 * (u - spool) - 420.0 * turn, v,
        (pressed - friction - damper) / 400.0, 640000.0 * (spool - v), dy, dh, 500.0 * (z - sensed),
    ]  # fmt: skip
