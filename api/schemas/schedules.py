"""Schedules: what is asked and what is replied."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field

from api.schemas.acquisitions import AcquisitionRequest
from api.schemas.identifications import IdentificationRequest
from api.schemas.optimizations import OptimizationRequest
from api.schemas.replies import Reply
from api.schemas.validations import ValidationRequest
from api.schemas.values import Document


class ScheduledOptimization(Document):
    """The body of `POST /v1/optimizations`."""

    kind: Literal["optimization"]
    body: OptimizationRequest


class ScheduledIdentification(Document):
    """The body of `POST /v1/identifications`."""

    kind: Literal["identification"]
    body: IdentificationRequest


class ScheduledValidation(Document):
    """The body of `POST /v1/validations`; an error beyond the limit raises an alert."""

    kind: Literal["validation"]
    body: ValidationRequest


class ScheduledAcquisition(Document):
    """The body of `POST /v1/acquisitions`; what follows its recording is in its `then`."""

    kind: Literal["acquisition"]
    body: AcquisitionRequest


class ScheduleRequest(Document):
    """A job, and when it is run."""

    name: str = Field(min_length=1, max_length=200)
    cron: str = Field(
        max_length=200,
        description="minute, hour, day of month, month, day of week; or @hourly, @daily, @weekly, @monthly, @yearly",
        examples=["30 2 * * mon-fri", "@daily"],
    )
    time_zone: str = Field(default="UTC", max_length=64, description="IANA name", examples=["Europe/Bucharest"])
    job: Annotated[
        ScheduledOptimization | ScheduledIdentification | ScheduledValidation | ScheduledAcquisition,
        Field(discriminator="kind"),
    ]
    overlap: Literal["skip", "queue", "cancel_previous"] = Field(
        default="skip", description="when the job before has not ended"
    )
    missed: Literal["none", "one", "all"] = Field(
        default="one", description="which of the instants are made up for at which nobody was there"
    )
    paused: bool = False
    newest: str | None = Field(
        default=None,
        min_length=1,
        max_length=200,
        description="name of recordings: each run takes the newest ready one in place of the body's `dataset`",
        examples=["press 3"],
    )


class RunReply(Reply):
    """What became of an instant."""

    id: str
    due_at: datetime
    outcome: Literal["started", "waiting", "skipped", "missed", "refused"]
    job: str | None = Field(description="id of the job that was started")
    detail: str | None = Field(description="why none was")
    created_at: datetime


class ScheduleHead(Reply):
    """A schedule as it is listed."""

    id: str
    name: str
    revision: int
    created_at: datetime
    kind: str
    cron: str
    time_zone: str
    paused: bool
    next_at: datetime | None = Field(description="null while it is paused")


class ScheduleReply(ScheduleHead):
    """A schedule; a job finds the stored systems and recordings that its body names as they are when it starts."""

    document: dict[str, Any]
    next_runs: list[datetime] = Field(description="the next five instants; none while it is paused")
