"""What a row of the table of device families says."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Clock = Literal["none", "sample", "timebase"]
"""none: a value at a time, on demand; sample: a sample clock that may be shared; timebase: delta-sigma, whose modules share the
clock of their converters and a sync pulse, never a sample clock."""

IEPE = frozenset({"acceleration", "force", "velocity"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """One device, module or chassis as NI's documents describe it.

    ``ranges`` V (of a current input A, of a bridge V/V) are the largest magnitudes; ``output_range`` V or A; rates samples/s;
    ``timebase`` Hz of the converters of a delta-sigma module, which divides it by 256 and by 1 to 31; ``iepe`` A;
    ``engines`` are the timing engines for analog input; ``terminals`` those that are named by this device.
    """

    model: str
    sources: tuple[str, ...]
    inputs: int = 0
    outputs: int = 0
    counters: int = 0
    lines: int = 0
    kinds: frozenset[str] = frozenset()
    wirings: frozenset[str] = frozenset()
    ranges: tuple[float, ...] = ()
    output_range: tuple[float, float] = (0.0, 0.0)
    bits: int = 16
    input_clock: Clock = "none"
    output_clock: Clock = "none"
    line_clock: Clock = "none"
    input_rate: float = 0.0
    output_rate: float = 0.0
    multiplexed: bool = False
    timebase: float = 0.0
    couplings: frozenset[str] = frozenset()
    iepe: tuple[float, ...] = ()
    bridges: frozenset[str] = frozenset()
    analog_trigger: bool = False
    teds: bool = False
    in_chassis: bool = False
    engines: tuple[str, ...] = ()
    named_when_reserved: bool = False
    terminals: frozenset[str] = field(default_factory=frozenset)

    @property
    def divider(self) -> int:
        """The largest by which a delta-sigma module divides its highest rate; 0 for any rate, as dynamic signal devices have it."""
        return 31 if self.timebase and self.in_chassis else 0


def pins(count: int, name: str = "PFI") -> frozenset[str]:
    """Return the names of so many terminals."""
    return frozenset(f"{name}{i}" for i in range(count))


def engine_terminals(*engines: str, timebase: bool = True) -> frozenset[str]:
    """Return the terminals of timing engines."""
    signals = ("SampleClock", "StartTrigger") + (("SampleClockTimebase",) if timebase else ())
    found = {f"{engine}/{signal}" for engine in engines for signal in signals}
    return frozenset(found | {f"{engine}/ReferenceTrigger" for engine in engines if engine not in {"ao", "do"}})


def counter_terminals(count: int) -> frozenset[str]:
    """Return the terminals of counters."""
    return frozenset(f"Ctr{i}{what}" for i in range(count) for what in ("Source", "Gate", "Aux", "InternalOutput"))
