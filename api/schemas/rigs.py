"""What a rig is, as its agent registers it: inputs, outputs, devices, and what does not fit."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Field

from api.schemas.replies import Reply
from api.schemas.values import Document, Name

Text = Annotated[str, Field(max_length=2000)]
Label = Annotated[str, Field(min_length=1, max_length=200)]


class CalibrationDocument(Document):
    """What the certificate of a sensor says."""

    certificate: str = Field(default="", max_length=200)
    laboratory: str = Field(default="", max_length=200)
    calibrated_on: str = Field(default="", max_length=40, examples=["2026-03-01"])
    due: str = Field(default="", max_length=40, examples=["2027-03-01"])
    uncertainty_percent: float | None = Field(default=None, ge=0.0)
    reference_frequency: float | None = Field(default=None, ge=0.0, description="Hz")


class StageDocument(Document):
    """What is between a sensor and its input, an amplifier say."""

    model: str = Field(default="", max_length=200)
    serial: str = Field(default="", max_length=200)
    gain: float = Field(default=1.0, description="what it delivers for one that it is given")
    calibration: CalibrationDocument = Field(default_factory=CalibrationDocument)


class RigInputDocument(Document):
    """An input channel with its sensor: physical value = measured / (sensitivity x gains of the chain) + offset, in `unit`.

    Measured are V; of a bridge V/V, of a current A, of a thermocouple K, of an encoder rad or, with `distance`, m; of a counter
    rising edges; of a digital line 0 or 1.
    """

    name: Name
    channel: Label = Field(description="name of the channel in the hardware", examples=["cDAQ1Mod1/ai0"])
    kind: Literal[
        "voltage",
        "current",
        "acceleration",
        "force",
        "velocity",
        "bridge",
        "thermocouple",
        "encoder",
        "counter",
        "digital",
    ] = "voltage"
    quantity: str = Field(default="", max_length=100)
    unit: str = Field(default="V", max_length=64)
    sensitivity: float = Field(default=1.0, description="what is measured for one `unit`: V, of a bridge V/V, ...")
    offset: float = 0.0
    range: float = Field(
        default=10.0, gt=0.0, description="largest magnitude at the hardware, V (of a bridge V/V, of a current A)"
    )
    wiring: Literal["", "rse", "nrse", "diff", "pseudo"] = Field(default="", description="empty: what the module has")
    bridge: Literal["full", "half", "quarter"] = "full"
    resistance: float = Field(default=350.0, ge=0.0, description="of a bridge, Ohm")
    thermocouple: Literal["B", "E", "J", "K", "N", "R", "S", "T"] = "K"
    pulses: float = Field(default=0.0, ge=0.0, description="of an encoder in one turn")
    distance: float = Field(default=0.0, ge=0.0, description="of one pulse of a linear encoder, m")
    model: str = Field(default="", max_length=200)
    serial: str = Field(default="", max_length=200)
    calibration: CalibrationDocument = Field(default_factory=CalibrationDocument)
    chain: list[StageDocument] = Field(default_factory=list, max_length=20, description="from the sensor to the input")


class RigOutputDocument(Document):
    """An output channel and the limits that no job can exceed."""

    name: Name
    channel: Label
    kind: Literal["voltage", "current", "digital"] = "voltage"
    amplitude: float = Field(gt=0.0, description="largest magnitude, V, of a current A, of a digital output 1")
    slew: float | None = Field(default=None, gt=0.0, description="largest rate of change, V/s or A/s")
    duration: float | None = Field(default=None, gt=0.0, description="longest drive, s")
    soft_start: float = Field(default=0.0, ge=0.0, description="s")
    soft_stop: float = Field(default=0.0, ge=0.0, description="s")
    safe: float = Field(default=0.0, description="V or A, of a digital output 0 or 1, when nothing is driven")


class RigDeviceDocument(Document):
    """A module of the hardware."""

    name: Label
    model: str = Field(default="", max_length=200)
    serial: str = Field(default="", max_length=200)
    simulated: bool = False


class RigFindingDocument(Document):
    """What the agent found when it tried a device or a channel, without a start: it fits, fails, or there is something to know."""

    result: Literal["ok", "note", "fails"]
    what: Label = Field(examples=["input position"], description="device, input or output with its name, or hardware")
    told: Text
    remedy: Text = ""


class RigDocument(Document):
    """A rig."""

    devices: list[RigDeviceDocument] = Field(default_factory=list, max_length=100)
    inputs: list[RigInputDocument] = Field(default_factory=list, max_length=500)
    outputs: list[RigOutputDocument] = Field(default_factory=list, max_length=100)
    daq: str = Field(default="", max_length=200, description="how the hardware is reached")
    findings: list[RigFindingDocument] = Field(default_factory=list, max_length=1000)
    checked_at: AwareDatetime | None = Field(default=None, strict=False, description="when the findings were made")
    understands: list[Label] = Field(
        default_factory=list,
        max_length=100,
        description="what of a measurement the agent knows beyond the first ones: what it does not name here is not asked of it",
        examples=[["trigger", "record"]],
    )


class AgentRequest(Document):
    """An agent takes its rig."""

    rig: Label
    instance: str = Field(pattern="^[A-Za-z0-9_-]{8,64}$", description="what this agent calls itself for ever")
    name: Label
    version: str = Field(default="", max_length=40)
    document: RigDocument


class AgentReply(Reply):
    """An agent, and what it must know of the service."""

    id: str
    name: str
    version: str
    rig: str
    rig_id: str
    has_rig: bool = Field(description="whether this agent is the one that may drive the rig now")
    seen_at: datetime
    created_at: datetime
    lease_seconds: float = Field(description="how long a rig may move without a word from its agent")
    time: datetime = Field(description="the service's clock")


class RigReply(Reply):
    """A rig as its agent registered it last."""

    id: str
    name: str
    agent: str | None
    seen_at: datetime | None
    present: bool = Field(description="whether its agent was heard of within a lease: nothing is measured without it")
    created_at: datetime
    document: dict[str, Any]
