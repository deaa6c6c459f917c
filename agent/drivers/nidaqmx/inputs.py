"""Inputs that deliver what the module measures, whatever sensor is behind them.

Analog ones deliver V (of a bridge V/V, of a current input A, of a thermocouple K): IEPE channels are made with a sensitivity
of exactly 1 V for their unit, so that the calibration stays with the recording and can be corrected later. An encoder delivers
rad, or m where a pulse is a way; a counter the rising edges since the start; a digital line 0 or 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import nidaqmx
from nidaqmx.constants import (
    AccelSensitivityUnits,
    AccelUnits,
    AngleUnits,
    BridgeConfiguration,
    BridgeUnits,
    CJCSource,
    CountDirection,
    Coupling,
    Edge,
    EncoderType,
    ExcitationSource,
    ForceIEPESensorSensitivityUnits,
    ForceUnits,
    LengthUnits,
    LineGrouping,
    TemperatureUnits,
    TerminalConfiguration,
    ThermocoupleType,
    VelocityIEPESensorSensitivityUnits,
    VelocityUnits,
)

from agent.settings import InputSettings

IEPE = ("acceleration", "force", "velocity")
"""Kinds whose sensor is fed with a current, and may hold a data sheet."""
FOLLOWERS = ("encoder", "counter", "digital")
"""Kinds that have no clock of their own: they follow that of the analog inputs."""
_WIRINGS = {
    "": TerminalConfiguration.DEFAULT,
    "rse": TerminalConfiguration.RSE,
    "nrse": TerminalConfiguration.NRSE,
    "diff": TerminalConfiguration.DIFF,
    "pseudo": TerminalConfiguration.PSEUDO_DIFF,
}
_BRIDGES = {
    "full": BridgeConfiguration.FULL_BRIDGE,
    "half": BridgeConfiguration.HALF_BRIDGE,
    "quarter": BridgeConfiguration.QUARTER_BRIDGE,
}


def add_input(task: Any, entry: InputSettings) -> None:
    """Add a channel to a task: of analog inputs, of a counter or of digital lines."""
    _ADD[entry.kind](task, entry)


def _limits(entry: InputSettings) -> dict[str, float]:
    return {"min_val": -entry.range, "max_val": entry.range}


def _wired(entry: InputSettings) -> dict[str, Any]:
    return {"terminal_config": _WIRINGS[entry.wiring], **_limits(entry)}


def _iepe(entry: InputSettings) -> dict[str, Any]:
    current = {
        "current_excit_source": ExcitationSource.INTERNAL,
        "current_excit_val": entry.excitation or 0.002,
    }
    return {**_wired(entry), **current}


def _voltage(task: Any, entry: InputSettings) -> None:
    task.ai_channels.add_ai_voltage_chan(entry.channel, **_wired(entry))


def _current(task: Any, entry: InputSettings) -> None:
    task.ai_channels.add_ai_current_chan(entry.channel, **_wired(entry))


def _acceleration(task: Any, entry: InputSettings) -> None:
    made = task.ai_channels.add_ai_accel_chan(
        entry.channel,
        units=AccelUnits.G,
        sensitivity=1000.0,
        sensitivity_units=AccelSensitivityUnits.MILLIVOLTS_PER_G,
        **_iepe(entry),
    )
    made.ai_coupling = Coupling.AC


def _force(task: Any, entry: InputSettings) -> None:
    task.ai_channels.add_ai_force_iepe_chan(
        entry.channel,
        units=ForceUnits.NEWTONS,
        sensitivity=1000.0,
        sensitivity_units=ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON,
        **_iepe(entry),
    )


def _velocity(task: Any, entry: InputSettings) -> None:
    task.ai_channels.add_ai_velocity_iepe_chan(
        entry.channel,
        units=VelocityUnits.METERS_PER_SECOND,
        sensitivity=1.0,  # mV/(mm/s) is V/(m/s)
        sensitivity_units=VelocityIEPESensorSensitivityUnits.MILLIVOLTS_PER_MILLIMETER_PER_SECOND,
        **_iepe(entry),
    )


def _bridge(task: Any, entry: InputSettings) -> None:
    task.ai_channels.add_ai_bridge_chan(
        entry.channel,
        units=BridgeUnits.VOLTS_PER_VOLT,
        bridge_config=_BRIDGES[entry.bridge],
        nominal_bridge_resistance=entry.resistance,
        voltage_excit_val=entry.excitation or 2.5,
        **_limits(entry),
    )


def _thermocouple(task: Any, entry: InputSettings) -> None:
    task.ai_channels.add_ai_thrmcpl_chan(
        entry.channel,
        units=TemperatureUnits.K,
        min_val=273.0,
        max_val=373.0,
        thermocouple_type=ThermocoupleType[entry.thermocouple],
        cjc_source=CJCSource.BUILT_IN,
    )


def _encoder(task: Any, entry: InputSettings) -> None:
    if entry.distance:
        task.ci_channels.add_ci_lin_encoder_chan(
            entry.channel, decoding_type=EncoderType.X_4, units=LengthUnits.METERS, dist_per_pulse=entry.distance
        )
    else:
        task.ci_channels.add_ci_ang_encoder_chan(
            entry.channel, decoding_type=EncoderType.X_4, units=AngleUnits.RADIANS, pulses_per_rev=round(entry.pulses)
        )


def _counter(task: Any, entry: InputSettings) -> None:
    task.ci_channels.add_ci_count_edges_chan(entry.channel, edge=Edge.RISING, count_direction=CountDirection.COUNT_UP)


def _digital(task: Any, entry: InputSettings) -> None:
    task.di_channels.add_di_chan(entry.channel, line_grouping=LineGrouping.CHAN_PER_LINE)


_ADD: dict[str, Callable[[nidaqmx.Task, InputSettings], None]] = {
    "voltage": _voltage,
    "current": _current,
    "acceleration": _acceleration,
    "force": _force,
    "velocity": _velocity,
    "bridge": _bridge,
    "thermocouple": _thermocouple,
    "encoder": _encoder,
    "counter": _counter,
    "digital": _digital,
}
KINDS = tuple(_ADD)
