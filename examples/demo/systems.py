"""The system documents: a servo-hydraulic position loop, under a proportional, a PID or a PD2 law.

The recording shows one combination of constants, the velocity gain kp * flow_gain / area, with the lag of the valve and a delay.
The control gain and the cylinder's own constants are typical of a 25 kN machine; they are assumed, not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Document = dict[str, Any]

STEP = {"kind": "step", "amplitude": {"value": 1, "unit": "mm"}}
"""The command of every comparison: 1 mm, so that five times the proportional law's effort opens the valve fully (1)."""

LAWS: Mapping[str, Document] = {
    "P": {"kind": "p", "kp": 200},
    "PID": {
        "kind": "pid",
        "kp": 200,
        "integral_time": {"value": 200, "unit": "ms"},
        "kd": 0,
        "filter_frequency": 1000,
        "setpoint_weight_p": 0.9,
    },
    "PD2": {"kind": "pd2", "kp": 200, "kd1": 0, "kd2": 0, "filter_frequency": 1000},
}
"""Control laws by name; position error in m, valve command 1 at full opening, so kp = 200 1/m opens it fully at 5 mm.

A valve that is not quite at its zero leaves a lasting error, which the integral part removes within its time of 200 ms; the
goals of the demonstration say nothing about that, so the time is given. Behind a loop that integrates by itself an integral
part overshoots, unless the proportional part sees a little less than the whole command: the set-point weight is a variable.
"""

VARIABLES: Mapping[str, list[Document]] = {
    "PID": [
        {"parameter": "controller.kp", "lower": 100, "upper": 700, "scale": "log"},
        {"parameter": "controller.setpoint_weight_p", "lower": 0.85, "upper": 1},
        {"parameter": "controller.kd", "lower": 0, "upper": 0.9},
    ],
    "PD2": [
        {"parameter": "controller.kp", "lower": 100, "upper": 700, "scale": "log"},
        {"parameter": "controller.kd1", "lower": 0, "upper": 2},
        {"parameter": "controller.kd2", "lower": 0, "upper": 1e-3},
    ],
}
"""What an optimisation may choose, and within which bounds."""

GRID: Mapping[str, dict[str, int]] = {
    "PID": {"controller.kp": 9, "controller.setpoint_weight_p": 9, "controller.kd": 5},
    "PD2": {"controller.kp": 9, "controller.kd1": 9, "controller.kd2": 5},
}
"""How many values of each variable the grid tries."""

MAP_ACROSS = {"PID": "controller.setpoint_weight_p", "PD2": "controller.kd1"}
"""The variable that the report's map shows beside kp."""

CONSTRUCTIVE = (
    "valve.flow_gain",
    "valve.time_constant",
    "transport.time",
    "cylinder.area",
    "cylinder.volume",
    "cylinder.bulk_modulus",
    "cylinder.leakage",
    "cylinder.mass",
    "cylinder.viscous_friction",
)
"""Parameters of the machine, as the paper calls them; those of the control law come beside them."""


def position_loop(law: str) -> Document:
    """Return the document of the loop under one of `LAWS`.

    Two delays are there because the recording does not tell where its delay sits: `transport` within the loop, before the valve,
    and `recording` behind it, in the measurement only. One of them is 0 in every estimate.
    """
    law_blocks, law_connections = _law(law)
    return {
        "name": f"Servo-hydraulic position loop, {law} law",
        "blocks": {
            **law_blocks,
            "reference": {"kind": "input"},
            "load": {"kind": "input", "role": "disturbance"},
            "transport": {"kind": "delay", "time": {"value": 3, "unit": "ms"}},
            "valve": {"kind": "proportional_valve", "flow_gain": 2.4e-4, "time_constant": {"value": 1, "unit": "ms"}},
            "cylinder": {
                "kind": "linear_hydraulic_motor",
                "area": {"value": 12.6, "unit": "cm**2"},
                "volume": {"value": 250, "unit": "cm**3"},
                "bulk_modulus": {"value": 1, "unit": "GPa"},
                "leakage": 2.3e-11,
                "mass": {"value": 10, "unit": "kg"},
                "viscous_friction": 1000,
            },
            "recording": {"kind": "delay", "time": 0},
        },
        "connections": [
            *law_connections,
            {"from": "controller", "to": "transport"},
            {"from": "transport", "to": "valve"},
            {"from": "valve", "to": "cylinder.flow"},
            {"from": "load", "to": "cylinder.force"},
            {"from": "cylinder.position", "to": "recording"},
        ],
        "outputs": {
            "position": "cylinder.position",
            "velocity": "cylinder.velocity",
            "acceleration": "cylinder.acceleration",
            "control": "controller",
            "measured": "recording",
        },
    }


def _law(law: str) -> tuple[Document, list[Document]]:
    """Return the blocks and connections between reference, position and controller: most laws see the error only."""
    controller = {"controller": dict(LAWS[law])}
    if "setpoint_weight_p" in LAWS[law]:
        return controller, [
            {"from": "reference", "to": "controller.reference"},
            {"from": "cylinder.position", "to": "controller.measurement"},
        ]
    return {"error": {"kind": "sum", "signs": "+-"}} | controller, [
        {"from": "reference", "to": "error.in1"},
        {"from": "cylinder.position", "to": "error.in2"},
        {"from": "error", "to": "controller"},
    ]


def published_model() -> Document:
    """Return the model that the authors of the recording fitted to the whole of it (examples/data/.../SOURCE.md)."""
    poles = (183.82897555, 48.58160838)
    return {
        "name": "Published model of the actuator",
        "blocks": {
            "reference": {"kind": "input"},
            "actuator": {
                "kind": "transfer_function",
                "numerator": [9045.99157866],
                "denominator": [1, poles[0] + poles[1], poles[0] * poles[1]],
            },
        },
        "connections": [{"from": "reference", "to": "actuator"}],
        "outputs": {"measured": "actuator"},
    }
