"""Measurements on rigs: what a user asks for, what an agent says, and what both are told."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Discriminator, Field, Tag

from api.schemas.datasets import ChannelDocument
from api.schemas.replies import Reply
from api.schemas.signals import SignalDocument
from api.schemas.values import Document, Identifier, Name, Quantity

Status = Literal["queued", "claimed", "running", "uploading", "done", "failed", "lost", "cancelled"]
Text = Annotated[str, Field(max_length=2000)]
Label = Annotated[str, Field(min_length=1, max_length=200)]


# What a rig is, as its agent registers it


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


# What a user asks for


class SteppedSineSignal(Document):
    """One frequency after the other, each for the same time, the phase continuous."""

    kind: Literal["stepped_sine"]
    amplitude: Quantity
    frequencies: list[Quantity] = Field(min_length=1, max_length=1000, description="rad/s")
    dwell: Quantity = Field(description="time at each frequency, s")
    phase: Quantity = Field(default=0.0, description="rad")


def _stepped_or_not(value: Any) -> str:
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return "stepped" if kind == "stepped_sine" else "signal"


DriveSignal = Annotated[
    Annotated[SteppedSineSignal, Tag("stepped")] | Annotated[SignalDocument, Tag("signal")],
    Discriminator(_stepped_or_not),
]


class DriveDocument(Document):
    """What an output of the rig plays, in V, or in A where its kind is current; a digital one is 1 where the signal is above 0.5."""

    output: Name
    signal: DriveSignal


class _Trigger(Document):
    """What a trigger has whatever it waits for; numbers without a unit are in that of the channel."""

    channel: Name = Field(description="one of those that are measured")
    hysteresis: Quantity = Field(
        default=0.0, description=">= 0: how far on the other side the channel must have been before"
    )
    timeout: Quantity = Field(default=60.0, description="s, at most 3600: how long it is waited for")


class LevelTrigger(_Trigger):
    """A channel that reaches a level from below (rising) or from above (falling)."""

    edge: Literal["rising", "falling"]
    level: Quantity


class WindowTrigger(_Trigger):
    """A channel that enters or leaves a window."""

    window: list[Quantity] = Field(min_length=2, max_length=2, description="[low, high]")
    when: Literal["enters", "leaves"]


def _window_or_level(value: Any) -> str:
    """Name the shape; the name is none of its fields, which would be taken for a place in the document."""
    there = "window" in value if isinstance(value, dict) else isinstance(value, WindowTrigger)
    return "of_window" if there else "of_level"


TriggerDocument = Annotated[
    Annotated[LevelTrigger, Tag("of_level")] | Annotated[WindowTrigger, Tag("of_window")],
    Discriminator(_window_or_level),
    Field(
        description="the recording begins pre_trigger before it: the first sample at or beyond the level, or on the new "
        "side of the window, that comes once pre_trigger has passed; only without a drive and repetitions"
    ),
]


class FollowUpDocument(Document):
    """A step that begins when the recording is there, and the steps before it have succeeded.

    `average`: the mean of the repetitions, a dataset of its own that the later steps use. `identification`,
    `validation`: their bodies without `dataset`; a validation takes what the identification before it found. A
    validation whose verdict is `fail` ends the chain, and raises an alert as every validation by a worker does. Bodies are
    judged when the measurement is asked for, as far as that can be done without the recording.
    """

    kind: Literal["average", "identification", "validation"]
    body: dict[str, Any] = Field(default_factory=dict)


class AcquisitionBody(Document):
    """A measurement on a rig."""

    name: Label
    rig: Label
    channels: list[Name] = Field(
        min_length=1,
        max_length=100,
        description="inputs of the rig; the output of the drive, to have what it was told to play",
    )
    sample_rate: float = Field(gt=0.0, le=10e6, description="samples/s; the hardware takes the next one that it has")
    duration: Quantity = Field(description="s, of one repetition")
    drive: DriveDocument | None = None
    pre_trigger: Quantity = Field(default=0.0, description="s that are recorded before the drive, or the trigger")
    trigger: TriggerDocument | None = None
    averages: int = Field(default=1, ge=1, le=1000, description="repetitions, back to back on one clock")
    confirm: bool = Field(default=False, description="a person at the rig has to agree first")
    record: bool = Field(
        default=True,
        description="false: nothing is kept. Sweeps of pre_trigger and duration are shown one after the other, each from its "
        "trigger on where there is one, until it is cancelled or 10 minutes are over",
    )
    then: list[FollowUpDocument] = Field(default_factory=list, max_length=20)


class AcquisitionRequest(Document):
    """A measurement, or a template with what is different this time; null takes a drive or a trigger of the template away."""

    template: Identifier | None = None
    name: Label | None = None
    rig: Label | None = None
    channels: list[Name] | None = Field(default=None, min_length=1, max_length=100)
    sample_rate: float | None = Field(default=None, gt=0.0, le=10e6)
    duration: Quantity | None = None
    drive: DriveDocument | None = None
    pre_trigger: Quantity | None = None
    trigger: TriggerDocument | None = None
    averages: int | None = Field(default=None, ge=1, le=1000)
    confirm: bool | None = None
    record: bool | None = None
    then: list[FollowUpDocument] | None = Field(default=None, max_length=20)


class TemplateReply(Reply):
    """A template."""

    id: str
    name: str
    revision: int
    created_at: datetime
    document: dict[str, Any]


class FollowUpReply(Reply):
    """How a step of the chain goes."""

    kind: str
    status: Literal["waiting", "running", "done", "failed", "skipped"]
    job: str | None
    result: dict[str, Any] | None
    detail: str | None


class AttemptReply(Reply):
    """One go at a measurement."""

    number: int
    status: Status
    job: str
    agent: str | None
    dataset: str | None
    late: bool = Field(description="samples came after the attempt had been given up")
    claimed_at: datetime | None
    ended_at: datetime | None
    lease_until: datetime | None
    facts: dict[str, Any] | None
    error: dict[str, Any] | None
    then: list[FollowUpReply]


class AcquisitionHead(Reply):
    """A measurement as it is listed."""

    id: str
    name: str
    rig: str
    status: Status
    attempt: int
    created_at: datetime
    dataset: str | None = Field(description="recording of the latest attempt")


class AcquisitionWarning(Reply):
    """What a person should know before the recording is trusted (warning), or measured once more (information)."""

    pointer: str
    level: Literal["warning", "information"]
    detail: str


class AcquisitionReply(AcquisitionHead):
    """A measurement with its attempts, the latest one last."""

    document: dict[str, Any]
    job: str
    attempts: list[AttemptReply]
    warnings: list[AcquisitionWarning]


# What an agent says


class ClaimReply(Reply):
    """An attempt that an agent has from now on; all numbers in SI, every signal one that the agent can compute."""

    acquisition: str
    attempt: int
    job: str
    name: str
    lease_seconds: float
    time: datetime
    request: dict[str, Any]


class PreviewDocument(Document):
    """Smallest and largest values of stretches of the channels, in their units."""

    start: float = Field(description="s since the inputs have begun; of a sweep, since its trigger, or since it began")
    sweep: int | None = Field(default=None, ge=1, description="number of a sweep, which this is all of up to now")
    step: float = Field(gt=0.0, description="s of one stretch")
    channels: dict[
        Name, Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(max_length=200)]
    ] = Field(max_length=100, description="[smallest, largest] of each stretch")


class HeartbeatRequest(Document):
    """The agent lives, and has the attempt."""

    agent: Identifier
    status: Literal["claimed", "running", "uploading"]
    progress: float | None = Field(default=None, ge=0.0, le=1.0)
    message: Text | None = None
    preview: PreviewDocument | None = None


class HeartbeatReply(Reply):
    """The lease goes on."""

    lease_seconds: float
    time: datetime


class AttemptDatasetRequest(Document):
    """Opens the recording of an attempt; asked again, it is the same one."""

    agent: Identifier
    start_time: AwareDatetime = Field(strict=False)
    sample_rate: float = Field(gt=0.0, description="that the hardware really has, samples/s")
    channels: list[ChannelDocument] = Field(min_length=1, max_length=100)
    facts: dict[str, Any] = Field(default_factory=dict)


class AttemptFault(Document):
    """Why an attempt failed."""

    code: Label = Field(examples=["overrun"])
    detail: Text


class FinishRequest(Document):
    """The end of an attempt: everything that was recorded is there."""

    agent: Identifier
    facts: dict[str, Any] = Field(default_factory=dict)
    error: AttemptFault | None = None
