"""The system documents that the reference and property tests measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from engine.diagram.diagram import Block, Connection, Diagram, Parameter, System, compile_system

# The mid-range linear pneumatic motor of the seed paper, section 3, in SI: A = 65 cm2, V = 750 cm3, p = 5 daN/cm2,
# a_m = 0.4 cm5/(daN s), m = 0.3 daN s2/cm, b_m = 1.2 daN s/cm, chi = 1.4.
MOTOR: Mapping[str, float] = {
    "area": 65e-4,
    "volume": 750e-6,
    "pressure": 5e5,
    "adiabatic_index": 1.4,
    "leakage": 0.4e-11,
    "mass": 300.0,
    "viscous_friction": 1200.0,
}


def system(
    blocks: Mapping[str, Block],
    wires: Sequence[str],
    outputs: Mapping[str, str],
    parameters: Mapping[str, float] | None = None,
) -> Diagram:
    """Return the checked diagram; a wire is written ``"error -> controller"``."""
    connections = tuple(Connection(source=s, target=t) for s, t in (wire.split(" -> ") for wire in wires))
    declared = {name: Parameter(value=value) for name, value in (parameters or {}).items()}
    return compile_system(
        System(name="test", parameters=declared, blocks=dict(blocks), connections=connections, outputs=dict(outputs))
    )


def block(kind: str, **values: Any) -> Block:
    return Block(kind=kind, values=values)


def transfer_function(numerator: Sequence[Any], denominator: Sequence[Any], **parameters: float) -> Diagram:
    """u -> num/den -> y, alone."""
    return system(
        {"u": block("input"), "plant": block("transfer_function", numerator=[*numerator], denominator=[*denominator])},
        ["u -> plant"],
        {"y": "plant"},
        parameters,
    )


def unity_loop(numerator: Sequence[Any], denominator: Sequence[Any], **parameters: float) -> Diagram:
    """r -> error -> num/den -> y with unity negative feedback; the loop is cut at ``error``."""
    return system(
        {
            "r": block("input"),
            "error": block("sum", signs="+-"),
            "plant": block("transfer_function", numerator=[*numerator], denominator=[*denominator]),
        },
        ["r -> error.in1", "plant -> error.in2", "error -> plant"],
        {"y": "plant"},
        parameters,
    )


def pneumatic_loop(kp: float = 100.0, ki: float = 20.0, kd: float = 5.0) -> Diagram:
    """PID position loop round the mid-range pneumatic motor; gains in the paper's cm3/s per cm, N = 100 rad/s."""
    per_si = 1e-4  # 1 cm3/s per cm = 1e-6 m3/s per 1e-2 m
    return system(
        {
            "reference": block("input"),
            "error": block("sum", signs="+-"),
            "controller": block("pid", kp="=kp", ki="=ki", kd="=kd", filter_frequency=100.0),
            "motor": block("linear_pneumatic_motor", **MOTOR),
        },
        ["reference -> error.in1", "motor.position -> error.in2", "error -> controller", "controller -> motor.flow"],
        {"position": "motor.position", "velocity": "motor.velocity", "control": "controller"},
        {"kp": kp * per_si, "ki": ki * per_si, "kd": kd * per_si},
    )
