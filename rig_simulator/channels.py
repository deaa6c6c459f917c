"""Which kinds of channels there are, how each is asked for, and what a volt is in the units that a client asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

STANDARD_GRAVITY = 9.80665
_METRES_PER_INCH = 0.0254
_NEWTONS = {15875: 1.0, 15876: 4.4482216152605, 15877: STANDARD_GRAVITY}
_PER_SECOND = {15959: 1.0, 15960: _METRES_PER_INCH}
_ACCELERATION = {10186: STANDARD_GRAVITY, 12470: 1.0, 12471: _METRES_PER_INCH}

WIRINGS = {10083: "RSE", 10078: "NRSE", 10106: "DIFF", 12529: "PSEUDO", -1: ""}
BRIDGES = {10182: "FULL", 10187: "HALF", 10270: "QUARTER", 10228: "NONE"}
INTERNAL = 10200
"""nidaqmx.constants.ExcitationSource."""
_EDGES = {10090: 1, 10091: 2, 10092: 4}
_TICKS, _RADIANS, _DEGREES, _METRES, _INCHES = 10304, 10273, 10146, 10219, 10379


@dataclass(frozen=True, slots=True)
class Call:
    """A call that makes channels: AI, AO, CI, DI or DO; UsageTypeAI and the like; our word; its arguments as C has them.

    t task, s text, i int32, u uint32, d double, each with the name that the messages of gRPC have.
    """

    subsystem: str
    usage: int
    what: str
    arguments: str

    @property
    def names(self) -> list[str]:
        """Names of the arguments behind the task."""
        return [part.partition(":")[0] for part in self.arguments.split()]

    @property
    def signature(self) -> str:
        """Types of all arguments."""
        return "t" + "".join(part.partition(":")[2] for part in self.arguments.split())


_NAMES = "physical_channel:s name_to_assign_to_channel:s "
_LIMITS = "min_val:d max_val:d units:i "
_WIRED = _NAMES + "terminal_config:i " + _LIMITS
_IEPE = _WIRED + "sensitivity:d sensitivity_units:i current_excit_source:i current_excit_val:d custom_scale_name:s"
_COUNTER = "counter:s name_to_assign_to_channel:s "
_ENCODER = _COUNTER + "decoding_type:i zidx_enable:u zidx_val:d zidx_phase:i units:i "
_BRIDGE = "bridge_config:i voltage_excit_source:i voltage_excit_val:d nominal_bridge_resistance:d custom_scale_name:s"

CALLS = {
    "CreateAIVoltageChan": Call("AI", 10322, "voltage", _WIRED + "custom_scale_name:s"),
    "CreateAICurrentChan": Call(
        "AI", 10134, "current", _WIRED + "shunt_resistor_loc:i ext_shunt_resistor_val:d custom_scale_name:s"
    ),
    "CreateAIAccelChan": Call("AI", 10356, "acceleration", _IEPE),
    "CreateAIVelocityIEPEChan": Call("AI", 15966, "velocity", _IEPE),
    "CreateAIForceIEPEChan": Call("AI", 15895, "force", _IEPE),
    "CreateAIBridgeChan": Call("AI", 15908, "bridge", _NAMES + _LIMITS + _BRIDGE),
    "CreateAIThrmcplChan": Call(
        "AI",
        10303,
        "thermocouple",
        _NAMES + _LIMITS + "thermocouple_type:i cjc_source:i cjc_val:d cjc_channel:s",
    ),
    "CreateAOVoltageChan": Call("AO", 10322, "output voltage", _NAMES + _LIMITS + "custom_scale_name:s"),
    "CreateAOCurrentChan": Call("AO", 10134, "output current", _NAMES + _LIMITS + "custom_scale_name:s"),
    "CreateCIAngEncoderChan": Call(
        "CI", 10360, "encoder", _ENCODER + "pulses_per_rev:u initial_angle:d custom_scale_name:s"
    ),
    "CreateCILinEncoderChan": Call(
        "CI", 10361, "encoder", _ENCODER + "dist_per_pulse:d initial_pos:d custom_scale_name:s"
    ),
    "CreateCICountEdgesChan": Call("CI", 10125, "edges", _COUNTER + "edge:i initial_count:u count_direction:i"),
    "CreateDIChan": Call("DI", 0, "digital input", "lines:s name_to_assign_to_lines:s line_grouping:i"),
    "CreateDOChan": Call("DO", 0, "digital output", "lines:s name_to_assign_to_lines:s line_grouping:i"),
}

_VOLTS = {  # V of one SI unit, for a sensitivity of 1
    12509: 1e-3 / STANDARD_GRAVITY,  # mV/g
    12510: 1.0 / STANDARD_GRAVITY,  # V/g
    15963: 1.0,  # mV/(mm/s) is V/(m/s)
    15964: 1e-3 / _METRES_PER_INCH,  # mV/(in/s)
    15891: 1e-3,  # mV/N
    15892: 1e-3 / 4.4482216152605,  # mV/lb
}


def asked(call: Call, request: Any) -> dict[str, Any]:
    """Return the arguments of a gRPC message by name; a number that NI's enumeration lacks comes as `_raw`."""
    found = {}
    for name in call.names:
        raw = getattr(request, f"{name}_raw", 0)
        found[name] = raw or getattr(request, name)
    return found


def gain(*, units: int, sensitivity: float | None, sensitivity_units: int) -> float:
    """Return what 1 V is in the units of a channel; a channel without a sensor delivers volts.

    Parameters
    ----------
    units, sensitivity_units : int
        Numbers of nidaqmx.constants.
    sensitivity : float, optional
        In its units.
    """
    if sensitivity is None:
        return 1.0
    unit = {**_ACCELERATION, **_NEWTONS, **_PER_SECOND}.get(units, 1.0)
    return 1.0 / (sensitivity * _VOLTS.get(sensitivity_units, 1.0) * unit)


def steps(given: Mapping[str, Any]) -> tuple[float, float]:
    """Return what one count of an encoder is in rad or m, and one rad or m in the units asked for."""
    edges, units = _EDGES.get(given["decoding_type"], 1), given["units"]
    step = (
        2 * math.pi / (given["pulses_per_rev"] * edges)
        if "pulses_per_rev" in given
        else given["dist_per_pulse"] / edges
    )
    per_unit = {
        _TICKS: 1.0 / step,
        _RADIANS: 1.0,
        _DEGREES: 180.0 / math.pi,
        _METRES: 1.0,
        _INCHES: 1 / _METRES_PER_INCH,
    }
    return step, per_unit.get(units, 1.0)
