"""Inputs that deliver volts, whatever sensor is behind them.

IEPE channels are made with a sensitivity of exactly 1 V for their unit, so that the calibration stays with the recording and
can be corrected later.
"""

from __future__ import annotations

from typing import Any

from nidaqmx.constants import (
    AccelSensitivityUnits,
    AccelUnits,
    BridgeUnits,
    Coupling,
    ExcitationSource,
    ForceIEPESensorSensitivityUnits,
    ForceUnits,
    VelocityIEPESensorSensitivityUnits,
    VelocityUnits,
)

from agent.settings import InputSettings

KINDS = ("voltage", "acceleration", "force", "velocity", "bridge")


def add_input(task: Any, entry: InputSettings) -> None:
    """Add an input that delivers volts."""
    limits = {"min_val": -entry.range, "max_val": entry.range}
    channels = task.ai_channels
    current = {
        "current_excit_source": ExcitationSource.INTERNAL,
        "current_excit_val": entry.excitation or 0.002,
    }
    match entry.kind:
        case "voltage":
            channels.add_ai_voltage_chan(entry.channel, **limits)
        case "acceleration":
            made = channels.add_ai_accel_chan(
                entry.channel,
                units=AccelUnits.G,
                sensitivity=1000.0,
                sensitivity_units=AccelSensitivityUnits.MILLIVOLTS_PER_G,
                **limits,
                **current,
            )
            made.ai_coupling = Coupling.AC
        case "force":
            channels.add_ai_force_iepe_chan(
                entry.channel,
                units=ForceUnits.NEWTONS,
                sensitivity=1000.0,
                sensitivity_units=ForceIEPESensorSensitivityUnits.MILLIVOLTS_PER_NEWTON,
                **limits,
                **current,
            )
        case "velocity":
            channels.add_ai_velocity_iepe_chan(
                entry.channel,
                units=VelocityUnits.METERS_PER_SECOND,
                sensitivity=1.0,  # mV/(mm/s) is V/(m/s)
                sensitivity_units=VelocityIEPESensorSensitivityUnits.MILLIVOLTS_PER_MILLIMETER_PER_SECOND,
                **limits,
                **current,
            )
        case _:
            channels.add_ai_bridge_chan(
                entry.channel,
                units=BridgeUnits.VOLTS_PER_VOLT,
                voltage_excit_val=entry.excitation or 2.5,
                **limits,
            )
