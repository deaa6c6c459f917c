"""Recordings and their samples."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import Field

from api.schemas.replies.base import Curve, Number, Reply
from api.schemas.replies.jobs import JobReply


class DatasetHead(Reply):
    """A recording as it is listed."""

    id: str
    name: str
    format: str
    status: Literal["open", "parsing", "ready", "failed"]
    created_at: datetime
    start_time: datetime | None


class ProcessingReply(Reply):
    """How a recording was made from others: its steps with their numbers, and the samples of each experiment in it."""

    sources: list[str]
    combine: str | None
    steps: list[dict[str, Any]]
    experiments: list[int] | None
    versions: dict[str, str]


class GroupReply(Reply):
    """Channels of one time base, which are a recording."""

    name: str
    dataset_id: str
    sample_rate: Number
    sample_count: int
    channels: list[str]


class FunctionHead(Reply):
    """A function of frequency of a file: what it is, between which points, in the units of the file."""

    name: str
    kind: str
    response: str
    reference: str
    response_unit: str
    reference_unit: str
    lines: int


class FunctionReply(FunctionHead):
    """A function of frequency with its lines, rad/s, in the units of the file."""

    frequency: Curve
    real: Curve
    imag: Curve


class DatasetReply(DatasetHead):
    """A recording without its samples."""

    revision: int
    document: dict[str, Any] | None
    sample_rate: Number
    sample_count: int | None
    duration: Number
    uneven: bool = Field(description="whether the instants of the samples are uneven: the first channel holds them")
    channels: list[dict[str, Any]]
    size: int | None
    sha256: str | None
    error: dict[str, Any] | None
    report: dict[str, Any] | None
    functions: list[FunctionHead] = Field(description="functions of frequency that the file holds")
    groups: list[GroupReply] = Field(description="of a file of several time bases: the recordings that it became")
    job: JobReply | None = None
    processing: ProcessingReply | None = Field(default=None, description="of a recording that was made from others")


class PreviewReply(Reply):
    """The job that looks at a file; its result is the proposal."""

    dataset: str
    job: JobReply


class SegmentReply(Reply):
    """A segment that is there."""

    sha256: str
    size: int


class ChannelReply(Reply):
    """A stretch of a channel: `values`, or `min` and `max` of consecutive stretches."""

    unit: str
    sample_rate: Number
    time: Curve
    values: Curve | None = None
    min: Curve | None = None
    max: Curve | None = None
