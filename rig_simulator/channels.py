"""Which kinds of channels there are, and what a volt is in the units that a client asks for."""

from __future__ import annotations

STANDARD_GRAVITY = 9.80665
_METRES_PER_INCH = 0.0254
_NEWTONS = {15875: 1.0, 15876: 4.4482216152605, 15877: STANDARD_GRAVITY}
_PER_SECOND = {15959: 1.0, 15960: _METRES_PER_INCH}
_ACCELERATION = {10186: STANDARD_GRAVITY, 12470: 1.0, 12471: _METRES_PER_INCH}

USAGES = {
    "CreateAIVoltageChan": ("AI", 10322),
    "CreateAIAccelChan": ("AI", 10356),
    "CreateAIVelocityIEPEChan": ("AI", 15966),
    "CreateAIForceIEPEChan": ("AI", 15895),
    "CreateAIBridgeChan": ("AI", 15908),
    "CreateAOVoltageChan": ("AO", 10322),
}
"""Call -> (AI or AO, nidaqmx.constants.UsageTypeAI or UsageTypeAO)."""

_VOLTS = {  # V of one SI unit, for a sensitivity of 1
    12509: 1e-3 / STANDARD_GRAVITY,  # mV/g
    12510: 1.0 / STANDARD_GRAVITY,  # V/g
    15963: 1.0,  # mV/(mm/s) is V/(m/s)
    15964: 1e-3 / _METRES_PER_INCH,  # mV/(in/s)
    15891: 1e-3,  # mV/N
    15892: 1e-3 / 4.4482216152605,  # mV/lb
}


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
