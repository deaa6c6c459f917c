"""The table [daq] of NI hardware."""

from __future__ import annotations

from dataclasses import dataclass

from agent.settings import DaqSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class NidaqmxSettings(DaqSettings):
    """How NI hardware is reached.

    ``server`` is the address of an NI gRPC Device Server, empty for the driver of this PC. ``clock`` and ``trigger`` are
    terminals that outputs take their clock and start from; by default those that the driver names for the inputs' task.
    """

    server: str = ""
    clock: str = ""
    trigger: str = ""
