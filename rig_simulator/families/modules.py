"""C Series modules: channels, ranges and converters; all but the pins of digital ones is named by their chassis.

Data rates of delta-sigma modules: the timebase divided by 256 and by 1 to 31. Modules of 13.1072 MHz (9234, 9250, 9260) and of
12.8 MHz (9229, 9237, 9239) follow each other's timebase; a task takes the fastest of its modules.
"""

from __future__ import annotations

from typing import Any

from rig_simulator.families._base import IEPE, Family, pins

_SHARED = "NI CompactRIO documentation, NI 9234 Maximum Sample Rate When Synchronizing Multiple Modules"
_DELTA_SIGMA = "NI cDAQ-9172 User Guide and Specifications (371747), AI Convert Clock, sigma-delta modules"
_DIFFERENTIAL = frozenset({"DIFF"})
_FAST, _USUAL = 13.1072e6, 12.8e6


def _module(model: str, *sources: str, **row: Any) -> Family:
    return Family(model=model, sources=sources, in_chassis=True, **row)


def _delta_sigma(model: str, source: str, *, timebase: float, **row: Any) -> Family:
    return _module(
        model,
        source,
        _DELTA_SIGMA,
        _SHARED,
        timebase=timebase,
        bits=24,
        input_clock="timebase" if row.get("inputs") else "none",
        output_clock="timebase" if row.get("outputs") else "none",
        input_rate=timebase / 256 if row.get("inputs") else 0.0,
        output_rate=timebase / 256 if row.get("outputs") else 0.0,
        **row,
    )


_VOLTAGE = frozenset({"voltage"})

ROWS = (
    _module(
        "NI 9203",
        "NI 9203 Datasheet",
        inputs=8,
        kinds=frozenset({"current"}),
        wirings=frozenset({"RSE"}),
        ranges=(0.02,),
        input_clock="sample",
        input_rate=200e3,
        multiplexed=True,
    ),
    _module(
        "NI 9205",
        "NI 9205 Datasheet (374188)",
        "NI 9144 User Guide and Specifications, NI 9205/9206 conversion code",
        inputs=32,
        kinds=_VOLTAGE,
        wirings=frozenset({"RSE", "NRSE", "DIFF"}),
        ranges=(0.2, 1.0, 5.0, 10.0),
        input_clock="sample",
        input_rate=250e3,
        multiplexed=True,
        analog_trigger=True,
    ),
    _module(
        "NI 9213",
        "NI 9213 Datasheet",
        inputs=16,
        kinds=frozenset({"voltage", "thermocouple"}),
        wirings=_DIFFERENTIAL,
        ranges=(0.078125,),
        bits=24,
        input_clock="sample",
        input_rate=75.0,
    ),
    _module(
        "NI 9215",
        "NI 9215 Datasheet",
        inputs=4,
        kinds=_VOLTAGE,
        wirings=_DIFFERENTIAL,
        ranges=(10.0,),
        input_clock="sample",
        input_rate=100e3,
    ),
    _delta_sigma(
        "NI 9229",
        "NI 9229/9239 Datasheet",
        timebase=_USUAL,
        inputs=4,
        kinds=_VOLTAGE,
        wirings=_DIFFERENTIAL,
        ranges=(60.0,),
    ),
    _delta_sigma(
        "NI 9234",
        "NI 9234 Datasheet (374238)",
        timebase=_FAST,
        inputs=4,
        kinds=_VOLTAGE | IEPE,
        wirings=frozenset({"PSEUDO"}),
        ranges=(5.0,),
        couplings=frozenset({"AC", "DC"}),
        iepe=(0.0, 0.002),
        teds=True,
    ),
    _delta_sigma(
        "NI 9237",
        "NI 9237 Datasheet (374186)",
        timebase=_USUAL,
        inputs=4,
        kinds=frozenset({"bridge", "strain"}),
        wirings=_DIFFERENTIAL,
        ranges=(0.025,),
        bridges=frozenset({"FULL", "HALF", "QUARTER"}),
        teds=True,
    ),
    _delta_sigma(
        "NI 9239",
        "NI 9229/9239 Datasheet",
        timebase=_USUAL,
        inputs=4,
        kinds=_VOLTAGE,
        wirings=_DIFFERENTIAL,
        ranges=(10.0,),
    ),
    _delta_sigma(
        "NI 9260",
        "NI 9260 Datasheet",
        timebase=_FAST,
        outputs=2,
        kinds=frozenset({"output voltage"}),
        output_range=(-4.24, 4.24),
    ),
    _module(
        "NI 9263",
        "NI 9263 Datasheet",
        outputs=4,
        kinds=frozenset({"output voltage"}),
        output_range=(-10.0, 10.0),
        output_clock="sample",
        output_rate=100e3,
    ),
    _module(
        "NI 9265",
        "NI 9265 Datasheet",
        "NI 9144 User Guide and Specifications, NI 9265",
        outputs=4,
        kinds=frozenset({"output current"}),
        output_range=(0.0, 0.02),
        output_clock="sample",
        output_rate=100e3,
    ),
    _module(
        "NI 9401",
        "NI 9401 Datasheet",
        "NI cDAQ-9174/9178 User Manual (372838), counters",
        lines=8,
        counters=4,
        kinds=frozenset({"digital input", "digital output", "encoder", "edges"}),
        line_clock="sample",
        terminals=pins(8),
    ),
    _module(
        "NI 9411",
        "NI 9411 Datasheet",
        "NI cDAQ-9174/9178 User Manual (372838), counters",
        lines=6,
        counters=4,
        kinds=frozenset({"digital input", "encoder", "edges"}),
        line_clock="sample",
        terminals=pins(6),
    ),
)
