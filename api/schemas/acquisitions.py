"""Measurements on rigs: what a user asks for, what an agent says, and what both are told."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Discriminator, Field, Tag

from api.schemas.datasets import ChannelDocument
from api.schemas.replies import Reply
from api.schemas.rigs import Label, Text
from api.schemas.signals import SignalDocument
from api.schemas.values import Document, Identifier, Name, Quantity, SampleRate
from engine.recordings.sample_rates import LEAST_RATE

Status = Literal["queued", "claimed", "running", "uploading", "done", "failed", "lost", "cancelled"]


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
    sample_rate: float = Field(
        ge=LEAST_RATE, le=10e6, description="samples/s; the hardware takes the next one that it has"
    )
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
    sample_rate: float | None = Field(default=None, ge=LEAST_RATE, le=10e6)
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
    sample_rate: SampleRate = Field(description="that the hardware really has, samples/s")
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
