"""Multifunction and dynamic signal devices with timing engines and terminals of their own."""

from __future__ import annotations

from typing import Any

from rig_simulator.families._base import IEPE, Clock, Family, counter_terminals, engine_terminals, pins

_TERMINALS = "NI-DAQmx User Manual, Terminal Names"
_SINGLE_ENDED = frozenset({"RSE", "NRSE", "DIFF"})
_COUNTING = frozenset({"encoder", "edges"})
_DIGITAL = frozenset({"digital input", "digital output"})
_ANALOG = frozenset({"voltage", "current", "thermocouple", "output voltage"})
_X = "X Series User Manual (370784)"
_M = "M Series User Manual (371022)"


def _x_series(model: str, *, inputs: int, input_rate: float, outputs: int, output_rate: float, analog: bool) -> Family:
    """Return a row: four counters, timing engines for digital lines, a 100 MHz timebase."""
    bus = (
        pins(8, "RTSI")
        if model.startswith("PCIe")
        else pins(8, "PXI_Trig")
        if model.startswith("PXIe")
        else frozenset()
    )
    return Family(
        model=model,
        sources=(_X, _TERMINALS),
        inputs=inputs,
        outputs=outputs,
        counters=4,
        lines=32 if inputs > 16 else 8,
        kinds=_ANALOG | _COUNTING | _DIGITAL,
        wirings=_SINGLE_ENDED,
        ranges=(0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0) if analog else (0.2, 1.0, 5.0, 10.0),
        output_range=(-10.0, 10.0),
        input_clock="sample",
        output_clock="sample",
        line_clock="sample",
        input_rate=input_rate,
        output_rate=output_rate,
        multiplexed=True,
        couplings=frozenset({"DC"}),
        analog_trigger=analog,
        engines=("ai",),
        terminals=engine_terminals("ai", "ao", "di", "do")
        | counter_terminals(4)
        | pins(16)
        | bus
        | {"ai/ConvertClock", "20MHzTimebase", "100MHzTimebase", "100kHzTimebase", "10MHzRefClock"}
        | ({"AnalogComparisonEvent", "APFI0"} if analog else set()),
    )


def _m_series(
    model: str,
    *sources: str,
    inputs: int,
    input_rate: float,
    output_rate: float,
    outputs: int = 2,
    pfi: int = 16,
    bus: frozenset[str] = frozenset(),
    analog: bool = False,
    line_clock: Clock = "sample",
) -> Family:
    """Return a row: two counters, no timing engine for digital lines, which follow another one's sample clock."""
    lines = {"di/SampleClock", "do/SampleClock"} if line_clock == "sample" else set()
    return Family(
        model=model,
        sources=(*sources, _TERMINALS),
        inputs=inputs,
        outputs=outputs,
        counters=2,
        lines=8 if line_clock == "sample" else 4,
        kinds=_ANALOG | _COUNTING | _DIGITAL,
        wirings=_SINGLE_ENDED,
        ranges=(0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0) if analog else (0.2, 1.0, 5.0, 10.0),
        output_range=(-10.0, 10.0),
        input_clock="sample",
        output_clock="sample",
        line_clock=line_clock,
        input_rate=input_rate,
        output_rate=output_rate,
        multiplexed=True,
        couplings=frozenset({"DC"}),
        analog_trigger=analog,
        engines=("ai",),
        terminals=engine_terminals("ai", "ao")
        | counter_terminals(2)
        | pins(pfi)
        | bus
        | lines
        | {"ai/ConvertClock", "20MHzTimebase", "80MHzTimebase", "100kHzTimebase"}
        | ({"AnalogComparisonEvent", "APFI0"} if analog else set()),
    )


def _low_cost(model: str, *, input_rate: float, bits: int) -> Family:
    """Return a row: outputs are set by software, digital lines too; one counter counts edges."""
    return Family(
        model=model,
        sources=("NI USB-6008/6009 User Guide and Specifications (371303)",),
        inputs=8,
        outputs=2,
        counters=1,
        lines=12,
        kinds=frozenset({"voltage", "output voltage", "edges"}) | _DIGITAL,
        wirings=frozenset({"RSE", "DIFF"}),
        ranges=(1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 10.0, 20.0),
        output_range=(0.0, 5.0),
        bits=bits,
        input_clock="sample",
        input_rate=input_rate,
        multiplexed=True,
        engines=("ai",),
        terminals=pins(1) | {"ai/StartTrigger", "ai/SampleClock"},
    )


def _dynamic(model: str, source: str, *, timebase: float, bus: frozenset[str], **row: Any) -> Family:
    """Return a row of a delta-sigma device; those with a bus share their timebase and a sync pulse over it."""
    shared = {"SyncPulse", "ai/SampleClockTimebase"} if bus else set()
    return Family(
        model=model,
        sources=(source, "NI-DAQmx User Manual, DSA synchronization"),
        wirings=frozenset({"PSEUDO", "DIFF"}) if bus else frozenset({"PSEUDO"}),
        kinds=frozenset({"voltage", "output voltage"}) | IEPE,
        bits=24,
        input_clock="timebase",
        output_clock="timebase",
        timebase=timebase,
        couplings=frozenset({"AC", "DC"}),
        analog_trigger=True,
        teds=True,
        engines=("ai",),
        terminals=frozenset(
            {"ai/SampleClock", "ai/StartTrigger", "ao/StartTrigger", "ai/ReferenceTrigger", "PFI0"} | shared | bus
        ),
        **row,
    )


ROWS = (
    _x_series("PCIe-6321", inputs=16, input_rate=250e3, outputs=2, output_rate=900e3, analog=False),
    _x_series("PCIe-6351", inputs=16, input_rate=1.25e6, outputs=2, output_rate=2.86e6, analog=True),
    _x_series("PCIe-6363", inputs=32, input_rate=2e6, outputs=4, output_rate=2.86e6, analog=True),
    _x_series("PXIe-6363", inputs=32, input_rate=2e6, outputs=4, output_rate=2.86e6, analog=True),
    _x_series("USB-6363", inputs=32, input_rate=2e6, outputs=4, output_rate=2.86e6, analog=True),
    _m_series("PCI-6221", _M, inputs=16, input_rate=250e3, output_rate=833e3, bus=pins(8, "RTSI")),
    _m_series("PCI-6251", _M, inputs=16, input_rate=1.25e6, output_rate=2.86e6, bus=pins(8, "RTSI"), analog=True),
    _m_series(
        "USB-6211",
        "NI USB-621x User Manual (371931)",
        inputs=16,
        input_rate=250e3,
        output_rate=250e3,
        pfi=8,
        line_clock="none",
    ),
    _low_cost("USB-6008", input_rate=10e3, bits=12),
    _low_cost("USB-6009", input_rate=48e3, bits=14),
    _dynamic(
        "PXI-4461",
        "NI Dynamic Signal Acquisition User Manual (371235)",
        timebase=204.8e3 * 256,
        bus=pins(8, "PXI_Trig"),
        inputs=2,
        outputs=2,
        ranges=(0.316, 1.0, 3.16, 10.0, 31.6, 42.4),
        output_range=(-10.0, 10.0),
        input_rate=204.8e3,
        output_rate=204.8e3,
        iepe=(0.0, 0.004, 0.01),
    ),
    _dynamic(
        "USB-4431",
        "NI USB-443x Specifications",
        timebase=102.4e3 * 256,
        bus=frozenset(),
        inputs=4,
        outputs=1,
        ranges=(10.0,),
        output_range=(-3.5, 3.5),
        input_rate=102.4e3,
        output_rate=96e3,
        iepe=(0.0, 0.0021),
    ),
)
