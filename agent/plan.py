"""What a claim asks of this rig: channels found among its own, and nothing that this agent does not know."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from agent.errors import AttemptError
from agent.settings import InputSettings, OutputSettings, Settings
from agent.triggering import Trigger

LONGEST_LIVE = 600.0
"""s for which sweeps are shown: other measurements of the rig wait for their end."""
UNDERSTOOD = ("trigger", "record", "commanded")
"""What this agent knows beyond the first measurements; it tells the service."""
_FIRST = frozenset({"channels", "sample_rate", "duration", "pre_trigger", "averages", "drive", "confirm"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What a claim asks of this rig."""

    inputs: tuple[InputSettings, ...]
    output: OutputSettings | None
    sample_rate: float
    duration: float
    pre_trigger: float
    averages: int
    signal: Mapping[str, Any] | None
    trigger: Trigger | None
    confirm: bool
    record: bool
    commanded: bool
    """Whether what the output plays is kept as the last channel of the recording."""

    @property
    def width(self) -> int:
        """Channels of the recording."""
        return len(self.inputs) + self.commanded

    @property
    def seconds(self) -> float:
        """Length of the recording."""
        return self.pre_trigger + self.duration * self.averages

    @property
    def longest(self) -> float:
        """Longest time, s, that the inputs run."""
        if not self.record:
            return LONGEST_LIVE
        return self.seconds + (self.trigger.timeout if self.trigger else 0.0)


def plan_of(claim: Mapping[str, Any], settings: Settings) -> Plan:
    """Find the channels of a claim among those of the rig.

    Raises
    ------
    AttemptError
        `unknown_channel`, `unsupported_setting`.
    """
    request = claim["request"]
    for name, value in request.items():
        if value is not None and name not in _FIRST and name not in UNDERSTOOD:
            raise AttemptError(
                "unsupported_setting", f"{name} must be known to this agent, it is not: update the agent"
            )
    inputs = {entry.name: entry for entry in settings.inputs}
    outputs = {entry.name: entry for entry in settings.outputs}
    drive = request["drive"]
    for name, known in [(name, inputs) for name in request["channels"]] + (
        [(drive["output"], outputs)] if drive else []
    ):
        if name not in known:
            there = ", ".join(known) or "none"
            raise AttemptError("unknown_channel", f"channel must be one of the rig's ({there}), got {name}")
    measured = tuple(inputs[name] for name in request["channels"])
    trigger = request.get("trigger")
    return Plan(
        inputs=measured,
        output=outputs[drive["output"]] if drive else None,
        sample_rate=float(request["sample_rate"]),
        duration=float(request["duration"]),
        pre_trigger=float(request["pre_trigger"]),
        averages=int(request["averages"]),
        signal=drive["signal"] if drive else None,
        trigger=Trigger.of(trigger, measured) if trigger else None,
        confirm=bool(request["confirm"]) or (drive is not None and settings.rig.confirm),
        record=bool(request.get("record", True)),
        commanded=bool(request.get("commanded")) and drive is not None,
    )
