"""CompactDAQ chassis: they own the timing engines and the terminals, and the counters that digital modules lend pins to."""

from __future__ import annotations

from rig_simulator.families._base import Family, counter_terminals, engine_terminals, pins

_TERMINALS = "NI-DAQmx User Manual, Terminal Names"
_ENGINES = "NI-DAQmx User Manual, cDAQ-91xx and TestScale Chassis Timing Engines"
_SEVERAL = ("ai", "te0", "te1")


def _chassis(model: str, source: str, *, engines: tuple[str, ...], pfi: int, fast: bool = True) -> Family:
    analog = engine_terminals(*engines) | {f"{engine}/SyncPulse" for engine in engines}
    clocks = {"20MHzTimebase", "100kHzTimebase"} | ({"80MHzTimebase"} if fast else set())
    return Family(
        model=model,
        sources=(source, _TERMINALS, _ENGINES),
        counters=4 if fast else 2,
        engines=engines,
        named_when_reserved=len(engines) > 1,
        terminals=analog
        | engine_terminals("ao", "di", "do", timebase=False)
        | counter_terminals(4 if fast else 2)
        | pins(pfi)
        | clocks,
    )


ROWS = (
    _chassis("cDAQ-9171", "NI cDAQ-9171 User Manual", engines=("ai",), pfi=0),
    _chassis("cDAQ-9172", "NI cDAQ-9172 User Guide and Specifications (371747)", engines=("ai",), pfi=2, fast=False),
    _chassis("cDAQ-9174", "NI cDAQ-9174/9178 User Manual (372838)", engines=_SEVERAL, pfi=0),
    _chassis("cDAQ-9178", "NI cDAQ-9174/9178 User Manual (372838)", engines=_SEVERAL, pfi=2),
    _chassis("cDAQ-9185", "NI cDAQ-9185/9189 User Manual", engines=_SEVERAL, pfi=1),
    _chassis("cDAQ-9189", "NI cDAQ-9185/9189 User Manual", engines=_SEVERAL, pfi=1),
)
