"""A hydraulic position axis: as the textbook has it, and as it stands in the (simulated) lab."""

from __future__ import annotations

from typing import Any

GAIN = "controller.kp"
START_GAIN = 6.0
"""1/s: the law on the rig in the morning."""

TEXTBOOK: dict[str, Any] = {
    "flow_gain": 2.0e-3,
    "valve_lag": 2e-3,
    "delay": 0.5e-3,
    "leakage": 1e-11,
    "mass": 300.0,
    "viscous_friction": 1200.0,
    "bulk_modulus": 1.4e9,
}
"""What data sheets say: m**3/s for 1 m/s of command, s, s, m**3/(s*Pa), kg, N*s/m, Pa."""

TRUTH: dict[str, Any] = {
    "flow_gain": 1.45e-3,
    "valve_lag": 5e-3,
    "delay": 2.5e-3,
    "leakage": 2.5e-11,
    "mass": 340.0,
    "viscous_friction": 2600.0,
    "bulk_modulus": 1.1e9,
}
"""What stands in the lab; nobody but the simulator knows it."""

IDENTIFIED: list[dict[str, Any]] = [
    {"parameter": "flow_gain", "lower": 5e-4, "upper": 5e-3},
    {"parameter": "valve_lag", "lower": 1e-4, "upper": 5e-2},
    {"parameter": "delay", "lower": 1e-4, "upper": 2e-2},
    {"parameter": "bulk_modulus", "lower": 3e8, "upper": 3e9},
    {"parameter": "leakage", "lower": 1e-12, "upper": 1e-9},
]
"""Mass and friction stay as the data sheets have them: the recording tells their products with these two."""
HIDDEN = 55.0
"""Hz: a mode of the frame, which no element of the library has."""


def axis(values: dict[str, Any], *, gain: float) -> dict[str, Any]:
    """Return the position loop around the axis."""
    return {
        "name": "hydraulic axis",
        "parameters": {
            "kp": {"value": gain, "lower": 1.0, "upper": 200.0},
            **{k: {"value": v} for k, v in values.items()},
        },
        "blocks": {
            "reference": {"kind": "input"},
            "error": {"kind": "sum", "signs": "+-"},
            "controller": {"kind": "p", "kp": "=kp"},
            "transport": {"kind": "delay", "time": "=delay"},
            "valve": {"kind": "proportional_valve", "flow_gain": "=flow_gain", "time_constant": "=valve_lag"},
            "cylinder": {
                "kind": "linear_hydraulic_motor",
                "area": 2e-3,
                "volume": 1e-3,
                "bulk_modulus": "=bulk_modulus",
                "leakage": "=leakage",
                "mass": "=mass",
                "viscous_friction": "=viscous_friction",
            },
        },
        "connections": [
            {"from": "reference", "to": "error.in1"},
            {"from": "cylinder.position", "to": "error.in2"},
            {"from": "error", "to": "controller"},
            {"from": "controller", "to": "transport"},
            {"from": "transport", "to": "valve"},
            {"from": "valve", "to": "cylinder.flow"},
        ],
        "outputs": {"position": "cylinder.position", "control": "controller"},
    }


RIG = f"""\
# A simulated rig: it stands in for hardware.
speed = 4.0
[plant]
system = "axis.json"
[[devices]]
name = "cDAQ1Mod1"
model = "NI 9234"
serial = "01A2B3C4"
[[devices]]
name = "cDAQ1Mod2"
model = "NI 9260"
serial = "01A2B3C5"
[[drives]]
channel = "cDAQ1Mod2/ao0"
input = "reference"
gain = 0.01
[[sensors]]
channel = "cDAQ1Mod1/ai0"
loopback = "cDAQ1Mod2/ao0"
noise = 0.0005
[[sensors]]
channel = "cDAQ1Mod1/ai1"
output = "position"
sensitivity = 100.0
noise = 0.0005
hum = 0.0003
# Between cylinder and sensor.
hidden_mode = {{frequency = {HIDDEN}, damping_ratio = 0.03, share = 0.03}}
"""

AGENT = """\
[rig]
name = "bench-1"
[daq]
driver = "{driver}"
chunk = 0.2
[spool]
reserve = 0.0
[[devices]]
name = "{device}"
serial = "01A2B3C4"
[[inputs]]
name = "reference"
channel = "cDAQ1Mod1/ai0"
quantity = "displacement"
unit = "m"
sensitivity = 100.0
range = 5.0
[[inputs]]
name = "position"
channel = "cDAQ1Mod1/ai1"
quantity = "displacement"
unit = "m"
sensitivity = 100.0
range = 5.0
model = "LVDT 50"
serial = "4711"
[inputs.calibration]
certificate = "DKD-2026-081"
calibrated_on = "2026-03-02"
due = "2027-03-02"
[[outputs]]
name = "reference"
channel = "cDAQ1Mod2/ao0"
amplitude = 4.0
duration = 60.0
soft_stop = 0.5
"""

DRIVERS = {"nidaqmx": ("cDAQ1Mod1", "127.0.0.1:{port}"), "opcua": ("PLC", "opc.tcp://127.0.0.1:{port}")}
"""Driver -> what the rig calls itself behind it, and where it is."""

CHIRP: dict[str, Any] = {
    "name": "chirp of the reference",
    "rig": "bench-1",
    "channels": ["reference", "position"],
    "sample_rate": 1600,
    "duration": 8.0,
    "pre_trigger": 0.2,
    "drive": {
        "output": "reference",
        "signal": {
            "kind": "chirp",
            "amplitude": 2.0,
            "start_frequency": {"value": 0.2, "unit": "Hz"},
            "end_frequency": {"value": 70, "unit": "Hz"},
            "duration": 7.5,
        },
    },
}
STEP: dict[str, Any] = CHIRP | {
    "name": "step of the reference",
    "duration": 2.5,
    "drive": {"output": "reference", "signal": {"kind": "step", "amplitude": 2.0}},
}
"""20 mm: 2 V of 100 V/m."""
